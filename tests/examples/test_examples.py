"""The examples run; the ROS 2 node answers images with stand-ins for rclpy and cv_bridge."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.common import children
from support.common.bags import bag, frames
from support.common.commands import images, run

from lava_vpr import Localizer, load
from lava_vpr.images.imagefiles import read_image
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.model import save

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example(name: str, *words: object) -> subprocess.CompletedProcess[str]:
    """The example called ``name`` in a process of its own."""
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *map(str, words)]
    return children.run(command, capture_output=True, text=True, timeout=120, check=False)


def replayed(*words: object) -> subprocess.CompletedProcess[str]:
    """`replay_bag.py` in a process of its own."""
    return example("replay_bag", *words)


def test_a_bag_is_replayed(here: Path) -> None:
    path = bag(Path("drive"), frames(map(read_image, images("query")), 0.5, topic="/left"))
    done = replayed("m.lvpr", path, "--topic", "/left", "--every", 0.5)
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    wanted = [json.loads(line) for line in run("watch", "m.lvpr", path, "--every", 0.5).stdout.splitlines()]
    assert [float(line[0]) for line in lines] == [k / 2 for k in range(8)]
    assert [int(line[3]) for line in lines] == [one["place"] for one in wanted]
    assert [line[6] == "accepted" for line in lines] == [one["accepted"] for one in wanted]


@pytest.mark.slow
def test_a_bag_is_replayed_as_fast_as_it_was(here: Path) -> None:
    path = bag(Path("drive"), frames(map(read_image, images("query")[:3]), 0.5))
    done = replayed("m.lvpr", path, "--every", 0.5, "--rate", 2)
    assert len(done.stdout.splitlines()) == 3, done.stderr


def test_what_cannot_be_replayed_is_one_line(here: Path) -> None:
    done = replayed("m.lvpr", "none.mcap")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("replay_bag: none.mcap: cannot be opened (No such file or directory)")
    assert len(done.stderr.splitlines()) == 1


class Node:
    """What rclpy's Node does, as far as the example asks: its parameters are ``given``."""

    given: dict[str, Any]

    def __init__(self, name: str) -> None:
        self.name, self.parameters, self.published, self.warned = name, {}, [], []
        self.subscribed: list[tuple[str, Any]] = []
        self.others: dict[str, list[Any]] = {}

    def declare_parameter(self, name: str, value: Any) -> None:
        self.parameters[name] = self.given.get(name, value)

    def get_parameter(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(value=self.parameters[name])

    def create_publisher(self, kind: Any, topic: str, depth: int) -> SimpleNamespace:
        sent = self.published if topic == "match" else self.others.setdefault(topic, [])
        return SimpleNamespace(publish=sent.append)

    def create_subscription(self, kind: Any, topic: str, callback: Any, profile: Any) -> None:
        self.subscribed.append((topic, callback))

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(warning=self.warned.append)

    def destroy_node(self) -> None:
        self.name = ""


class Bridge:
    """What cv_bridge makes of a message: its pixels as BGR."""

    def imgmsg_to_cv2(self, message: Any, desired_encoding: str) -> np.ndarray:
        if (message.encoding, desired_encoding) != ("rgb8", "bgr8"):
            raise ValueError(f"cannot convert {message.encoding}")
        return message.data.reshape(message.height, message.width, 3)[:, :, ::-1]


MESSAGES = (
    *("Time", "Vector3", "Quaternion", "Point", "Pose", "PoseWithCovariance", "PoseWithCovarianceStamped"),
    *("Transform", "Info", "Link", "MapGraph"),
)


@pytest.fixture
def node_module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The example, imported where rclpy and the messages are stand-ins."""
    contents: dict[str, dict[str, Any]] = {
        "cv_bridge": {"CvBridge": Bridge, "CvBridgeError": ValueError},
        "rclpy": {"init": lambda: None, "try_shutdown": lambda: None},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": "sensor"},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": object},
        "std_msgs": {},
        "std_msgs.msg": {"String": SimpleNamespace},
    }
    for package in ("builtin_interfaces", "geometry_msgs", "rtabmap_msgs"):
        contents |= {package: {}, f"{package}.msg": {name: SimpleNamespace for name in MESSAGES}}
    contents["std_msgs.msg"]["Header"] = SimpleNamespace
    for name, values in contents.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("ros2_node", EXAMPLES / "ros2_node.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def message(image: np.ndarray, encoding: str = "bgr8", second: int = 5) -> SimpleNamespace:
    """A sensor_msgs/Image as rclpy gives it: its data is an array of bytes."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=second, nanosec=500_000_000))
    height, width = image.shape[:2]
    values = {"height": height, "width": width, "step": image[0].size, "data": image.reshape(-1)}
    return SimpleNamespace(header=header, encoding=encoding, **values)


def test_the_node_answers_images(here: Path, node_module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Node, "given", {"model": "m.lvpr", "motion": "forward"}, raising=False)
    node, robot = node_module.LocalizerNode(), Localizer("m.lvpr", motion="forward")
    ((topic, callback),) = node.subscribed
    assert topic == "image"
    callback(message(np.zeros((4, 4, 3), np.uint8), "yuv422"))
    for path in images("query"):
        callback(message(read_image(path)[:, :, ::-1], "rgb8"))
    matches = [robot.update(read_image(path)) for path in images("query")]
    answers = [json.loads(one.data) for one in node.published]
    assert [one["place"] for one in answers] == [match.place for match in matches]
    assert [one["probability"] for one in answers] == [round(match.probability, 6) for match in matches]
    assert [one["off_map"] for one in answers] == [round(match.off_map, 6) for match in matches]
    assert answers[0]["time"] == 5.5
    (warning,) = node.warned
    assert warning == "cannot convert yuv422"


@pytest.mark.parametrize("rtabmap", [True, False])
def test_the_node_tells_slam(
    here: Path, node_module: ModuleType, monkeypatch: pytest.MonkeyPatch, rtabmap: bool
) -> None:
    """What rtabmap shall hear is left out where its messages are not installed."""
    if not rtabmap:
        monkeypatch.setitem(sys.modules, "rtabmap_msgs.msg", None)
    model = replace(load("m.lvpr"), positions=np.array([(float(k), 0.0) for k in range(8)]), frame="xy")
    save(model, Path("xy.lvpr"))
    monkeypatch.setattr(Node, "given", {"model": "xy.lvpr", "target_precision": 0.01}, raising=False)
    node, robot = node_module.LocalizerNode(), Localizer("xy.lvpr", target_precision=0.01)
    assert set(node.others) == ({"initialpose", "rtabmap/info", "rtabmap/link"} if rtabmap else {"initialpose"})
    for number, path in enumerate(images("query")):
        node.answer(message(read_image(path)[:, :, ::-1], "rgb8"))
        match = robot.update(read_image(path))
        pose = node.others["initialpose"][number]
        assert (pose.header.stamp.sec, pose.header.stamp.nanosec, pose.header.frame_id) == (5, 500_000_000, "map")
        assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == match.position
        assert len(pose.pose.covariance) == 36
        for topic, (name, wanted) in {"info": ("ref_id", number + 9), "link": ("to_id", match.place + 1)}.items():
            assert not rtabmap or getattr(node.others[f"rtabmap/{topic}"][number], name) == wanted


def test_what_is_not_known_is_null(here: Path, node_module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Node, "given", {"model": "m.lvpr", "motion": "none"}, raising=False)
    node = node_module.LocalizerNode()
    node.answer(message(np.full((48, 64, 3), 90, np.uint8), "rgb8"))
    said = json.loads(node.published[0].data, parse_constant=pytest.fail)
    assert (said["place"], said["place_name"], said["position"], said["off_map"]) == (-1, None, None, None)
    assert node.others == {"rtabmap/info": []}


def test_the_node_runs_until_it_is_stopped(
    here: Path, node_module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    spun: list[Any] = []

    def spin(node: Any) -> None:
        spun.append(node)
        raise KeyboardInterrupt

    monkeypatch.setattr(node_module.rclpy, "spin", spin, raising=False)
    monkeypatch.setattr(Node, "given", {"model": "m.lvpr"}, raising=False)
    node_module.main()
    assert spun[0].name == ""
    monkeypatch.setattr(Node, "given", {"model": "none.lvpr"}, raising=False)
    with pytest.raises(SystemExit, match=r"^lava_vpr: none\.lvpr"):
        node_module.main()


def test_images_are_described_learned_and_recognised(here: Path) -> None:
    for name in ("reference", "query"):
        done = example("describe_images", name, "-o", f"{name}.npz")
        assert (done.returncode, done.stdout) == (0, f"8 descriptors of 1,764 values: {name}.npz\n"), done.stderr
    run("train", "reference.npz", "-o", "d.lvpr")
    lines = run("query", "d.lvpr", "query.npz", "-o", "-").stdout.splitlines()
    assert [line.split(",")[1] for line in lines[1:]] == [path.name for path in images("query")]
    assert sum(line.split(",")[0] == line.split(",")[2] for line in lines[1:]) >= 7
    done = example("describe_images", "nothing", "-o", "x.npz")
    assert done.returncode == 1
    assert done.stderr.startswith("error: nothing: cannot be opened")


def test_a_route_is_learned_and_followed(here: Path) -> None:
    done = example("map_and_localise", "reference", "query", "-o", "followed.lvpr")
    assert done.returncode == 0, done.stderr
    *lines, last = done.stdout.splitlines()
    robot = Localizer("followed.lvpr", motion="any")
    matches = [robot.update(read_image(path)) for path in images("query")]
    for line, path, match in zip(lines, images("query"), matches, strict=True):
        assert line.startswith(f"{path.name}: {match.name if match.accepted else ''}")
        assert line.endswith(f"(probability {match.probability:.2f}, {match.spikes.sum()} spikes)")
    assert last == f"{sum(match.accepted for match in matches)} of 8 images accepted"
    done = example("map_and_localise", "reference", "nothing")
    assert (done.returncode, done.stderr.splitlines()[0][:27]) == (1, "error: nothing: cannot be o")


@pytest.mark.slow
def test_a_decoder_of_ones_own_stands_beside_the_others(here: Path) -> None:
    done = example("own_decoder", "reference", "query")
    assert done.returncode == 0, done.stderr
    found = {name: float(share.rstrip("%")) for name, share, _ in map(str.split, done.stdout.splitlines())}
    assert set(found) == {*DECODERS, "votes"}
    assert found["votes"] >= 87
    done = example("own_decoder", "reference", images("query")[0])
    assert done.returncode == 1
    assert "has 1 images, reference 8; give as many" in done.stderr


@pytest.mark.slow
def test_a_bundle_counts_the_spikes_of_its_model(here: Path) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "bundle")
    done = example("board_from_bundle", "bundle", "m.lvpr", "query", "--limit", 3)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("3 images, ")
    assert done.stdout.splitlines()[1] == "the bundle counts the same"
    run("train", "reference", "-o", "other.lvpr", "--seed", 9)
    done = example("board_from_bundle", "bundle", "other.lvpr", "query")
    assert done.returncode == 1
    assert "counts differ: it was made of another model" in done.stdout


@pytest.mark.slow
def test_a_route_is_learned_on_a_cluster_of_this_machine(here: Path) -> None:
    """With the bytes of the command alone."""
    done = example("local_cluster", "reference", "-o", "there.lvpr", "--config", "quick.toml", "--stretch", 4)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr.splitlines()[0].startswith("note: tcp://127.0.0.1:")
    run("train", "reference", "-o", "alone.lvpr", "--config", "quick.toml", "--stretch", 4)
    assert Path("there.lvpr").read_bytes() == Path("alone.lvpr").read_bytes()
    done = example("local_cluster", "nothing", "-o", "none.lvpr")
    assert done.returncode == 1
    assert "lava-vpr: error: nothing: cannot be opened" in done.stderr
