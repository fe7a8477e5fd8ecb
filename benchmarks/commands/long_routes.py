"""Long synthetic routes, learned and asked by the workers of a Dask cluster on this machine.

    python -m benchmarks commands.long_routes [--places 1000 ...] [--queries 500] [--alone 1000 ...] [--record]

A scheduler and workers of one thread each run as processes on the loopback address; ``lava-vpr train --cluster`` and
``eval --cluster`` are processes, too. Bytes are those of the loopback device, as the kernel counts them: what goes over
the scheduler counts twice, and whatever else uses the device counts, too (`unshare --net` gives a run its own).
Memory is the most that a process held at any time; scheduler and workers are started anew for each route. ``--alone``
learns and asks on as many threads without a cluster, too, and compares the bytes of model and figures.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click
import psutil

from benchmarks.commands.running import CommandRun, lava_vpr
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.synthetic import write_traverses

DASK = str(Path(sys.executable).with_name("dask"))
LOCAL = ("--host", "127.0.0.1", "--no-dashboard")


def held(process: subprocess.Popen[bytes]) -> int:
    """The bytes that a process has held at most."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


@contextmanager
def cluster(place: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a new cluster, and its processes, the scheduler first."""
    file = place / "scheduler.json"
    file.unlink(missing_ok=True)
    started = []

    def start(*words: str) -> None:
        log = (place / f"dask-{len(started)}.log").open("wb")
        started.append(subprocess.Popen([DASK, *words, *LOCAL], cwd=place, stdout=log, stderr=log))

    try:
        start("scheduler", "--port", "0", "--scheduler-file", str(file))
        while not file.exists() or not file.read_text().endswith("}"):
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        for _ in range(workers):
            start("worker", address, "--nthreads", "1", "--no-nanny", "--memory-limit", "0")
        time.sleep(5)
        yield address, started
    finally:
        for process in started:
            process.kill()
            process.wait()


def commands(places: int, queries: int, name: str) -> dict[str, list[str]]:
    """The commands for a route."""
    asked = f"0:{min(queries, places)}"
    learn = ["train", "world/reference", "--places", f"0:{places}", "-o", f"{name}.lvpr"]
    ask = ["eval", f"{name}.lvpr", "world/query", "--places", asked, "--baseline", "cosine", "--json", f"{name}.json"]
    return {"train": learn, "eval": ask}


def row(what: str, places: int, run: CommandRun, sent: int = 0, scheduler: int = 0, worker: int = 0) -> list[str]:
    """What a command took: of its process seconds and those of all its threads; then bytes sent, and held at most."""
    memory = (f"{number / 1e6:,.0f}" if number else "" for number in (sent, run.held, scheduler, worker))
    return [what, f"{places:,}", f"{run.seconds:.1f}", f"{run.used:.1f}", *memory]


def at_cluster(place: Path, places: int, queries: int, workers: int) -> list[list[str]]:
    """Learn and ask a route at a cluster."""
    rows = []
    with cluster(place, workers) as (address, (scheduler, *others)):
        for what, words in commands(places, queries, "there").items():
            before = psutil.net_io_counters(pernic=True)["lo"].bytes_sent
            run = lava_vpr(place, *words, "--cluster", address)
            sent = psutil.net_io_counters(pernic=True)["lo"].bytes_sent - before
            rows.append(row(f"`{what}`", places, run, sent, held(scheduler), max(map(held, others))))
    return rows


def alone(place: Path, places: int, queries: int) -> list[list[str]]:
    """Learn and ask a route on this machine alone; model and figures must have the cluster's bytes."""
    runs = {what: lava_vpr(place, *words) for what, words in commands(places, queries, "here").items()}
    for suffix in ("lvpr", "json"):
        if (place / f"here.{suffix}").read_bytes() != (place / f"there.{suffix}").read_bytes():
            raise SystemExit(f"{places} places: {suffix} of the cluster and of one machine differ")
    return [row(f"`{what}`, no cluster", places, run) for what, run in runs.items()]


@program()
@click.option("--places", "sizes", type=int, multiple=True, default=(1000, 3000, 10000), show_default=True)
@click.option("--alone", "compared", type=int, multiple=True, default=(1000,), show_default=True)
@click.option("--queries", type=int, default=500, show_default=True)
@click.option("--workers", type=int, default=2, show_default=True)
def main(sizes: Sequence[int], compared: Sequence[int], queries: int, workers: int) -> Printed:
    """What long routes take at a cluster."""
    rows = []
    with temporary_folder() as place:
        write_traverses(place / "world", max(sizes), 0)
        for places in sizes:
            rows += at_cluster(place, places, queries, workers)
            rows += alone(place, places, queries) if places in compared else []
    memory = ("MB sent", "client MB", "scheduler MB", "worker MB")
    yield BenchmarkTable(["", "places", "s", "client's processor s", *memory], rows, record="cluster")
