"""The first failure of a run of Lava, noted by the process where it happens, and awaited by the caller.

Lava catches what a model raises, logs it below its own log level and waits for ever. It also waits for ever for a
process that was killed.

A bundle for Loihi 2 holds a copy of this file, which needs the standard library alone.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from multiprocessing import process as mp_process
from pathlib import Path
from typing import Any

STACKS = signal.SIGUSR1  # asks a process where it stands
WATCH = 0.05  # seconds between two looks at Lava's processes
NOTING = 5.0  # seconds in which a failure is noted, on the slowest of machines
PAUSE = 0.01  # seconds between two looks whether it is


def _code_location(error: BaseException) -> str:
    """Where an exception came from: its last frame outside installed packages and the standard library."""
    frames = [(Path(f.filename), f.lineno, f.name) for f in traceback.extract_tb(error.__traceback__)]
    ours = [f for f in frames if not {"site-packages", f"python3.{sys.version_info.minor}"} & set(f[0].parts)]
    if not frames:
        return ""
    path, line, function = (ours or frames)[-1]
    return f"{path.name}:{line} in {function}"


def record(folder: Path, values: dict[str, Any]) -> None:
    """Note a failure, unless one has been noted before it.

    One that another process is noting just now is waited for: the end of this one may be the end of that.
    """
    with contextlib.suppress(OSError):  # the folder is gone: nobody waits for it
        try:
            os.close(os.open(folder / "error.lock", os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        except FileExistsError:
            if _noted(folder):
                return
        part = folder / f"error-{os.getpid()}-{threading.get_ident()}.part"
        part.write_text(json.dumps(values), encoding="utf-8")
        part.replace(folder / "error.json")


def _noted(folder: Path) -> bool:
    """Whether the failure is noted that another process or thread began to note; False if that was killed over it."""
    end = time.monotonic() + NOTING
    while not (folder / "error.json").exists():
        if time.monotonic() > end:
            return False
        time.sleep(PAUSE)
    return True


def record_exception(folder: Path, error: BaseException, where: str = "") -> None:
    """Note an exception of the model, or other part, called ``where``; its traceback goes to the log as well."""
    full = "".join(traceback.format_exception(type(error), error, error.__traceback__))
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(full)
        sys.stderr.flush()
    values = {"where": where, "type": type(error).__name__, "text": str(error), "code_location": _code_location(error)}
    kinds = [f"{kind.__module__}.{kind.__qualname__}" for kind in type(error).__mro__]
    record(folder, {**values, "kinds": kinds, "traceback": full})


def record_end(folder: Path, where: str, code: int) -> None:
    """Note that the process of the model called ``where`` ended with ``code`` (negative: a signal)."""
    record(folder, {"where": where, "code": code})


def recorded(folder: Path) -> dict[str, Any] | None:
    """The first failure noted, or None."""
    try:
        return dict(json.loads((folder / "error.json").read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None


def awaited(
    folder: Path, ready: Callable[[int | None], bool], poll: Callable[[], int | None], end: float
) -> dict[str, Any] | None:
    """What keeps work from its result: None, nothing, when it is ready.

    Else the failure that was noted; or the exit code of the worker, ``code``, which has ended without a word; or no
    values: there is no time left.

    Args:
        folder: Where failures are noted.
        ready: Whether there is a result, by the exit code of the worker.
        poll: Tells that; None while the worker runs. Some time passes between two calls.
        end: The time by `time.monotonic` until which is waited.
    """
    while True:
        code = poll()  # before the files are looked at: none is missed
        if ready(code):
            return None
        noted = recorded(folder)
        if noted is not None or code is not None:
            return noted or {"code": code}
        if time.monotonic() > end:
            return {}


def _part_of(process: mp_process.BaseProcess) -> str:
    """The Lava model or service that a process is to run, else nothing."""
    builder = vars(process).get("_kwargs", {}).get("builder")
    model = getattr(builder, "proc_model", None) or getattr(builder, "rs_class", None)
    return getattr(model, "__name__", "")


class _Children:
    """Notices when a process of Lava's dies: its peers would wait for it for ever."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._started: dict[int, tuple[str, str]] = {}  # by process id: Lava model or nothing, name

    def add(self, process: mp_process.BaseProcess, part: str) -> None:
        """Watch a process that has just been started."""
        if process.pid is not None:
            self._started[process.pid] = part, process.name

    def look(self) -> None:
        """Record a process that was killed or ended with an error; it is left to be reaped by who started it.

        Two threads may look at once.
        """
        for pid, (part, name) in list(self._started.items()):
            try:
                ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            except ChildProcessError:  # reaped
                self._started.pop(pid, None)
                continue
            if ended is None or self._started.pop(pid, None) is None:
                continue
            code = ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status
            # A memory manager that is slow to end is ended by its own shutdown.
            if code != 0 and not (code == -signal.SIGTERM and not part):
                record_end(self._folder, part or name, code)

    def watch(self) -> None:
        """Look for processes that have died, for ever."""
        while True:
            self.look()
            time.sleep(WATCH)


def tell_stacks(folder: Path, title: str) -> Path:
    """Let this process write where its main thread stands when it gets `STACKS`; return the file."""
    path = folder / f"stacks-{os.getpid()}"
    file = path.open("w", encoding="utf-8")
    file.write(f"Process {os.getpid()}: {title}\n")
    file.flush()
    faulthandler.register(STACKS, file=file, all_threads=False)  # the others are Lava's channels, many
    return path


def _forget_networks() -> None:
    """Empty Lava's lists of every Process and Var ever made, which keep stopped networks in memory.

    What is in use is held by its own runtime. The rest is collected here, not in a forked process, where a Process's
    end would be taken for that of its network.
    """
    for name, server, held in (("process", "ProcessServer", "processes"), ("variable", "VarServer", "vars")):
        module = sys.modules.get(f"lava.magma.core.process.{name}")
        if module is not None:
            getattr(getattr(module, server)(), held).clear()
    gc.collect()


def watch_processes(folder: Path) -> None:
    """Let every process that multiprocessing starts be watched, and tell what is raised in it.

    Lava's `SystemProcess` calls `Process.run` inside a ``try`` that keeps exceptions to itself, so that one is wrapped.
    """
    children = _Children(folder)
    start, run = mp_process.BaseProcess.start, mp_process.BaseProcess.run

    def watched_start(self: mp_process.BaseProcess) -> None:
        part = _part_of(self)
        if not part:  # the memory manager, the first process of a run
            _forget_networks()
        children.look()  # starting one reaps those that have ended
        start(self)
        children.add(self, part)

    def told_run(self: mp_process.BaseProcess) -> None:
        part = _part_of(self)
        stacks = tell_stacks(folder, part or self.name)
        try:
            run(self)
        except SystemExit as error:
            if part:  # Lava neither ends with it nor says so; a memory manager ends with it
                record_exception(folder, error, part)
            raise
        except BaseException as error:
            record_exception(folder, error, part or self.name)
            raise
        finally:
            stacks.unlink(missing_ok=True)

    def told_thread(args: Any) -> None:
        if args.exc_type is not SystemExit and args.exc_value is not None:
            name = args.thread.name if args.thread is not None else "?"
            record_exception(folder, args.exc_value, f"thread {name} of {mp_process.current_process().name}")

    vars_of_process: Any = mp_process.BaseProcess
    vars_of_process.start, vars_of_process.run = watched_start, told_run
    threading.excepthook = told_thread
    threading.Thread(target=children.watch, name="lava-vpr-watch", daemon=True).start()
