"""One process at a time holds a file, and a lock leaves nothing behind."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

import pytest

from lava_vpr.errors import ModelFileError
from lava_vpr.storage.writing import only_one


def test_a_file_is_held_by_one_only(tmp_path: Path) -> None:
    with only_one(tmp_path / "m"):
        assert (tmp_path / ".m.lock").read_bytes() == b""
        with pytest.raises(ModelFileError, match="m: another training is writing it; wait"), only_one(tmp_path / "m"):
            pass
        assert (tmp_path / ".m.lock").exists()
        with only_one(tmp_path / "n"):
            pass
    assert list(tmp_path.iterdir()) == []


def test_a_link_and_the_file_that_it_names_are_one(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "m").symlink_to("deep/m")
    with only_one(tmp_path / "m"), pytest.raises(ModelFileError, match="another"), only_one(tmp_path / "deep" / "m"):
        pass


def test_a_lock_on_a_file_that_was_removed_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between our opening and our locking, who held the file removes it, and a third makes another and holds that."""
    flock, thirds = fcntl.flock, []

    def late(handle: int, how: int) -> None:
        if not thirds:
            (tmp_path / ".m.lock").unlink()
            thirds.append(os.open(tmp_path / ".m.lock", os.O_CREAT | os.O_RDWR))
            flock(thirds[0], fcntl.LOCK_EX)
        flock(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(ModelFileError, match="another training"), only_one(tmp_path / "m"):
        pass
    assert (tmp_path / ".m.lock").exists()
    os.close(thirds[0])


def test_a_lock_that_was_removed_and_made_by_others_is_not_ours_to_remove(tmp_path: Path) -> None:
    with only_one(tmp_path / "m"):
        (tmp_path / ".m.lock").unlink()
        (tmp_path / ".m.lock").write_bytes(b"")
    assert (tmp_path / ".m.lock").exists()


def test_a_full_disk_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "open", full)
    message = (
        r"^\S+/m: cannot be locked \(.m.lock beside it: No space left on device\); free space or choose another place$"
    )
    with pytest.raises(ModelFileError, match=message), only_one(tmp_path / "m"):
        pass
