"""Writing files: under a temporary name, flushed to the disk and renamed; what stood there keeps its permissions."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO


def replaceable(path: Path) -> os.stat_result | None:
    """What stands at ``path``, a link followed, if a new file may replace it; None if nothing stands there.

    Raises:
        OSError: it is no regular file, or it is closed to writing: whoever took the permission away meant it, though a
            rename would not ask.
    """
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is a folder, device or pipe, not a file", str(path))
    if not status.st_mode & 0o222 or not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, "the file there is read-only", str(path))
    return status


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then put it in place in one step.

    A file that stood there hands on its permissions, and its owner where that is allowed.

    Raises:
        OSError: the folder is missing or closed to us, the disk is full, or what stands there may not be replaced;
            ``path`` is as it was.
    """
    path = Path(os.path.realpath(path))  # a link stays, the file that it names is replaced
    before = replaceable(path)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
            file.flush()
            if before is None:
                umask = os.umask(0)
                os.umask(umask)
                os.fchmod(file.fileno(), 0o666 & ~umask)
            else:
                _hand_on(before, file.fileno())
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _hand_on(before: os.stat_result, handle: int) -> None:
    """Give the open file the owner, as far as we may, and the permissions of the file that it replaces."""
    mode = stat.S_IMODE(before.st_mode)
    now = os.fstat(handle)
    if (now.st_uid, now.st_gid) != (before.st_uid, before.st_gid):
        try:
            os.fchown(handle, before.st_uid, before.st_gid)
        except OSError:
            mode &= 0o777  # set-id bits are for their owner alone
    os.fchmod(handle, mode)
