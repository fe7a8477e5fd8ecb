"""The process that runs Lava, from outside: what it is given, how long it may take, and that nothing outlives it."""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bundle_files import read
from lava_network import Arrays
from query_files import Results, named_array
from refusals import Refused
from result_files import put

LOOK, GRACE, START_SECONDS = 0.02, 3.0, 600.0  # seconds; Intel's compiler may take minutes
SLOWEST, FOLDER_LIMIT = 40.0, 75  # steps a second; bytes, as Lava adds 32 and a socket's path holds 107


@contextlib.contextmanager
def job(files: dict[str, bytes], arrays: Arrays, options: dict[str, Any]) -> Iterator[Path]:
    """A folder with what the worker is to run: the very bytes that were checked."""
    with tempfile.TemporaryDirectory(prefix="loihi2-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if len(os.fsencode(folder)) > FOLDER_LIMIT:
            raise Refused("start", f"{folder.parent}: too long a path for Lava's sockets; set TMPDIR to a shorter one")
        for file in ("weights.npy", "bias.npy", "parameters.json"):
            (folder / file).write_bytes(files[f"network/{file}"])
        for key, array in arrays.items():
            put(str(folder / f"{key}.npy"), array)
        put(str(folder / "options.json"), options)
        yield folder


def adopt_orphans() -> None:
    """Become the parent of processes whose own parent ends (Linux), so that none is out of reach."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER


def descendants(worker: int) -> list[int]:
    """Children of this process, adopted ones too; where the system does not tell, the worker."""
    own = os.getpid()
    try:
        return [int(pid) for pid in Path(f"/proc/{own}/task/{own}/children").read_text(encoding="ascii").split()]
    except OSError:
        return [worker]


def end_all(worker: subprocess.Popen[bytes]) -> None:
    """End the worker and all that it started; first in a way that lets Python remove Lava's shared memory."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)  # nothing keeps this from its end, which is near
    for number in (signal.SIGTERM, signal.SIGKILL):
        end = time.monotonic() + GRACE
        while time.monotonic() < end:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(worker.pid, number)
            for pid in descendants(worker.pid):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, number)
            worker.poll()
            try:
                while os.waitpid(-1, os.WNOHANG) != (0, 0):
                    pass
            except ChildProcessError:
                return
            time.sleep(LOOK)


def run(files: dict[str, bytes], arrays: Arrays, args: argparse.Namespace, results: Results) -> None:
    """Present all queries in a process of its own, and keep what it answers."""
    n = len(arrays["keys"])
    if not n:
        return
    adopt_orphans()
    args.batch = n if args.power else args.batch
    options = {"batch": args.batch, "simulate": args.simulate, "caller": os.getpid(), "power": bool(args.power)}
    with job(files, arrays, options) as folder, (folder / "log").open("wb") as log:
        interval = steps_of(files)
        worker = subprocess.Popen(
            [sys.executable, str(Path(__file__).absolute().with_name("run.py")), "--worker", str(folder)],
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        try:
            for start in range(0, n, args.batch):
                end = min(n, start + args.batch)
                seconds = args.timeout or (START_SECONDS if start == 0 else 60) + (end - start) * interval / SLOWEST
                wait(worker, folder, f"batch-{start}.npy", seconds, f"queries {start} to {end - 1}")
                results.add(start, named_array(read(str(folder), f"batch-{start}.npy"), "answer").astype(np.int32))
            if args.power:
                wait(worker, folder, "power.json", args.timeout or 60, "power")
                put(args.power, json.loads((folder / "power.json").read_bytes()))
            with contextlib.suppress(subprocess.TimeoutExpired):
                worker.wait(GRACE)
        finally:
            end_all(worker)


def steps_of(files: dict[str, bytes]) -> int:
    """Steps of a presentation."""
    parameters = json.loads(files["network/parameters.json"])
    return int(parameters["steps"] + parameters["silent_steps"])


def wait(worker: subprocess.Popen[bytes], folder: Path, name: str, seconds: float, what: str) -> None:
    """Until the worker has written an answer."""
    end = time.monotonic() + seconds
    while True:
        ended = worker.poll() is not None  # before the files are looked at: none is missed
        if (folder / name).exists():
            return
        if (folder / "error").exists():
            raise Refused(*json.loads((folder / "error").read_bytes()))
        if ended:
            raise Refused(
                "run", f"{what}: the process that runs Lava ended with code {worker.returncode}{last(folder)}"
            )
        if time.monotonic() > end:
            raise Refused(
                "run",
                f"{what}: Lava or the board did not finish within {seconds:g} s and was ended, {seen(folder)} steps "
                "were read out in all; see to the board or raise --timeout",
            )
        time.sleep(LOOK)


def last(folder: Path) -> str:
    """The last line of the worker's log, for a message."""
    lines = (folder / "log").read_text(encoding="utf-8", errors="replace").split("\n")
    return "".join(f" ({line.strip()[:300]})" for line in [x for x in lines if x.strip()][-1:])


def seen(folder: Path) -> str:
    """How many steps the read-out has seen."""
    try:
        return (folder / "steps").read_text(encoding="ascii")
    except OSError:
        return "0"
