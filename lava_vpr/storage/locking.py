"""A lock beside a file: two processes that write the same file would lose each other's work."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lava_vpr.errors import ModelFileError
from lava_vpr.interrupts import held
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import temporary_prefix


@contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Hold ``path`` for this process, by a lock on an empty hidden file beside it that is removed at the end.

    The lock ends with the process, however that ends: a file that a killed process left locks nobody out, and the next
    holder removes it.

    Raises:
        ModelFileError: another process holds it; or something else stands where the lock should, and is left alone.
    """
    target = Path(os.path.realpath(path))
    lock = target.with_name(temporary_prefix(target) + "lock")
    handle: int | None = None
    try:
        with held():  # what was made is known
            handle = _locked(path, lock)
        yield
    finally:
        if handle is not None:
            with held():
                if _names(lock, handle):
                    lock.unlink(missing_ok=True)
                os.close(handle)


def _locked(path: Path, lock: Path) -> int:
    """`_held`, with errors that speak of ``path``."""
    try:
        return _held(lock)
    except BlockingIOError:
        raise ModelFileError(f"{shown(path)}: another training is writing it; wait, or choose another name") from None
    except OSError as error:
        remedy = "free space" if error.errno == errno.ENOSPC else "remove that"
        raise ModelFileError(
            f"{shown(path)}: cannot be locked ({shown(lock.name)} beside it: {error.strerror}); {remedy} or choose "
            "another place"
        ) from None


def _held(lock: Path) -> int:
    """An open handle of the file ``lock``, locked, while the name is that file's.

    Raises:
        OSError: see `only_one`.
    """
    while True:
        handle = _opened(lock)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _names(lock, handle):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # who held it removed the file after we had opened it: the lock is on no name any more


def _opened(lock: Path) -> int:
    """An open handle of the file ``lock``, made if there is none; nothing in it changes.

    A link is not followed and a pipe not waited for; what holds data, or is no file, is no lock of ours.
    """
    try:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.EEXIST, "a symbolic link, not a lock") from None
        raise
    status = os.fstat(handle)
    if stat.S_ISREG(status.st_mode) and not status.st_size:
        return handle
    os.close(handle)
    raise OSError(errno.EEXIST, "data, not a lock" if stat.S_ISREG(status.st_mode) else "not a file")


def _names(lock: Path, handle: int) -> bool:
    """Whether the name ``lock`` is that of the open file."""
    try:
        return os.path.samestat(os.stat(lock, follow_symlinks=False), os.fstat(handle))
    except OSError:
        return False
