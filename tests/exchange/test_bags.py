"""Answers as a ROS 2 bag, read back by rosbags itself; poses beside a literal covariance."""

from __future__ import annotations

import csv
import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.bags import rosbag2, typesys
from support.common.commands import content, fails, run

from lava_vpr import Localizer, load
from lava_vpr.backends import answering
from lava_vpr.cli import main
from lava_vpr.exchange.ros import BY_HAND, RoutePoses
from lava_vpr.images.imagefiles import read_image
from lava_vpr.model import save
from lava_vpr.positions.frames import Positions
from lava_vpr.traverse import open_traverse

QUERY = ("query", "xy.lvpr", "query", "--motion", "any", "--stamps", "times.csv", "-o", "q.csv")
ALL = (*QUERY, "--target-precision", 0.1)
START = 1_700_000_000.25
CURVE = np.array([(float(k), 0.1 * k * k) for k in range(8)])


@pytest.fixture
def drive(here: Path) -> None:
    """A map on a curve, and times of the queries."""
    save(replace(load("m.lvpr"), positions=CURVE, frame="xy"), Path("xy.lvpr"))
    Path("times.csv").write_text("time\n" + "".join(f"{START + k}\n" for k in range(8)))


def read(path: str) -> dict[str, list[tuple[int, Any]]]:
    """Time and message of all that a bag holds, by topic; types are those of its own definitions."""
    types = typesys.get_typestore(typesys.Stores.EMPTY)
    found: dict[str, list[tuple[int, Any]]] = {}
    with rosbag2.Reader(Path(path)) as bag:
        for one in bag.connections:
            types.register(typesys.get_types_from_msg(one.msgdef.data, one.msgtype))
            found[one.topic] = []
        for one, when, raw in bag.messages():
            found[one.topic].append((when, types.deserialize_cdr(raw, one.msgtype)))
    return found


def test_a_bag_has_poses_links_and_posteriors(drive: None) -> None:
    told = run(*ALL, "--bag", "out").stdout
    assert told == "8 images, 8 accepted: q.csv\n"
    bag, robot = read("out"), Localizer("xy.lvpr", target_precision=0.1)
    assert {topic: len(said) for topic, said in bag.items()} == {
        "/initialpose": 8,
        "/rtabmap/info": 8,
        "/rtabmap/link": 8,
    }
    rows = zip(open_traverse("query").paths, *bag.values(), strict=True)
    for number, (path, (_, pose), (when, info), (_, link)) in enumerate(rows):
        match = robot.update(read_image(path))
        belief = robot.belief
        assert when == (1_700_000_000 + number) * 10**9 + 250_000_000
        for header in (pose.header, info.header):
            assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (
                1_700_000_000 + number,
                250_000_000,
                "map",
            )
        assert (info.ref_id, info.loop_closure_id) == (9 + number, match.place + 1)
        likely = np.flatnonzero(belief.places >= 1e-6)
        assert info.posterior_keys.tolist() == [-1, *(likely + 1)]
        assert np.allclose(info.posterior_values, [belief.off_map, *belief.places[likely]], atol=1e-7)
        assert (link.from_id, link.to_id, link.type) == (9 + number, match.place + 1, 1)
        where, covariance = pose.pose.pose, pose.pose.covariance.reshape(6, 6)
        assert (where.position.x, where.position.y) == match.position
        heading = 2 * np.arctan2(where.orientation.z, where.orientation.w)
        turn = np.eye(6)
        turn[:2, :2] = turn[3:5, 3:5] = [[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]
        assert np.allclose(link.information.reshape(6, 6) @ turn @ covariance @ turn.T, np.eye(6), atol=1e-8)


def test_a_pose_is_off_by_what_is_believed() -> None:
    """The covariance is that of many draws from the belief, each somewhere in its place."""
    belief, rng = np.array([0.0, 0.1, 0.5, 0.2, 0.0, 0.0, 0.0, 0.1]), np.random.default_rng(0)
    route = RoutePoses.of(Positions(CURVE, "xy"))
    pose = route.pose(2, belief)
    assert (pose.x, pose.y, pose.heading) == (2.0, 0.4, pytest.approx(np.arctan2(0.4, 1.0)))
    drawn = rng.choice(8, 200_000, p=belief / belief.sum())
    headings = np.array([np.arctan2(*np.gradient(CURVE, axis=0)[k][::-1]) for k in range(8)])
    off = np.column_stack([CURVE[drawn] - CURVE[2], headings[drawn] - headings[2]])
    off[:, :2] += route.lengths[drawn, None] * rng.uniform(-0.5, 0.5, (len(drawn), 2))
    assert np.allclose(off.T @ off / len(off) + np.diag(BY_HAND), pose.covariance, atol=0.05)
    faint = belief + 4e-4 * np.eye(8)[5]
    assert np.array_equal(route.pose(2, faint).covariance, pose.covariance)


@pytest.mark.parametrize(
    ("places", "frame", "headings"),
    [
        ([(0, 0), (0, 0), (0, 5), (0, 5), (0, 5), (-5, 5)], "xy", [90, 90, 90, 90, 180, 180]),
        ([(1, 1), (1, 1)], "xy", [0, 0]),
        ([(47.0, 8.0), (47.0, 8.001), (47.0, 8.002)], "latlon", [0, 0, 0]),
        ([(-33.0, 359.0), (-33.001, 359.0)], "latlon", [-90, -90]),
    ],
)
def test_a_robot_heads_along_the_route(places: list[tuple[float, float]], frame: str, headings: list[float]) -> None:
    """One that stands keeps its heading; degrees are metres in a UTM zone, whose north is nearly ours."""
    route = RoutePoses.of(Positions(np.array(places), frame))
    assert np.allclose(np.degrees(route.headings), headings, atol=2.0)
    assert frame == "xy" or 70 < route.lengths[0] < 120


def test_only_what_is_accepted_closes_a_loop(drive: None) -> None:
    run(*QUERY, "--target-precision", 0.999, "--bag", "out")
    with Path("q.csv").open() as file:
        accepted = [row["accepted"] == "true" for row in csv.DictReader(file)]
    assert not all(accepted)
    bag = read("out")
    assert len(bag["/initialpose"]) == len(bag["/rtabmap/link"]) == sum(accepted)
    closed = [(info.loop_closure_id > 0, info.loop_closure_transform.rotation.w) for _, info in bag["/rtabmap/info"]]
    assert closed == [(one, float(one)) for one in accepted]


def test_equal_answers_are_equal_bytes(drive: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many images are encoded at a time."""
    run(*ALL, "--bag", "out")
    Path("out").rename("first")
    monkeypatch.setattr(answering, "BATCH", 3)
    run(*ALL, "--bag", "out")
    assert sorted(path.name for path in Path("out").iterdir()) == ["metadata.yaml", "out.mcap"]
    for path in Path("out").iterdir():
        assert path.read_bytes() == Path("first", path.name).read_bytes()


def test_a_map_without_positions_has_posteriors_alone(drive: None) -> None:
    told = run("query", "m.lvpr", *ALL[2:], "--bag", "out").stderr
    assert "out: has neither poses nor links, since the map has no positions" in told
    assert {topic: len(said) for topic, said in read("out").items()} == {"/rtabmap/info": 8}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--bag", "there"), "there: exists, and a bag replaces nothing; remove it or name another folder"),
        (("--bag", "none/out"), "none/out: cannot be written (No such file or directory); free space or choose"),
        (("--bag", "out", "--stamps", "early.csv"), "query: a bag has times from 1970 to 2038; correct those"),
    ],
)
def test_what_cannot_be_a_bag_is_one_line(drive: None, words: tuple[str, ...], message: str) -> None:
    Path("there").mkdir()
    Path("there/kept").write_text("kept")
    Path("early.csv").write_text("time\n" + "".join(f"{k - 3}\n" for k in range(8)))
    before = content(Path())
    assert fails(*ALL, *words).startswith(message)
    assert content(Path()) == before


def test_a_bag_needs_times(drive: None) -> None:
    for k, path in enumerate(sorted(Path("query").iterdir())):
        os.symlink(path.resolve(), f"{k}.png")
    Path("list.txt").write_text("".join(f"{k}.png\n" for k in range(8)))
    message = fails("query", "xy.lvpr", "list.txt", "--motion", "any", "--bag", "out")
    assert message == "list.txt: a bag needs the times of its images; give them with --stamps"


@pytest.mark.parametrize("write", ["write", "close"])
def test_a_full_disk_leaves_nothing(drive: None, monkeypatch: pytest.MonkeyPatch, write: str) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = content(Path())
    monkeypatch.setattr(rosbag2.Writer, write, full)
    message = fails(*ALL, "--bag", "out")
    assert message == "out: cannot be written (No space left on device); free space or choose another place"
    assert content(Path()) == before


def test_who_stops_halfway_leaves_nothing(drive: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    before = content(Path())
    monkeypatch.setattr(rosbag2.Writer, "write", stopped)
    assert CliRunner().invoke(main, [*map(str, ALL), "--bag", "out"]).exit_code == 1
    assert content(Path()) == before
