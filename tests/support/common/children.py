"""Programs that tests start: with default signals, within a limit of time, and never for longer than their test.

Used by bench, benchmarks, cli, conftest, core, deploy, events, examples, experiments, images, isolated, project,
storage, support and training.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from lava_vpr.kernelcache import COMPILING_TEXT

LIMIT = 500.0  # seconds; reached only when something hangs, and before the limit of a test (pyproject.toml)
ASKED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals that ask a program to end. SIGPIPE, which Python ignores, is what `subprocess` itself gives back."""

COMPILING = f"note: {COMPILING_TEXT}\n"

STARTED: set[Child] = set()
"""Children that were not ended yet."""

_PR_SET_PDEATHSIG = 1
_prctl = getattr(ctypes.CDLL(None), "prctl", None)  # Linux


def heed() -> None:
    """Have all programs start with default signals, none of them blocked, whatever this process was started with.

    A background job of a script ignores SIGINT, ``nohup`` SIGHUP, and what is ignored stays so in programs that are
    started. What has a handler does not, so a signal that is ignored here gets one that does nothing.
    """
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    for number in ASKED:
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)


class Child(subprocess.Popen[Any]):
    """A program in a session of its own: killed with its group when its block or test ends, itself with the tests."""

    def __init__(self, command: Sequence[object], preexec_fn: Callable[[], None] | None = None, **options: Any) -> None:
        def prepare() -> None:
            if _prctl is not None:
                _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if preexec_fn is not None:
                preexec_fn()

        super().__init__(list(map(str, command)), start_new_session=True, preexec_fn=prepare, **options)
        STARTED.add(self)

    def wait(self, timeout: float | None = LIMIT) -> int:
        return super().wait(timeout)

    def communicate(self, input: Any = None, timeout: float | None = LIMIT) -> tuple[Any, Any]:
        """See there; without the note that depends on which kernels earlier tests have compiled."""
        out, err = super().communicate(input, timeout)
        note = COMPILING if isinstance(err, str) else COMPILING.encode()
        return out, err and err.replace(note, note[:0])

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> None:
        if kind is not None or self.poll() is None:  # after an error what it started may hold the pipes open
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
        super().__exit__(kind, *rest)
        STARTED.discard(self)

    def end(self) -> None:
        """Kill it and all of its group if it still runs, and close its pipes."""
        self.__exit__(None, None, None)


@contextmanager
def ended() -> Iterator[None]:
    """Whatever is started within the block ends with it."""
    before = set(STARTED)
    try:
        yield
    finally:
        for child in STARTED - before:
            child.end()


def run(
    command: Sequence[object],
    *,
    check: bool = False,
    capture_output: bool = False,
    input: Any = None,
    timeout: float = LIMIT,
    **options: Any,
) -> subprocess.CompletedProcess[Any]:
    """`subprocess.run` with a `Child`."""
    if capture_output:
        options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    if input is not None:
        options["stdin"] = subprocess.PIPE
    with Child(command, **options) as child:
        out, err = child.communicate(input, timeout)
    done = subprocess.CompletedProcess(child.args, child.returncode, out, err)
    if check:
        done.check_returncode()
    return done


def until(what: Callable[[], object], seconds: float = 60.0) -> bool:
    """Whether ``what`` is so at last, within some seconds."""
    end = time.monotonic() + seconds
    while not what():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def gone(pid: int) -> bool:
    """Whether a process has ended, as one that waits to be reaped has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except OSError:
        return True
