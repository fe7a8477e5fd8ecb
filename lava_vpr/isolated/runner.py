"""Calls a function that uses Lava in processes of its own: no failure inside Lava hangs or leaves anything behind."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from lava_vpr.errors import LavaRunError
from lava_vpr.interrupts import held
from lava_vpr.isolated import first_failure, job_folder, lifetime
from lava_vpr.isolated.child import waited
from lava_vpr.isolated.worker import STACKS
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
        worker: subprocess.Popen[bytes] | None = None
        try:
            reader = job_folder.ProgressReader(folder)
            with held():  # a worker that is started is known
                worker = _start(folder)
            _write_job(folder, target, arrays, text)  # now, so that the worker removes it should we be killed meanwhile
            _wait(worker, folder, target, timeout, end, reader, progress)
            return job_folder.load_arrays(folder / "results")
        finally:
            with held():
                if worker is not None:
                    _end(worker, folder)


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


def _start(folder: Path) -> subprocess.Popen[bytes]:
    """The worker, with our search path for modules, in a session of its own that Ctrl-C does not reach."""
    paths = [os.path.abspath(path) for path in sys.path if os.path.exists(path or ".")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    try:
        with (folder / "log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "lava_vpr.isolated.worker", str(folder), str(os.getpid())],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
    except OSError as error:
        raise LavaRunError(
            f"{sys.executable}: cannot be started ({error}); free memory or end other programs"
        ) from error


def _wait(
    worker: subprocess.Popen[bytes],
    folder: Path,
    target: str,
    timeout: float,
    end: float,
    reader: job_folder.ProgressReader,
    progress: Callable[[int], None] | None,
) -> None:
    """Wait until there are results.

    Raises:
        LavaVprError: there will be none.
    """
    while True:
        code = waited(worker, LOOK)  # before the files are looked at: none is missed
        done = reader.new()
        if done and progress is not None:
            progress(done)
        recorded = first_failure.recorded(folder)
        if recorded is not None:
            raise first_failure.of_record(recorded, target, folder)
        if code is not None:
            if (folder / "results").exists() and code == 0:
                return
            raise first_failure.of_end(f"{target}: its process", 128 - code if code > 128 else code, folder)
        if time.monotonic() > end:
            _ask_stacks(folder)
            raise first_failure.of_timeout(target, timeout, folder)


def _ask_stacks(folder: Path) -> None:
    """Let each process write where it stands."""
    lifetime.signal_group(_group(folder), STACKS)
    end = time.monotonic() + TELL
    while time.monotonic() < end and not first_failure.all_stacks(folder):
        time.sleep(LOOK)


def _group(folder: Path) -> int:
    """The process group of the work, or 0 if it has not begun."""
    try:
        return int((folder / "group").read_text(encoding="ascii") or 0)
    except OSError:
        return 0


def _end(worker: subprocess.Popen[bytes], folder: Path) -> None:
    """End the worker and all below it."""
    if worker.poll() is None:
        worker.terminate()
        try:
            worker.wait(GRACE)
        except subprocess.TimeoutExpired:
            worker.kill()
            worker.wait()
    if worker.returncode < 0:  # killed: it could not see to it itself
        lifetime.end_group(_group(folder))
    lifetime.remove_shared_memory(folder.name)
