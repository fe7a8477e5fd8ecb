"""A folder that is being written: images are taken once they are whole, in the order in which they appear."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from support.common.imagefiles import image_bytes, refused, smooth_picture

from lava_vpr.errors import InputError
from lava_vpr.images import appearing as room
from lava_vpr.images.appearing import PATIENCE_S, PAUSE_S, Clock, appearing

PNG = image_bytes(".png", smooth_picture())


class Written(Clock):
    """A clock on whose pauses somebody writes files: each of ``acts`` in one pause, then nothing more happens."""

    def __init__(self, *acts: Callable[[], object]) -> None:
        self.acts, self.pauses = list(acts), 0

    def now(self) -> float:
        return self.pauses * PAUSE_S

    def pause(self) -> None:
        self.pauses += 1
        assert self.pauses < 1000
        if self.acts:
            self.acts.pop(0)()


def taken(folder: Path, count: int, clock: Clock, *, existing: bool = True) -> list[tuple[str, bool]]:
    """Name of the first images that appear, and whether each was read."""
    found = islice(appearing(folder, existing=existing, clock=clock), count)
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
    found = appearing(tmp_path, clock=clock)
    _, _, why = next(found)
    assert isinstance(why, InputError)
    assert str(why).startswith(f"{tmp_path / '1.png'}: is damaged or cut short")
    assert str(why).endswith("(after 5 s without a change)")
    assert clock.now() >= PATIENCE_S
    assert not isinstance(next(found)[2], InputError)
    assert clock.now() < PATIENCE_S + 1


def test_a_file_that_goes_away_is_told(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(PNG[:50])
    _, _, why = next(appearing(tmp_path, clock=Written(wait, (tmp_path / "1.png").unlink)))
    assert "went away before it was read" in str(why)


def test_a_name_is_taken_once_until_it_goes_away(tmp_path: Path) -> None:
    path = tmp_path / "1.png"
    clock = Written(wait, wait, path.unlink, wait, lambda: path.write_bytes(PNG))
    path.write_bytes(PNG)
    assert taken(tmp_path, 2, clock) == [("1.png", True)] * 2
    assert clock.pauses >= 5


def test_a_folder_that_goes_away_ends_it(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    found = appearing(tmp_path / "in", clock=Written(lambda: shutil.rmtree(tmp_path / "in")))
    refused(lambda: next(found), "in: cannot be watched (No such file or directory)")


def test_a_quiet_folder_is_not_listed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "1.png").write_bytes(PNG)
    os.utime(tmp_path, (1e9, 1e9))
    listed, scandir = [], os.scandir
    monkeypatch.setattr(room.os, "scandir", lambda path: listed.append(path) or scandir(path))
    clock = Written(*[wait] * 40, lambda: (tmp_path / "2.png").write_bytes(PNG))
    assert taken(tmp_path, 2, clock) == [("1.png", True), ("2.png", True)]
    assert len(listed) < 10
