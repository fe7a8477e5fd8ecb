"""Long synthetic routes, learned and asked by the workers of a Dask cluster on this machine.

    python -m benchmarks.cluster.long_routes [--places 1000 ...] [--queries 500] [--alone 1000 ...] [--json FILE]

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
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import psutil
from rich.console import Console
from rich.table import Table

from benchmarks.query_memory import Run, measured
from lava_vpr.synthetic import write_traverses

LAVA_VPR, DASK = (str(Path(sys.executable).with_name(name)) for name in ("lava-vpr", "dask"))
LOCAL = ("--host", "127.0.0.1", "--no-dashboard")
console = Console(highlight=False, width=140)


@dataclass(frozen=True)
class Figures:
    """What one command took.

    Attributes:
        what: The command.
        places: Places of the route.
        seconds, processor_s: Of the command's process; the second: all its threads.
        sent: Bytes over the loopback device; 0 without a cluster.
        client, scheduler, worker: Bytes held at most by the command, the scheduler, and any worker.
    """

    what: str
    places: int
    seconds: float
    processor_s: float
    sent: int = 0
    client: float = 0.0
    scheduler: int = 0
    worker: int = 0


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


def run(place: Path, places: int, queries: int, workers: int) -> list[Figures]:
    """Learn and ask a route at a cluster."""
    found = []
    with cluster(place, workers) as (address, (scheduler, *others)):
        for what, words in commands(places, queries, "there").items():
            before = psutil.net_io_counters(pernic=True)["lo"].bytes_sent
            taken: Run = measured([LAVA_VPR, *words, "--cluster", address], place)
            sent = psutil.net_io_counters(pernic=True)["lo"].bytes_sent - before
            memory = taken.held, held(scheduler), max(map(held, others))
            found.append(Figures(what, places, taken.seconds, taken.used, sent, *memory))
    return found


def commands(places: int, queries: int, name: str) -> dict[str, list[str]]:
    """The commands for a route, by what they do."""
    asked = f"0:{min(queries, places)}"
    learn = ["train", "world/reference", "--places", f"0:{places}", "-o", f"{name}.lvpr"]
    ask = ["eval", f"{name}.lvpr", "world/query", "--places", asked, "--baseline", "cosine", "--json", f"{name}.json"]
    return {"train": learn, f"eval, {min(queries, places)} queries": ask}


def alone(place: Path, places: int, queries: int) -> list[Figures]:
    """Learn and ask a route on this machine alone; model and figures must have the cluster's bytes."""
    found = []
    for what, words in commands(places, queries, "here").items():
        taken = measured([LAVA_VPR, *words], place)
        found.append(Figures(f"{what}, alone", places, taken.seconds, taken.used, client=taken.held))
    for suffix in ("lvpr", "json"):
        if (place / f"here.{suffix}").read_bytes() != (place / f"there.{suffix}").read_bytes():
            raise SystemExit(f"{places} places: {suffix} of the cluster and of one machine differ")
    console.print(f"{places:,} places: model and figures have the bytes of one machine")
    return found


@click.command()
@click.option("--places", "sizes", type=int, multiple=True, default=(1000, 3000, 10000), show_default=True)
@click.option("--alone", "compared", type=int, multiple=True, default=(1000,), show_default=True)
@click.option("--queries", type=int, default=500, show_default=True)
@click.option("--workers", type=int, default=2, show_default=True)
@click.option("--json", "file", type=click.Path(path_type=Path), default=None)
def main(sizes: Sequence[int], compared: Sequence[int], queries: int, workers: int, file: Path | None) -> None:
    """Print what long routes take at a cluster."""
    table = Table(title=f"{workers} workers of one thread on one machine", title_justify="left")
    for name in ("", "places", "s", "client's processor s", "MB sent", "client MB", "scheduler MB", "worker MB"):
        table.add_column(name, justify="right" if name else "left")
    found: list[Figures] = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        write_traverses(place / "world", max(sizes), 0)
        for places in sizes:
            found += run(place, places, queries, workers)
            found += alone(place, places, queries) if places in compared else []
    for one in found:
        memory = (
            f"{number / 1e6:.0f}" if number else "" for number in (one.sent, one.client, one.scheduler, one.worker)
        )
        table.add_row(one.what, f"{one.places:,}", f"{one.seconds:.1f}", f"{one.processor_s:.1f}", *memory)
    console.print(table)
    if file is not None:
        file.write_text(json.dumps([asdict(one) for one in found], indent=1) + "\n")


if __name__ == "__main__":
    main()
