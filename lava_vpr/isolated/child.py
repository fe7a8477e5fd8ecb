"""A program run as a child that cannot outlive its time, nor its caller's interest: it is ended with all it started.

Memory of processes is reported as Linux reports it; None where the system does not.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lava_vpr.interrupts import held

LOOK = 0.05  # seconds between two looks at a program


class Ended(NamedTuple):
    """The exit code of a program that has ended, and what it wrote.

    Attributes:
        code: Its exit code; negative: the signal that ended it.
        out, err: What it wrote to stdout and stderr.
    """

    code: int
    out: str
    err: str

    @property
    def last(self) -> str:
        """The last line that it wrote to stderr, where programs say what went wrong; empty if it wrote none."""
        lines = [line.strip() for line in self.err.splitlines() if line.strip()]
        return lines[-1] if lines else ""


def run_child(
    words: Sequence[str | Path],
    *,
    seconds: float,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Run a program to its end; however this call ends, the program and all that it started have ended, too.

    Args:
        words: The program and its arguments.
        seconds: Time that it may take.
        folder: Its working directory (default: ours).
        environment: Its environment variables (default: ours).
    Raises:
        OSError: the program cannot be started.
        subprocess.TimeoutExpired: the program took too long and was stopped.
    """
    pipe = subprocess.PIPE
    with started(words, cwd=folder, env=environment, stdout=pipe, stderr=pipe, text=True, errors="replace") as child:
        out, err = _said(child, seconds)
    return Ended(child.returncode, out, err)


@contextlib.contextmanager
def started(words: Sequence[str | Path], grace: float = 0.0, **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A program in a session of its own, without input; at the end of the block it has ended, with all it started.

    Args:
        words: The program and its arguments.
        grace: Seconds that it has at the end of the block, see `end`.
        options: Further ones of `subprocess.Popen`.
    Raises:
        OSError: the program cannot be started.
    """
    child: subprocess.Popen[Any] | None = None
    try:
        with held():  # what is started is known
            child = subprocess.Popen(
                [str(word) for word in words], stdin=subprocess.DEVNULL, start_new_session=True, **options
            )
        yield child
    finally:
        if child is not None:
            with child:
                end(child, grace)


def waited(child: subprocess.Popen[Any], seconds: float) -> int | None:
    """The exit code of ``child`` if it ends within so many ``seconds``, a fraction of one; None if it does not.

    Signals are held back meanwhile. One that stops `subprocess` between taking its lock and minding it leaves the lock
    taken, and whoever ends the child then waits for ever.
    """
    with held(), contextlib.suppress(subprocess.TimeoutExpired):
        child.wait(seconds)
    return child.returncode


def _said(child: subprocess.Popen[Any], seconds: float) -> tuple[Any, Any]:
    """What ``child`` writes to its streams until its end.

    Raises:
        subprocess.TimeoutExpired: it takes longer than so many ``seconds``.
    """
    over = time.monotonic() + seconds
    while True:
        try:
            with held():  # as in `waited`
                return child.communicate(timeout=LOOK)
        except subprocess.TimeoutExpired:
            if time.monotonic() > over:
                raise


def end(child: subprocess.Popen[bytes] | subprocess.Popen[str], grace: float = 0.0) -> None:
    """End a program that leads a session of its own, and whatever it started there.

    Args:
        child: The program, started with ``start_new_session``.
        grace: Seconds that it has to end in good order, once asked to; 0: it is not asked.
    """
    with held():
        if grace > 0 and child.poll() is None:
            child.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(grace)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()


def environment_without_python() -> dict[str, str]:
    """Our environment without the variables of Python, for the interpreter of another environment."""
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


PROC = Path("/proc")
_KIBI = 1024


def _kibibytes(path: Path, name: str) -> int | None:
    """The value of the line ``name`` of a file of /proc, which are all in units of 1024 bytes."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in path.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1])
    return None


def own_peak() -> int | None:
    """Bytes that this process held at most since it began.

    ``VmHWM`` belongs to the program that runs; the maximum that `resource.getrusage` tells would begin with what the
    process that started it held.
    """
    held = _kibibytes(PROC / "self" / "status", "VmHWM")
    return None if held is None else held * _KIBI


def family() -> list[int]:
    """This process and all below it, by id."""
    below: dict[int, list[int]] = {}
    for path in PROC.glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            # The name, in brackets, may hold anything; after it come state and parent.
            parent = int(path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[1])
            below.setdefault(parent, []).append(int(path.parent.name))
    processes = [os.getpid()]
    for process in processes:  # grows while it is gone through
        processes += below.get(process, [])
    return processes


def held_by_family() -> int | None:
    """Bytes that this process and all below it hold now; pages that several of them share are counted once."""
    held = [_kibibytes(PROC / str(process) / "smaps_rollup", "Pss") for process in family()]
    known = [size for size in held if size is not None]
    return sum(known) * _KIBI if known else None
