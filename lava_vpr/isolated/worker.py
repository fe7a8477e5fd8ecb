"""Runs one target for `lava_vpr.isolated.runner`: ``python -m lava_vpr.isolated.worker FOLDER CALLER``.

The worker is two processes. The keeper forks the one that works, never imports Lava, and ends and reaps everything
below it when the work ends, when it is told to (SIGTERM), when the caller is gone or when the folder is. The worker
proper runs the target. Lava's processes are its children and are killed by the system when it dies.
"""

from __future__ import annotations

import faulthandler
import gc
import importlib
import logging
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from multiprocessing import process as mp_process
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from lava_vpr.isolated import lifetime

if TYPE_CHECKING:
    from lava_vpr.isolated.job_folder import ProgressWriter

LOOK = 0.02  # seconds between two looks of the keeper
WATCH = 0.05  # seconds between two looks at Lava's processes
STACKS = signal.SIGUSR1  # asks a process where it stands

_progress: ProgressWriter | None = None


def report(done: int) -> None:
    """Say that ``done`` further units of work are done, from the target or any Lava model.

    Outside a worker it says nothing.
    """
    if _progress is not None:
        _progress.add(done)


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
        from lava_vpr.isolated.first_failure import record_end

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


def _tell_stacks(folder: Path, title: str) -> Path:
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


def _hook_processes(folder: Path) -> None:
    """Let every process that multiprocessing starts be watched, and tell what is raised in it.

    Lava's `SystemProcess` calls `Process.run` inside a ``try`` that keeps exceptions to itself, so that one is wrapped.
    """
    from lava_vpr.isolated.first_failure import record_exception

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
        stacks = _tell_stacks(folder, part or self.name)
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


def quiet_logging() -> None:
    """Keep Lava from adding a handler to the root logger with every Process, and to its compiler's with every run."""
    logging.basicConfig(level=logging.WARNING)  # one handler, to the log of the run
    add = logging.Logger.addHandler

    def add_unless_lava(self: logging.Logger, handler: logging.Handler) -> None:
        if self is not logging.getLogger() and not self.name.startswith("lava."):
            add(self, handler)

    logger: Any = logging.Logger
    logger.addHandler = add_unless_lava


def _prepare(folder: Path) -> None:
    """Make this process safe to run Lava in."""
    global _progress
    from lava_vpr.isolated.job_folder import ProgressWriter

    faulthandler.enable()
    lifetime.name_shared_memory(folder.name)
    tempfile.tempdir = str(folder)
    vars(mp_process.current_process())["_config"]["tempdir"] = str(folder)  # for sockets, whose paths must be short
    quiet_logging()
    _progress = ProgressWriter(folder)
    _tell_stacks(folder, "the target")
    _hook_processes(folder)


def _work(folder: Path) -> int:
    """Call the target and return the exit code."""
    from lava_vpr.isolated.first_failure import record_exception
    from lava_vpr.isolated.job_folder import load_job, save_arrays

    try:
        _prepare(folder)
        target, options, arrays = load_job(folder)
        module, _, name = target.partition(":")
        function = getattr(importlib.import_module(module), name)
        save_arrays(folder / "results", function(arrays, options))
    except BaseException as error:
        record_exception(folder, error)
        return 1
    return 0


def _start(folder: Path) -> int:
    """Fork the process that works, in a group of its own, and return its id."""
    lifetime.bind_forks()  # those of the fork, too
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.setpgid(0, 0)
            code = _work(folder)
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)  # Lava's own ending can wait for ever
    return pid


def main(folder: Path, caller: int) -> int:
    """Run the job in ``folder`` for the process ``caller``, see it end, and return the exit code.

    The code is 128 + n after signal n.
    """
    signals: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        signals.append(number)

    signal.signal(signal.SIGTERM, stop)
    lifetime.adopt_orphans()
    pid = _start(folder)
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
        lifetime.end_descendants(pid)
        lifetime.remove_shared_memory(folder.name)
        if os.getppid() != caller:
            shutil.rmtree(folder, ignore_errors=True)
    if code is None:
        return 128 + signal.SIGTERM
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    # Under its own name, so that `report` finds what this process set.
    from lava_vpr.isolated import worker

    sys.exit(worker.main(Path(sys.argv[1]), int(sys.argv[2])))
