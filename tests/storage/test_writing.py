"""Files are replaced whole or not at all, and keep the permissions that they had."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import stat
import tempfile
from pathlib import Path
from typing import Any, BinaryIO

import pytest

from lava_vpr.errors import ModelFileError
from lava_vpr.storage.writing import leftovers, only_one, write_atomically


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_new_file_has_the_mode_of_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "a", lambda file: file.write(b"1"))
    finally:
        os.umask(before)
    assert mode(tmp_path / "a") == 0o640


def test_all_is_handed_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda handle: sizes.append(os.fstat(handle).st_size))
    write_atomically(tmp_path / "a", lambda file: file.write(b"new"))
    assert sizes == [3]


@pytest.mark.parametrize("bits", [0o600, 0o640, 0o664, 0o755])
def test_a_replaced_file_keeps_its_mode(tmp_path: Path, bits: int) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(bits)
    write_atomically(path, lambda file: file.write(b"new"))
    assert path.read_bytes() == b"new"
    assert mode(path) == bits


def test_a_read_only_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(0o444)
    with pytest.raises(PermissionError, match="read-only"):
        write_atomically(path, lambda file: file.write(b"new"))
    assert path.read_bytes() == b"old"
    assert mode(path) == 0o444


def test_a_link_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"old")
    (tmp_path / "link").symlink_to("file")
    write_atomically(tmp_path / "link", lambda file: file.write(b"new"))
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"new"


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="not a file"):
        write_atomically(tmp_path / "pipe", lambda file: file.write(b"new"))
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def fail(file: BinaryIO) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_atomically(path, fail)
    assert [(entry.name, entry.read_bytes()) for entry in tmp_path.iterdir()] == [("a", b"old")]


@pytest.mark.parametrize("name", ["n" * 255, "é" * 127, "n" * 242, "n" * 241])
def test_a_name_may_be_as_long_as_the_file_system_takes_it(tmp_path: Path, name: str) -> None:
    write_atomically(tmp_path / name, lambda file: file.write(b"new"))
    assert [(entry.name, entry.read_bytes()) for entry in tmp_path.iterdir()] == [(name, b"new")]


def test_what_killed_writes_leave_is_found(tmp_path: Path) -> None:
    for name in ("a", "n" * 255):
        (tmp_path / name).write_bytes(b"old")
        left: list[Path] = []

        def killed(file: BinaryIO, left: list[Path] = left) -> None:
            left.extend(entry for entry in tmp_path.iterdir() if entry.suffix == ".tmp")
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            write_atomically(tmp_path / name, killed)
        left[0].touch()
        assert leftovers(tmp_path / name) == left
        left[0].unlink()
    (tmp_path / ".a.other").touch()
    assert leftovers(tmp_path / "a") == []


@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_leaves_no_temporary_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = tempfile.mkstemp

    def interrupted(**options: Any) -> tuple[int, str]:
        result = made(**options)
        signal.raise_signal(signal.SIGINT)
        return result

    monkeypatch.setattr(tempfile, "mkstemp", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "a", lambda file: file.write(b"new"))
    assert list(tmp_path.iterdir()) == []


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
