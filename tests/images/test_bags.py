"""ROS bags as sources: every storage and encoding, several topics, damage, and what is missing."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.bags import KINDS, START, Message, bag, frames, rosbag2, typesys
from support.common.imagefiles import image_bytes, refused, smooth_picture, watched

from lava_vpr.errors import InputError
from lava_vpr.images import imagefiles as room
from lava_vpr.images.bags import bag_samples, is_bag, split_topic
from lava_vpr.images.imagefiles import LONGEST_S, PATIENCE_S, PAUSE_S, appearing
from lava_vpr.traverse import located, open_traverse

PICTURES = [smooth_picture(k) for k in range(6)]


def text_bag(path: Path) -> Path:
    """A bag without images."""
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    name = "std_msgs/msg/String"
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/said", name, typestore=types)
        writer.write(connection, START, types.serialize_cdr(types.types[name]("hello"), name))
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_a_traverse(kind: str, tmp_path: Path) -> None:
    path = bag(tmp_path / "b", frames(PICTURES), kind)
    whole = open_traverse(path)
    assert whole.names == tuple(f"frame {k:06d}" for k in range(6))
    assert whole.stamps is not None
    assert whole.stamps.tolist() == [START + k for k in range(6)]
    for image, picture in zip(whole.images(), PICTURES, strict=True):
        np.testing.assert_array_equal(image, picture)
    backwards = whole.take([5, 2, 2, 0])
    for image, k in zip(backwards.images(), (5, 2, 2, 0), strict=True):
        np.testing.assert_array_equal(image, PICTURES[k])
    np.testing.assert_array_equal(backwards.load(1), PICTURES[2])
    assert open_traverse(path, places=(1, 3)).indices.tolist() == [1, 2]


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_the_file_in_a_folder_is_a_bag_too(kind: str, tmp_path: Path) -> None:
    folder = bag(tmp_path / "b", frames(PICTURES), kind)
    (file,) = folder.glob(f"*.{kind}")
    whole = open_traverse(file)
    assert len(whole) == 6
    assert set(open_traverse(folder).paths) == {str(folder), *map(str, folder.iterdir())}  # none of which is replaced


@pytest.mark.parametrize("every", [0.1, 0.2, 0.35, 5.0])
def test_one_image_every_so_often(every: float, tmp_path: Path) -> None:
    path = bag(tmp_path / "b", frames(PICTURES * 2, 0.1))
    wanted, due = [], 0.0
    for k in range(12):
        if k / 10 > due - 1e-6:
            wanted.append(k)
            while due < k / 10 + 1e-6:
                due += every
    whole = open_traverse(path, every=every)
    assert [int(name.split()[1]) for name in whole.names] == wanted


@pytest.mark.parametrize(
    ("encoding", "order"),
    [
        *(("bgr8", [0, 1, 2]), ("8UC3", [0, 1, 2]), ("rgb8", [2, 1, 0]), ("mono8", [0]), ("8UC1", [0])),
        *(("bgra8", [0, 1, 2, 0]), ("rgba8", [2, 1, 0, 0])),
    ],
)
@pytest.mark.parametrize("padded", [0, 7])
def test_colours_and_grey(encoding: str, order: list[int], padded: int, tmp_path: Path) -> None:
    stored = PICTURES[0][:, :, order]
    path = bag(tmp_path / "b", [Message(stored, encoding, step=stored[0].size + padded)])
    wanted = PICTURES[0] if len(order) > 1 else PICTURES[0][:, :, 0]
    np.testing.assert_array_equal(open_traverse(path).load(0), wanted)


@pytest.mark.parametrize("kind", KINDS)
def test_compressed_images(kind: str, tmp_path: Path) -> None:
    path = bag(
        tmp_path / "b", [Message(image_bytes(".png", picture), "png", k) for k, picture in enumerate(PICTURES)], kind
    )
    for image, picture in zip(open_traverse(path).images(), PICTURES, strict=True):
        np.testing.assert_array_equal(image, picture)


def test_a_header_without_time_leaves_that_of_the_record(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", frames(PICTURES[:2], stamped=False))
    assert open_traverse(path).stamps is not None
    assert [one.stamp for one in watched(path)] == [START, START + 1]


def test_of_several_topics_one_is_named(tmp_path: Path) -> None:
    left, right = frames(PICTURES[:2], topic="/left"), frames(PICTURES[2:4], topic="/right")
    path = bag(tmp_path / "b", [left[0], right[0], left[1], right[1]])
    refused(lambda: open_traverse(path), "b: has images of /left, /right; name one: ", "b:/left")
    refused(lambda: open_traverse(f"{path}:/top"), "has no images of /top, but of /left, /right")
    refused(lambda: list(watched(path, topic="/top")), "has no images of /top")
    whole = open_traverse(f"{path}:/right")
    np.testing.assert_array_equal(whole.take([1]).load(0), PICTURES[3])
    seen = list(watched(path, topic="/right"))
    np.testing.assert_array_equal(seen[1].image, PICTURES[3])
    assert [one.name for one in watched(f"{path}:/right")] == ["frame 000000", "frame 000001"]
    refused(lambda: watched(str(tmp_path), topic="/right"), "is no ROS bag, and has no topics")


def test_what_a_bag_is(tmp_path: Path) -> None:
    (tmp_path / "a.bag").touch()
    (tmp_path / "f").mkdir()
    assert is_bag(tmp_path / "a.bag")
    assert not is_bag(tmp_path / "f")
    assert not is_bag(tmp_path / "none.mcap")
    assert split_topic(f"{tmp_path}/a.bag:/x/y") == (f"{tmp_path}/a.bag", "/x/y")
    assert split_topic("rtsp://x/y") == ("rtsp://x/y", None)
    assert split_topic(f"{tmp_path}/a.png:/x") == (f"{tmp_path}/a.png:/x", None)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (Message(PICTURES[0], "yuv422"), "image 1 of /camera/image: has the encoding 'yuv422'; convert it"),
        (Message(PICTURES[0], "bgr8", step=20), "image 1 of /camera/image: is damaged: 480 bytes, in rows of 20"),
        (Message(PICTURES[0][:1, :1], "bgr8"), "image 1 of /camera/image: has 1 x 1 pixels, needs"),
    ],
)
def test_an_image_that_cannot_be_read(message: Message, words: str, tmp_path: Path) -> None:
    """A traverse refuses it; whoever watches goes on."""
    path = bag(tmp_path / "b", [Message(PICTURES[0]), message._replace(second=1.0), Message(PICTURES[2], second=2.0)])
    refused(lambda: list(open_traverse(path).images()), words)
    first, bad, last = watched(path)
    assert isinstance(bad.image, InputError)
    assert words in str(bad.image)
    assert not isinstance(first.image, InputError)
    assert not isinstance(last.image, InputError)


def test_too_large_an_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path / "b", frames(PICTURES[:1]))
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PIXELS", "100")
    refused(lambda: open_traverse(path).load(0), "has 864 pixels, more than the 100 allowed")


def test_bags_without_images(tmp_path: Path) -> None:
    refused(lambda: open_traverse(text_bag(tmp_path / "t")), "t: holds no images (sensor_msgs", "its topics: /said")
    refused(lambda: open_traverse(bag(tmp_path / "e", [])), "holds no images", "its topics: none")


@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_one_line(kind: str, tmp_path: Path) -> None:
    """Cut anywhere, or with bytes of its head changed: it is refused, or what is given of a cut one was written."""
    made = bag(tmp_path / "b", frames(PICTURES), kind)
    (file,) = [made] if kind == "bag" else made.glob(f"*.{kind}")
    data, good = file.read_bytes(), {picture.tobytes() for picture in PICTURES}
    rng = np.random.default_rng(0)
    cuts = [data[: int(len(data) * share)] for share in (0.0, 0.001, 0.01, 0.3, 0.7, 0.99)]
    changed = []
    for _ in range(12):
        copy = bytearray(data)
        copy[int(rng.integers(min(len(data), 6000)))] ^= 0xFF
        changed.append(bytes(copy))
    refusals = []
    for number, bad in enumerate([*cuts, *changed, b"x" * 100]):
        path = tmp_path / f"{number}.{kind}"
        path.write_bytes(bad)
        try:
            images = {image.tobytes() for image in open_traverse(path).images()}
        except InputError as error:
            refusals.append(str(error))
            continue
        assert len(images) <= 6
        assert number >= len(cuts) or images <= good  # of a changed byte of a picture nobody knows
    assert len(refusals) >= 6
    assert all(text.startswith(f"{tmp_path}/") and "\n" not in text for text in refusals)
    assert {image.tobytes() for image in open_traverse(file).images()} == good


def test_a_bag_that_lists_more_images_than_it_holds_is_refused(tmp_path: Path) -> None:
    made = bag(tmp_path / "b", frames(PICTURES), "db3")
    with contextlib.closing(sqlite3.connect(next(made.glob("*.db3")))) as held:
        held.execute("DELETE FROM messages WHERE id = 2")
        held.commit()
    count = len(PICTURES)
    refused(lambda: open_traverse(made), f"({count - 1} images, {count} are listed); copy it again, or try ros2 bag")


def test_without_the_package_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path / "b", frames(PICTURES[:1]))
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    text = refused(lambda: next(bag_samples(path, None)), "ROS bags are read by the package rosbags")
    assert text.endswith("install it: pip install 'lava-vpr[ros]'")


def test_a_bag_knows_its_times_itself(tmp_path: Path) -> None:
    whole = open_traverse(bag(tmp_path / "b", frames(PICTURES)))
    refused(lambda: located(whole, 6, None, "2024-05-01T12:00:00"), "is when a video begins; give a CSV file")


PNG = image_bytes(".png", smooth_picture())


class Written:
    """A clock on whose pauses somebody writes files: each of ``acts`` in one pause, then nothing more happens."""

    def __init__(self, *acts: Callable[[], object]) -> None:
        self.acts, self.pauses = list(acts), 0

    def now(self) -> float:
        return self.pauses * PAUSE_S

    def pause(self, seconds: float) -> None:
        self.pauses += 1
        assert self.pauses < 1000
        if self.acts:
            self.acts.pop(0)()

    def watch(self, folder: Path, **options: Any) -> Iterator[tuple[str, float, Any]]:
        """The images that appear in ``folder``, by this clock."""
        return appearing(folder, now=self.now, pause=self.pause, **options)


def taken(folder: Path, count: int, clock: Written, *, existing: bool = True) -> list[tuple[str, bool]]:
    """Name of the first images that appear, and whether each was read."""
    found = islice(clock.watch(folder, existing=existing), count)
    return [(os.path.basename(path), not isinstance(image, InputError)) for path, _, image in found]


def wait() -> None:
    """Nothing is written."""


def test_images_come_by_natural_sort_and_then_as_they_appear(tmp_path: Path) -> None:
    for name in ("b10.png", "b9.png", ".hidden.png", "notes.txt", "folder.png/x.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(PNG)
    clock = Written(wait, wait, lambda: (tmp_path / "a1.png").write_bytes(PNG))
    assert taken(tmp_path, 3, clock) == [("b9.png", True), ("b10.png", True), ("a1.png", True)]


def test_what_was_there_can_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "old.png").write_bytes(PNG)
    clock = Written(lambda: (tmp_path / "new.png").write_bytes(PNG))
    assert taken(tmp_path, 1, clock, existing=False) == [("new.png", True)]


@pytest.mark.parametrize("pieces", [2, 5, 30])
def test_a_file_is_waited_for_until_it_is_whole(pieces: int, tmp_path: Path) -> None:
    """However slowly it is written, and those behind it stay behind it."""
    cuts = np.linspace(0, len(PNG), pieces + 1).astype(int)

    def append(start: int, end: int) -> None:
        with (tmp_path / "1.png").open("ab") as file:
            file.write(PNG[start:end])

    acts: list[Callable[[], object]] = []
    for start, end in pairwise(cuts):
        acts += [lambda start=start, end=end: append(start, end), wait, wait]
    acts.insert(1, lambda: (tmp_path / "2.png").write_bytes(PNG))
    assert taken(tmp_path, 2, Written(*acts)) == [("1.png", True), ("2.png", True)]


def test_a_file_that_stays_unreadable_is_given_up(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(PNG[:-30])
    (tmp_path / "2.png").write_bytes(PNG)
    clock = Written()
    found = clock.watch(tmp_path)
    _, _, why = next(found)
    assert isinstance(why, InputError)
    assert str(why).startswith(f"{tmp_path / '1.png'}: is damaged or cut short")
    assert str(why).endswith("(after 5 s without a change)")
    assert clock.now() >= PATIENCE_S
    assert not isinstance(next(found)[2], InputError)
    assert clock.now() < PATIENCE_S + 1


@pytest.mark.parametrize("to", ["1.png", "none.png"])
def test_a_link_that_leads_nowhere_is_left_out(to: str, tmp_path: Path) -> None:
    (tmp_path / "2.png").write_bytes(PNG)
    (tmp_path / "1.png").symlink_to(tmp_path / to)
    (_, _, why), (path, *_) = islice(Written().watch(tmp_path), 2)
    assert str(why) == f"{tmp_path / '1.png'}: is a link that leads to no file; correct or remove it"
    assert path == str(tmp_path / "2.png")


def test_a_file_that_never_rests_is_given_up(tmp_path: Path) -> None:
    (tmp_path / "2.png").write_bytes(PNG)
    acts = [partial((tmp_path / "1.png").write_bytes, bytes(size)) for size in range(990)]
    clock = Written(*acts)
    acts[0]()
    (_, _, why), (path, *_) = islice(clock.watch(tmp_path), 2)
    assert str(why) == f"{tmp_path / '1.png'}: is still being written after 30 s; write each image to its own file"
    assert path == str(tmp_path / "2.png")
    assert LONGEST_S <= clock.now() < LONGEST_S + 1


def test_a_file_that_goes_away_is_told(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(PNG[:50])
    _, _, why = next(Written(wait, (tmp_path / "1.png").unlink).watch(tmp_path))
    assert "went away before it was read" in str(why)


def test_a_name_is_taken_once_until_it_goes_away(tmp_path: Path) -> None:
    path = tmp_path / "1.png"
    clock = Written(wait, wait, path.unlink, wait, lambda: path.write_bytes(PNG))
    path.write_bytes(PNG)
    assert taken(tmp_path, 2, clock) == [("1.png", True)] * 2
    assert clock.pauses >= 5


def test_a_folder_that_goes_away_ends_it(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    found = Written(lambda: shutil.rmtree(tmp_path / "in")).watch(tmp_path / "in")
    refused(lambda: next(found), "in: cannot be watched (No such file or directory)")


def test_a_quiet_folder_is_not_listed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "1.png").write_bytes(PNG)
    os.utime(tmp_path, (1e9, 1e9))
    listed, scandir = [], os.scandir
    monkeypatch.setattr(room.os, "scandir", lambda path: listed.append(path) or scandir(path))
    clock = Written(*[wait] * 40, lambda: (tmp_path / "2.png").write_bytes(PNG))
    assert taken(tmp_path, 2, clock) == [("1.png", True), ("2.png", True)]
    assert len(listed) < 10
