"""Processes that cannot outlive who started them, and the shared memory they leave.

Linux does most of it (``prctl``); elsewhere the worker's own watch over its parent remains.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import time
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # <linux/prctl.h>
PAUSE = 0.005  # seconds between two looks at processes that are about to end

_prctl = getattr(ctypes.CDLL(None), "prctl", None) if sys.platform == "linux" else None
_forking = 0  # who forks; set just before each fork


def _call(option: int, value: int) -> None:
    """Call ``prctl`` where the system has it."""
    if _prctl is not None:
        _prctl(option, ctypes.c_ulong(value), ctypes.c_ulong(0), ctypes.c_ulong(0), ctypes.c_ulong(0))


def adopt_orphans() -> None:
    """Become the parent of descendants whose own parent ends, so that none is out of reach."""
    _call(PR_SET_CHILD_SUBREAPER, 1)


def _before_fork() -> None:
    """Note who is about to fork."""
    global _forking
    _forking = os.getpid()


def _after_fork() -> None:
    """Bind the forked process to its parent's end."""
    _call(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != _forking:  # it ended before the line above
        os.kill(os.getpid(), signal.SIGKILL)


def bind_forks() -> None:
    """Have processes forked from now on, from this one or its descendants, killed when the forking thread ends."""
    os.register_at_fork(before=_before_fork, after_in_child=_after_fork)


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


def signal_group(group: int, number: int) -> None:
    """Send a signal to every process of a group, if there is any; 0 is no group."""
    if group:  # to the system, 0 is our own
        _kill_group(group, number)


def end_descendants(group: int, limit: float = 5.0) -> bool:
    """Kill ``group`` and all children, adopted ones too, and reap them; False if there are some after ``limit`` s."""
    end = time.monotonic() + limit
    while time.monotonic() < end:
        _kill_group(group)
        for child in _children():
            with contextlib.suppress(OSError):
                os.kill(child, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG) != (0, 0):
                pass
        except ChildProcessError:
            return True
        time.sleep(PAUSE)
    return False


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


def end_group(group: int, limit: float = 5.0) -> bool:
    """Kill ``group``, none a child of ours; False if there are some after ``limit`` seconds. 0 is no group."""
    end = time.monotonic() + limit
    while group and _kill_group(group) and not _dead(group):
        if time.monotonic() > end:
            return False
        time.sleep(PAUSE)
    return True


def remove_shared_memory(name: str) -> None:
    """Remove the segments and semaphores whose names begin with ``name``, which nobody else's do."""
    for pattern in (f"{name}-*", f"sem.{name}-*"):
        for path in SHARED_MEMORY.glob(pattern):
            with contextlib.suppress(OSError):
                path.unlink()


def name_shared_memory(name: str) -> None:
    """Let the segments and semaphores that this process and its children make begin with ``name``.

    These can be told from others' then, and removed after a kill. This reaches into the standard library (Python
    3.10: `multiprocessing.shared_memory`, `multiprocessing.synchronize`), which has no setting for it.
    """
    from multiprocessing import process, shared_memory

    def make_filename() -> str:
        return f"/{name}-{os.urandom(4).hex()}"

    vars(shared_memory)["_make_filename"] = make_filename
    vars(process.current_process())["_config"]["semprefix"] = f"/{name}"
