"""Writing files: under a temporary name, flushed to the disk and renamed; what stood there keeps its permissions.

A lock beside a file keeps two processes from writing it at once, which would lose the work of one. Temporary folders
are gone when they have served, also after Ctrl-C, SIGTERM and SIGHUP.
"""

from __future__ import annotations

import errno
import fcntl
import glob
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from lava_vpr.errors import InputError, LavaRunError, LavaVprError, ModelFileError, shown
from lava_vpr.interrupts import held, standing


def read_only(path: Path) -> bool:
    """Whether the file or folder ``path`` is closed to writing: to us, or by its mode to everybody, the superuser too.

    Whoever took the permission away meant it, though a rename would not ask.
    """
    return not os.stat(path).st_mode & 0o222 or not os.access(path, os.W_OK)


def replaceable(path: Path) -> os.stat_result | None:
    """The file at ``path``, a link followed, if a new file may replace it; None if there is none.

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

    A file that is replaced keeps its permissions, and its owner where that is allowed.

    Raises:
        OSError: the folder is missing or closed to us, the disk is full, or the file there may not be replaced;
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


@contextmanager
def written(path: Path, what: str = "", kind: type[LavaVprError] = InputError) -> Iterator[None]:
    """Say in one line why ``path`` cannot be written, where something of it is.

    Args:
        path: The file or folder.
        what: What it is to hold, as in ``"the model "``.
        kind: The error that says so.
    """
    try:
        yield
    except OSError as error:
        raise kind(
            f"{shown(path)}: {what}cannot be written ({error.strerror}); free space or choose another place"
        ) from None


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
    """`_held`, with errors that name ``path``."""
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


PREFIX = "lava-vpr-"


@contextmanager
def _folder(**where: Any) -> Iterator[Path]:
    """A new folder, ours alone, that is removed with all it holds at the end of the block.

    Only SIGKILL and a loss of power leave it behind.

    Args:
        where: As `tempfile.mkdtemp` takes it.
    Raises:
        OSError: there is no place for it.
    """
    folder: Path | None = None
    try:
        with held():
            folder = Path(tempfile.mkdtemp(**where))
            standing.add(folder)
        yield folder
    finally:
        if folder is not None:
            with held():
                shutil.rmtree(folder, ignore_errors=True)
                if not folder.exists():  # nobody was still writing there
                    standing.discard(folder)


def folder_beside(path: Path) -> AbstractContextManager[Path]:
    """A temporary folder beside ``path``, on the same disk.

    Raises:
        OSError: there is no place for it.
    """
    return _folder(prefix=temporary_prefix(path), suffix=".tmp", dir=path.absolute().parent)


@contextmanager
def new_folder(path: Path, what: str) -> Iterator[Path]:
    """A folder that stands at ``path`` once all in it is written, and not at all if that fails.

    Args:
        path: Where it shall stand.
        what: What it is, for messages, as in ``"a bag"``.
    Yields:
        Where to make it.
    Raises:
        InputError: the path exists, or it cannot be written.
    """
    if os.path.lexists(path):
        raise InputError(f"{shown(path)}: exists, and {what} replaces nothing; remove it or name another folder")
    with ExitStack() as last:
        with written(path):
            folder = last.enter_context(folder_beside(path)) / path.name
        yield folder
        with written(path):
            folder.rename(path)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A temporary folder where the system has them.

    Raises:
        LavaRunError: there is no place for it.
    """
    with ExitStack() as last:
        try:
            folder = last.enter_context(_folder(prefix=PREFIX))
        except OSError as error:
            raise LavaRunError(
                f"no temporary folder can be made ({error}); set TMPDIR to one that can be written"
            ) from error
        yield folder
