"""Calls a function that uses Lava in processes of its own: no failure inside Lava hangs or leaves anything behind."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from lava_vpr.errors import LavaRunError
from lava_vpr.interrupts import held
from lava_vpr.isolated import failures, first_failure, job_folder, lifetime
from lava_vpr.isolated.child import started, waited
from lava_vpr.storage.temporary import temporary_folder

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
        _check_length(folder)
        reader = job_folder.ProgressReader(folder)
        with _worker(folder) as worker:
            _write_job(folder, target, arrays, text)  # now, so that the worker removes it should we be killed meanwhile

            def poll() -> int | None:
                code = waited(worker, LOOK)
                done = reader.new()
                if done and progress is not None:
                    progress(done)
                return None if code is None else 128 - code if code > 128 else code

            failure = first_failure.awaited(folder, partial(_answered, folder), poll, end)
            if failure is None:
                return job_folder.load_arrays(folder / "results")
            if not failure:
                _ask_stacks(folder)
            raise failures.error_of(failure, target, timeout, folder)


def _answered(folder: Path, code: int | None) -> bool:
    """Whether the worker has ended with results and no failure was noted."""
    return code == 0 and (folder / "results").exists() and first_failure.recorded(folder) is None


def _check_length(folder: Path) -> None:
    """Refuse a folder whose path is too long for Lava's sockets.

    Raises:
        LavaRunError: it is.
    """
    if len(os.fsencode(folder)) > LONGEST_FOLDER:
        raise LavaRunError(
            f"{folder.parent}: too long a path for the sockets that Lava makes there; set TMPDIR to a shorter one"
        )


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
    while time.monotonic() < end and not failures.all_stacks(folder):
        time.sleep(LOOK)
