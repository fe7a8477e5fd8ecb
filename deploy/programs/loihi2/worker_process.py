"""The process that runs Lava, from outside: what it is given, how long it may take, and that nothing outlives it."""

from __future__ import annotations

import argparse
import contextlib
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

import first_failure
import job_folder
import lifetime
from bundle_files import array_of, read
from lava_network import Arrays
from refusals import Refused
from result_files import Results, put

QUERIES = ("pixels", "rates", "keys", "biases", "exponents")
"""Arrays of queries, a row for each."""
LOOK, GRACE, START_SECONDS = 0.02, 3.0, 600.0  # seconds; Intel's compiler may take minutes
KEPT = 4000  # characters of what a run that failed wrote
SLOWEST, SLOWEST_PIXELS = 40.0, 4.0  # steps a second; of a network from pixels on
FOLDER_LIMIT = 75  # bytes, as Lava adds 32 and a socket's path holds 107


@contextlib.contextmanager
def job(arrays: Arrays, options: dict[str, Any]) -> Iterator[Path]:
    """A folder with what the worker is to run."""
    with tempfile.TemporaryDirectory(prefix="loihi2-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if len(os.fsencode(folder)) > FOLDER_LIMIT:
            raise Refused("start", f"{folder.parent}: too long a path for Lava's sockets; set TMPDIR to a shorter one")
        job_folder.save_arrays(folder / "given", arrays)
        job_folder.save_job(folder, "", json.dumps(options))
        yield folder


@contextlib.contextmanager
def started(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The worker, which works in ``folder``; at the end of the block it has ended, with all that it started."""
    words = [
        sys.executable,
        str(Path(__file__).absolute().with_name("run.py")),
        "--worker",
        str(folder),
        str(os.getpid()),
    ]
    given = {**os.environ, "TMPDIR": str(folder)}
    none = subprocess.DEVNULL
    with (folder / "log").open("wb") as log:
        worker = subprocess.Popen(
            words, cwd=folder, env=given, stdin=none, stdout=log, stderr=log, start_new_session=True
        )
    try:
        yield worker
    finally:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)  # nothing keeps this from its end, which is near
        worker.terminate()
        lifetime.clear(folder, worker.wait())


def run(
    parameters: dict[str, Any],
    arrays: Arrays,
    args: argparse.Namespace,
    results: Results,
    first: int = 0,
    scalars: bool = False,
) -> None:
    """Present all queries in a process of its own, and keep what it answers.

    Args:
        parameters: Of the network, as the bundle has them.
        arrays: Those of the network; those of the queries (`QUERIES`), keys among them.
        args: The command line.
        results: Where answers are kept.
        first: The number of the first query there.
        scalars: Neurons are made with one value for all, and set to their own before the first query.
    """
    n = len(arrays["keys"])
    if not n:
        return
    if scalars:  # a query before the first, in which nothing spikes and after which all values are set
        arrays = {k: np.concatenate([0 * a[:1], a]) if k in QUERIES else a for k, a in arrays.items()}
        n, first = n + 1, first - 1
    args.batch = n if args.power else args.batch
    options = {"batch": args.batch, "simulate": args.simulate, "power": bool(args.power), "parameters": parameters}
    options["scalars"] = scalars
    interval = int(parameters["steps"] + parameters["silent_steps"])
    slowest = SLOWEST_PIXELS if "pixels" in arrays else SLOWEST
    with job(arrays, options) as folder, started(folder) as worker:
        for start in range(0, n, args.batch):
            end = min(n, start + args.batch)
            seconds = args.timeout or (START_SECONDS if start == 0 else 60) + (end - start) * interval / slowest
            wait(worker, folder, f"batch-{start}.npy", seconds, f"queries {start} to {end - 1}")
            for number, row in enumerate(array_of(read(str(folder), f"batch-{start}.npy")), first + start):
                if number >= first + scalars:
                    results.put(number, row)
            results.save()
        if args.power:
            wait(worker, folder, "power.json", args.timeout or 60, "power")
            put(args.power, json.loads((folder / "power.json").read_bytes()))
        with contextlib.suppress(subprocess.TimeoutExpired):
            worker.wait(GRACE)


def wait(worker: subprocess.Popen[bytes], folder: Path, name: str, seconds: float, what: str) -> None:
    """Until the worker has written an answer.

    Raises:
        Refused: it will not, or not in time.
    """

    def poll() -> int | None:
        time.sleep(LOOK)
        return worker.poll()

    end = time.monotonic() + seconds
    failure = first_failure.awaited(folder, lambda code: (folder / name).exists(), poll, end)
    if failure is not None:
        refused = refusal(failure, folder, what, seconds)
        refused.output = (folder / "log").read_text(encoding="utf-8", errors="replace")[-KEPT:]
        raise refused


def refusal(failure: dict[str, Any], folder: Path, what: str, seconds: float) -> Refused:
    """What to raise for a failure that `first_failure.awaited` returned."""
    if not failure:
        return Refused(
            "run",
            f"{what}: Lava or the board did not finish within {seconds:g} s and was ended, "
            f"{seen(folder):,} steps were read out in all; see to the board or raise --timeout",
        )
    where, text = failure.get("where", ""), " ".join(failure.get("text", "").split())[:400]
    if "stage" in failure:
        return Refused(failure["stage"], text)
    if "code" not in failure:
        return Refused("run", f"{where or 'Lava'}: {failure['type']}: {text}")
    if where:
        return Refused("run", f"a process of Lava's ({where}) ended with code {failure['code']}; run again")
    return Refused("run", f"{what}: the process that runs Lava ended with code {failure['code']}{last(folder)}")


def last(folder: Path) -> str:
    """The last line of the worker's log, for a message."""
    lines = (folder / "log").read_text(encoding="utf-8", errors="replace").split("\n")
    return "".join(f" ({line.strip()[:300]})" for line in [x for x in lines if x.strip()][-1:])


def seen(folder: Path) -> int:
    """How many steps the read-out has seen."""
    try:
        return int(np.fromfile(folder / "steps", np.int64)[0])
    except OSError:
        return 0
