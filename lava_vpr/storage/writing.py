"""Writing files: under a temporary name, flushed to the disk and renamed; what stood there keeps its permissions."""

from __future__ import annotations

import errno
import glob
import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from lava_vpr.interrupts import held


def read_only(path: Path) -> bool:
    """Whether the file or folder ``path`` is closed to writing: to us, or by its mode to everybody, the superuser too.

    Whoever took the permission away meant it, though a rename would not ask.
    """
    return not os.stat(path).st_mode & 0o222 or not os.access(path, os.W_OK)


def replaceable(path: Path) -> os.stat_result | None:
    """What stands at ``path``, a link followed, if a new file may replace it; None if nothing stands there.

    Raises:
        OSError: it is no regular file, or it is `read_only`.
    """
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is a folder, device or pipe, not a file", str(path))
    if read_only(path):
        raise PermissionError(errno.EACCES, "the file there is read-only", str(path))
    return status


def temporary_prefix(path: Path) -> str:
    """How the name of a temporary file or folder beside ``path`` begins; `tempfile` adds 8 characters and ``.tmp``.

    It holds the name of ``path``, or a hash of that where both together are longer than a name may be.
    """
    if len(os.fsencode(path.name)) + len("..") + 8 + len(".tmp") <= _NAME_BYTES:
        return f".{path.name}."
    return f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:32]}."


_NAME_BYTES = 255  # NAME_MAX of Linux; its common file systems have no less


def leftovers(path: Path) -> list[Path]:
    """Temporary files of writes to ``path`` that were killed, sorted."""
    path = Path(os.path.realpath(path))
    return sorted(path.parent.glob(glob.escape(temporary_prefix(path)) + "*.tmp"))


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then put it in place in one step.

    A file that stood there hands on its permissions, and its owner where that is allowed.

    Raises:
        OSError: the folder is missing or closed to us, the disk is full, or what stands there may not be replaced;
            ``path`` is as it was.
    """
    before = replaceable(path)
    path = Path(os.path.realpath(path))  # a link stays, the file that it names is replaced
    temporary: Path | None = None
    try:
        with held():
            handle, name = tempfile.mkstemp(prefix=temporary_prefix(path), suffix=".tmp", dir=path.parent)
            temporary = Path(name)
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
        if temporary is not None:
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
