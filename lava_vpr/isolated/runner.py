"""Calls a function that uses Lava in processes of its own: no failure inside Lava hangs or leaves anything behind.

A failed run is an error of one line, and names the file in which its log or traceback is kept.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from lava_vpr import errors
from lava_vpr.errors import LavaRunError, LavaVprError
from lava_vpr.interrupts import held
from lava_vpr.isolated import first_failure, job_folder, lifetime
from lava_vpr.isolated.child import started, waited
from lava_vpr.storage.writing import temporary_folder

LOOK = 0.03  # seconds between two looks at the worker
GRACE = 6.0  # seconds for the worker to end what it started
TELL = 2.0  # seconds for processes to write where they stand
LONGEST_FOLDER = 85  # bytes; with "/listener-12345678" at most the 103 of a socket's path
TARGET = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def run_isolated(
    target: str,
    arrays: Mapping[str, NDArray[Any]],
    options: Mapping[str, Any] | None = None,
    *,
    timeout: float,
    progress: Callable[[int], None] | None = None,
) -> dict[str, NDArray[Any]]:
    """Call ``target`` in a child process and return the arrays that it returns.

    However it ends, also by Ctrl-C or the death of any of the processes, this one included, no process, no shared
    memory and no temporary folder is left. The child's working directory and temporary files are in that folder.

    Args:
        target: "package.module:function" of a function f(arrays, options) -> dict of arrays. It may start Lava, from
            its main thread; what it leaves running is killed.
        arrays: The target's first argument: numbers, booleans or text, no Python objects.
        options: The target's second argument, as JSON values.
        timeout: Seconds that it may take, its start included (Lava's import takes about one).
        progress: Called with the units of work that were reported (`lava_vpr.isolated.worker.report`) since the last
            call.
    Raises:
        LavaRunError: it raised an exception, was killed, or took too long. The traceback, or where each of its
            processes stood, is in ``error.traceback`` and in the file that the message names.
        LavaVprError: it raised this very error.
    """
    if not TARGET.fullmatch(target):
        raise ValueError(f"{target!r} is not a target: write package.module:function")
    if not timeout > 0:
        raise ValueError(f"a timeout of {timeout} s leaves no time: give more than 0")
    end = time.monotonic() + timeout
    text = json.dumps(dict(options or {}))
    with temporary_folder() as folder:
        if len(os.fsencode(folder)) > LONGEST_FOLDER:
            said = "too long a path for the sockets that Lava makes there; set TMPDIR to a shorter one"
            raise LavaRunError(f"{folder.parent}: {said}")
        reader = job_folder.ProgressReader(folder)
        with _worker(folder) as worker:
            _write_job(folder, target, arrays, text)  # now, so that the worker removes it should we be killed meanwhile

            def poll() -> int | None:
                code = waited(worker, LOOK)
                done = reader.new()
                if done and progress is not None:
                    progress(done)
                return None if code is None else 128 - code if code > 128 else code

            def answered(code: int | None) -> bool:
                return code == 0 and (folder / "results").exists() and first_failure.recorded(folder) is None

            failure = first_failure.awaited(folder, answered, poll, end)
            if failure is None:
                return job_folder.load_arrays(folder / "results")
            if not failure:
                _ask_stacks(folder)
            raise error_of(failure, target, timeout, folder)


def _write_job(folder: Path, target: str, arrays: Mapping[str, NDArray[Any]], options: str) -> None:
    """Tell the worker what to do; ``options`` is JSON."""
    try:
        job_folder.save_arrays(folder / "given", arrays)
        job_folder.save_job(folder, target, options)
    except OSError as error:
        reason = error.strerror or str(error)
        raise LavaRunError(f"{folder}: cannot be written ({reason}); free space there or set TMPDIR") from error


@contextmanager
def _worker(folder: Path) -> Iterator[subprocess.Popen[Any]]:
    """The worker, with our search path for modules; at the end of the block it has ended, with all below it."""
    paths = [os.path.abspath(path) for path in sys.path if os.path.exists(path or ".")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    words: list[str | Path] = [sys.executable, "-m", "lava_vpr.isolated.worker", folder, str(os.getpid())]
    worker: subprocess.Popen[Any] | None = None
    try:
        with (
            (folder / "log").open("ab") as log,
            started(words, GRACE, cwd=folder, env=environment, stdout=log, stderr=log) as worker,
        ):
            yield worker
    except OSError as error:
        if worker is not None:
            raise
        raise LavaRunError(
            f"{sys.executable}: cannot be started ({error}); free memory or end other programs"
        ) from error
    finally:
        if worker is not None:
            with held():
                lifetime.clear(folder, worker.returncode)


def _ask_stacks(folder: Path) -> None:
    """Let each process write where it stands."""
    lifetime.signal_work(folder, first_failure.STACKS)
    end = time.monotonic() + TELL
    while time.monotonic() < end and not all_stacks(folder):
        time.sleep(LOOK)


LONGEST = 400  # characters of an exception's text in the one line of an error
LOG_TAIL = 20_000  # bytes


def one_line(text: str) -> str:
    """``text`` on one line, cut where it is too long for one."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else line[:LONGEST] + " ..."


def _log(folder: Path) -> str:
    """The end of what the run's processes wrote to stdout and stderr."""
    try:
        with (folder / "log").open("rb") as log:
            log.seek(max(0, os.fstat(log.fileno()).st_size - LOG_TAIL))
            return log.read(LOG_TAIL).decode(errors="replace")
    except OSError:
        return ""


def _stacks(folder: Path) -> list[str]:
    """Where each process of the run stood, as far as they have said so."""
    return [path.read_text(encoding="utf-8", errors="replace") for path in sorted(folder.glob("stacks-*"))]


def all_stacks(folder: Path) -> bool:
    """Whether each process has written where it stands, below the line that says who it is."""
    return all(text.count("\n") > 1 for text in _stacks(folder))


def _keep(text: str) -> str:
    """Write ``text`` to a file that stays; its path, or nothing if there is no text or no room for it."""
    if not text.strip():
        return ""
    try:
        handle, path = tempfile.mkstemp(prefix="lava-vpr-failure-", suffix=".txt")
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return ""
    return path


def _failure(message: str, what: str, details: str) -> LavaRunError:
    """An error whose line ends with the file in which ``details`` are kept, and ``what`` they are."""
    path = _keep(details)
    return LavaRunError(f"{message}; {what}: {path}" if path else message, details.strip())


def error_of(values: dict[str, Any], target: str, seconds: float, folder: Path) -> LavaVprError:
    """The error that a failure of ``target`` is to the caller.

    Args:
        values: As `lava_vpr.isolated.first_failure.awaited` returns them.
        target: What was run.
        seconds: The time that it had.
        folder: The folder of the run, which still has its log.
    """
    if not values:
        said = f"{target} did not end within {seconds:g} s and was stopped; allow more time or run less at once"
        return _failure(said, "where its processes stood", "\n".join([*_stacks(folder), _log(folder)]))
    where = values.get("where", "")
    if "code" in values:
        process = f"the process of {where}" if where else "its process"
        return _failure(f"{target}: {process} {_ended(values['code'])}", "its log", _log(folder))
    known = next((kind for kind in values["kinds"] if kind.startswith(f"{errors.__name__}.")), "").rpartition(".")[2]
    if known and known != LavaRunError.__name__:
        error: LavaVprError = getattr(errors, known)(values["text"])
        return error
    text = one_line(f"{values['type']}: {values['text']}" if values["text"] else values["type"])
    location = f" at {values['code_location']}" if values["code_location"] else ""
    said = f"{target} failed{f' in {where}' if where else ''}: {text}{location}"
    return _failure(said, "traceback", values["traceback"])


def _ended(code: int) -> str:
    """How a process ended that says nothing itself, by its exit code, and what to do."""
    if code >= 0:
        return f"ended itself with exit code {code} and no result; let it raise an error or return"
    name = f"signal {-code}"
    with contextlib.suppress(ValueError):
        name = signal.Signals(-code).name
    if -code in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGILL, signal.SIGFPE):
        return f"crashed ({name}); a compiled part is at fault: install numba and lava-nc again"
    return f"was killed ({name}); if memory ran out, free some or run less at once; then run it again"
