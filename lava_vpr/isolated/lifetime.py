"""Work in a process that outlives neither its caller nor its folder, and the shared memory that it leaves.

The keeper, the process that the caller starts, forks the one that works and ends and reaps everything below it. Linux
does most of it (``prctl``); elsewhere the keeper's own watch over its caller remains.

A bundle for Loihi 2 holds a copy of this file, which needs the standard library alone.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

LOOK = 0.02  # seconds between two looks of the keeper
SHARED_MEMORY = Path("/dev/shm")
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # <linux/prctl.h>
PAUSE = 0.005  # seconds between two looks at processes that are about to end
LONGEST = 5.0  # seconds in which the system ends what is killed

_prctl = getattr(ctypes.CDLL(None), "prctl", None) if sys.platform == "linux" else None
_forking = 0  # who forks; set just before each fork


def _call(option: int, value: int) -> None:
    """Call ``prctl`` where the system has it."""
    if _prctl is not None:
        _prctl(option, ctypes.c_ulong(value), ctypes.c_ulong(0), ctypes.c_ulong(0), ctypes.c_ulong(0))


def _before_fork() -> None:
    """Note who is about to fork."""
    global _forking
    _forking = os.getpid()


def _after_fork() -> None:
    """Bind the forked process to its parent's end."""
    _call(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != _forking:  # it ended before the line above
        os.kill(os.getpid(), signal.SIGKILL)


def _children() -> list[int]:
    """Children of this process, adopted ones too; empty where the system does not tell."""
    pid = os.getpid()
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]
    except OSError:
        return []


def _kill_group(group: int, number: int = signal.SIGKILL) -> bool:
    """Signal a process group; False if there is nobody left in it."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    except PermissionError:  # macOS says so of a group of zombies
        pass
    return True


def group_of(folder: Path) -> int:
    """The process group of the work in ``folder``, or 0 if it has not begun."""
    try:
        return int((folder / "group").read_text(encoding="ascii") or 0)
    except OSError:
        return 0


def signal_work(folder: Path, number: int) -> None:
    """Send a signal to every process of the work in ``folder``, if it has begun."""
    group = group_of(folder)
    if group:  # to the system, 0 is our own
        _kill_group(group, number)


def _end_descendants(group: int, number: int, limit: float) -> None:
    """Signal ``group`` and all children, adopted ones too, and reap them, for at most ``limit`` seconds."""
    end = time.monotonic() + limit
    while time.monotonic() < end:
        _kill_group(group, number)
        for child in _children():
            with contextlib.suppress(OSError):
                os.kill(child, number)
        try:
            while os.waitpid(-1, os.WNOHANG) != (0, 0):
                pass
        except ChildProcessError:
            return
        time.sleep(PAUSE)


def _dead(group: int) -> bool:
    """Whether all that is left of ``group`` waits to be reaped, which init may do late; False where nobody tells."""
    readable = False
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, its_group = path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[:3]
            readable = True
            if int(its_group) == group and state not in "ZX":
                return False
    return readable


def clear(folder: Path, code: int) -> None:
    """End what a keeper that has ended with ``code`` has left of the work in ``folder``, if it was killed."""
    group, end = group_of(folder) if code < 0 else 0, time.monotonic() + LONGEST
    while group and _kill_group(group) and not _dead(group) and time.monotonic() < end:
        time.sleep(PAUSE)
    _remove_shared_memory(folder.name)


def _remove_shared_memory(name: str) -> None:
    """Remove the segments and semaphores whose names begin with ``name``, which nobody else's do."""
    for pattern in (f"{name}-*", f"sem.{name}-*"):
        for path in SHARED_MEMORY.glob(pattern):
            with contextlib.suppress(OSError):
                path.unlink()


def _claim(folder: Path) -> None:
    """Let the shared memory, semaphores, sockets and temporary files that this process and its children make bear the
    name of ``folder``, or stand in it.

    They can be told from others' then, and removed after a kill. This reaches into the standard library (Python 3.10:
    `multiprocessing.shared_memory`, `multiprocessing.synchronize`), which has no setting for it.
    """
    from multiprocessing import process, shared_memory  # a caller needs neither

    def make_filename() -> str:
        return f"/{folder.name}-{os.urandom(4).hex()}"

    vars(shared_memory)["_make_filename"] = make_filename
    tempfile.tempdir = str(folder)
    vars(process.current_process())["_config"].update(semprefix=f"/{folder.name}", tempdir=str(folder))


def _fork(folder: Path, work: Callable[[], int]) -> int:
    """The id of a process that works, in a group of its own.

    Whatever it forks, and it itself, is killed when the thread that forked it ends.
    """
    os.register_at_fork(before=_before_fork, after_in_child=_after_fork)
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.setpgid(0, 0)
            _claim(folder)
            code = work()
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)  # Lava's own ending can wait for ever
    return pid


def keep(folder: Path, caller: int, work: Callable[[], int], grace: float = 0.0) -> int:
    """Fork a process that works, see it end with all below it, and return its exit code, 128 + n after signal n.

    It ends when ``work`` returns its exit code, when this process gets SIGTERM, when the process ``caller``, its
    parent, is gone, or when ``folder`` is.

    Args:
        folder: The folder of the work, whose name nobody else's has.
        caller: Process id.
        work: What is to be done. It runs in a process of its own, whose group stands in ``folder``/group.
        grace: Seconds between SIGTERM and SIGKILL for what the work leaves running.
    """
    signals: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        signals.append(number)

    signal.signal(signal.SIGTERM, stop)
    _call(PR_SET_CHILD_SUBREAPER, 1)  # descendants whose own parent ends become children: none is out of reach
    pid = _fork(folder, work)
    try:
        (folder / "group").write_text(str(pid), encoding="ascii")
        code = None
        while code is None and not signals and os.getppid() == caller and folder.exists():
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                code = os.waitstatus_to_exitcode(status)
            else:
                time.sleep(LOOK)
    finally:
        _end_descendants(pid, signal.SIGTERM, grace)
        _end_descendants(pid, signal.SIGKILL, LONGEST)
        _remove_shared_memory(folder.name)
        if os.getppid() != caller:
            shutil.rmtree(folder, ignore_errors=True)
    if code is None:
        return 128 + signal.SIGTERM
    return code if code >= 0 else 128 - code
