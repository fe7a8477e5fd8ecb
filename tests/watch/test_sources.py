"""Videos, cameras, standard input and lists as sources of images."""

from __future__ import annotations

import gc
import io
import itertools
import sys
import threading
import tracemalloc
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.common.imagefiles import refused, video, watched, write_images

from lava_vpr import Localizer
from lava_vpr.errors import InputError
from lava_vpr.images import videos
from lava_vpr.images.imagefiles import read_image
from lava_vpr.images.videos import CAMERA
from lava_vpr.readers import Frame
from lava_vpr.traverse import open_traverse
from lava_vpr.watch.watching import watch


@pytest.mark.parametrize("every", [0.1, 0.5, 1.0])
def test_a_video_gives_the_frames_that_a_traverse_has(every: float, tmp_path: Path) -> None:
    path = video(tmp_path / "v.avi", 24, marked=True)
    whole = open_traverse(path, every=every)
    seen = list(watched(path, every=every))
    assert [one.name for one in seen] == list(whole.names)
    assert whole.stamps is not None
    assert [one.stamp for one in seen] == whole.stamps.tolist()
    for one, image in zip(seen, whole.images(), strict=True):
        np.testing.assert_array_equal(one.image, image)


def test_paths_on_standard_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_images(tmp_path / "in", 2)
    named = folder / "20240501_120000.png"
    (folder / "img1.png").rename(named)
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{folder / 'img0.png'}\r\n\n{folder / 'none.png'}\n{named}"))
    first, missing, last = watched("-")
    assert (first.name, first.stamp) == ("img0.png", None)
    assert isinstance(missing.image, InputError)
    assert (last.name, last.stamp) == ("20240501_120000.png", 1714564800.0)


def test_a_line_without_end_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a file of zeros has one; it is read in pieces, none of which is kept."""
    (sound,) = write_images(tmp_path / "in", 1).iterdir()
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{'x' * 8_000_000}\n{sound}\n{'x' * 99_999}"))
    tracemalloc.start()
    try:
        first, second, third = watched("-")
        held = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert "File name too long" in str(first.image)
    assert second.name == sound.name
    assert "File name too long" in str(third.image)
    assert held < 4_000_000


def test_a_folder_tells_when_its_images_were_written(tmp_path: Path) -> None:
    folder = write_images(tmp_path / "in", 1)
    (one,) = itertools.islice(watched(folder), 1)
    assert one.stamp == (folder / "img0.png").stat().st_mtime


def test_lists_and_single_images(tmp_path: Path) -> None:
    folder = write_images(tmp_path / "in", 3)
    (tmp_path / "l.txt").write_text("in/img2.png\nin/img0.png\n")
    assert [one.name for one in watched(tmp_path / "l.txt")] == ["img2.png", "img0.png"]
    assert [one.name for one in watched(folder / "img1.png")] == ["img1.png"]


@pytest.mark.parametrize("source", ["", "a\0b", "none", "pyproject.toml", "camera:x", "none.mp4"])
def test_what_is_no_source_is_refused_at_once(source: str) -> None:
    refused(lambda: watched(source))


@pytest.mark.parametrize("every", [0.0, -1.0, float("nan"), float("inf")])
def test_times_between_images_that_are_none(every: float, tmp_path: Path) -> None:
    refused(lambda: watched(str(tmp_path), every=every), "--every is")


class Camera:
    """What OpenCV's capture would be: a frame every eighth of a second of a clock of its own, six in all."""

    def __init__(self, frames: int = 6, opened: bool = True) -> None:
        self.clock, self.frames, self.opened, self.released = 1.7e9, frames, opened, 0

    def __call__(self, *what: object) -> Camera:
        return self

    def isOpened(self) -> bool:
        return self.opened

    def set(self, *what: object) -> bool:
        return True

    def grab(self) -> bool:
        self.clock += 0.125
        self.frames -= 1
        return self.frames >= 0

    def retrieve(self) -> tuple[bool, Any]:
        return True, np.full((4, 4, 3), self.frames, np.uint8)

    def release(self) -> None:
        self.released += 1


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> Camera:
    """A camera is there."""
    made = Camera()
    monkeypatch.setattr(videos.os.path, "exists", lambda path: True)
    monkeypatch.setattr(videos.cv2, "VideoCapture", made)
    monkeypatch.setattr(videos.time, "time", lambda: made.clock)
    return made


@pytest.mark.parametrize(("every", "wanted"), [(0.001, [5, 4, 3, 2, 1, 0]), (0.25, [5, 3, 1]), (9.0, [5])])
@pytest.mark.parametrize("name", ["camera:0", "/dev/video7", "rtsp://user:secret@there/x"])
def test_a_camera_gives_an_image_every_so_often(name: str, every: float, wanted: list[int], plugged: Camera) -> None:
    seen: list[Frame] = []
    source = watched(name, every=every)
    with pytest.raises(InputError, match="gives no further image") as caught:
        seen.extend(source)
    assert "secret" not in str(caught.value)
    assert [int(np.asarray(one.image).max()) for one in seen] == wanted
    assert [one.name for one in seen] == [f"frame {number:06d}" for number in range(len(wanted))]
    assert all(one.stamp is not None and one.stamp > 1.7e9 for one in seen)
    assert plugged.released == 1


def test_cameras_that_give_nothing(plugged: Camera) -> None:
    plugged.frames = 0
    refused(lambda: next(watched("camera:0")), "camera:0: gives no image; check")
    plugged.opened = False
    refused(lambda: next(watched("camera:0")), "camera:0: cannot be opened; check")


def test_no_camera_is_one_line() -> None:
    refused(lambda: next(watched("camera:993")), "camera:993: there is no camera /dev/video993; plug it in")
    refused(lambda: next(watched("rtsp://a:b@127.0.0.1:9/x")), "rtsp://***@127.0.0.1:9/x: cannot be opened")


@pytest.mark.parametrize("source", ["camera:0", "-", "events:34x26"])
def test_what_is_live_is_no_traverse(source: str) -> None:
    refused(lambda: open_traverse(source), "which can only be watched; use lava-vpr watch")


def test_what_a_camera_is() -> None:
    assert all(map(CAMERA.fullmatch, ("camera:0", "/dev/video12", "rtsp://a", "rtsps://a")))
    assert not any(map(CAMERA.fullmatch, ("camera:", "camera:0/", "/dev/video", "camera.mp4", "http://a", "-")))
    assert cv2.CAP_V4L2


@pytest.fixture
def localizer(made: Path) -> Localizer:
    """One that knows the synthetic route."""
    return Localizer(made / "m.lvpr")


@pytest.fixture(scope="module")
def pictures(made: Path) -> list[np.ndarray]:
    """The queries of the route."""
    return [read_image(path) for path in sorted((made / "query").iterdir())]


def endless(images: list[np.ndarray]) -> Iterator[Frame]:
    """The images again and again, one in five of them unreadable."""
    number = 0
    while True:
        image = InputError("no") if number % 5 == 4 else images[number % len(images)]
        yield Frame(f"image {number}", float(number), image)
        number += 1


@pytest.mark.slow
def test_memory_is_steady_and_no_thread_is_started(localizer: Localizer, pictures: list[np.ndarray]) -> None:
    refused: list[int] = []
    answers = watch(localizer, endless(pictures), lambda index, why: refused.append(index))
    held, alive = [], threading.active_count()
    tracemalloc.start()
    try:
        for _ in range(3):
            for _ in islice(answers, 200):
                pass
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0] - 60 * len(refused))
    finally:
        tracemalloc.stop()
    assert held[2] - held[1] < 40_000  # an image held would take 9,216 bytes, 200 times
    assert threading.active_count() == alive
    assert refused[:2] == [4, 9]


def test_an_image_that_cannot_be_answered_is_left_out(localizer: Localizer, pictures: list[np.ndarray]) -> None:
    bad = np.zeros((4, 4), np.float32)
    refused: list[tuple[int, str]] = []
    source = [Frame("a", None, pictures[0]), Frame("b", None, bad), Frame("c", None, pictures[1])]
    found = list(watch(localizer, source, lambda index, why: refused.append((index, str(why)))))
    assert [one.index for one in found] == [0, 2]
    assert refused[0][0] == 1
    assert "float32" in refused[0][1]
