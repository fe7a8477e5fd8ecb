"""Long synthetic routes, learned and asked by the workers of a Dask cluster on this machine.

    python -m benchmarks commands.long_routes [--places 1000 ...] [--queries 500] [--alone 1000 ...] [--record]

A scheduler and workers of one thread each run as processes on the loopback address; ``lava-vpr train --cluster`` and
``eval --cluster`` are processes, too. Bytes are those of the loopback device, as the kernel counts them: what goes over
the scheduler counts twice, and whatever else uses the device counts, too (`unshare --net` gives a run its own). Memory
is the most that a process held at any time; scheduler and workers are started again for each route. ``--alone`` learns
and asks on as many threads without a cluster, too, and compares the bytes of model and figures.

``--paper`` says what longer routes would take by the same work: an image, a stretch of 100 places and a query are timed
here, on one processor, the query in a network whose neurons are those of a learned map again and again; all else is
sizes of arrays.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import numpy as np
import psutil

from benchmarks.commands.running import CommandRun, lava_vpr
from benchmarks.program import BenchmarkTable, Printed, elapsed, program, turns
from lava_vpr.backends.interface import query_presentations
from lava_vpr.config import preset
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.model import integer_model
from lava_vpr.show.numbers import figure, size
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.synthetic import write_traverses
from lava_vpr.training.loop import train
from lava_vpr.training.stretches import Lesson, learned
from lava_vpr.traverse import open_traverse

STRETCH, QUERIES = 100, 10
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
    """Learn and ask a route on this machine alone; the model must have the cluster's bytes, and the same figures."""
    runs = {what: lava_vpr(place, *words) for what, words in commands(places, queries, "here").items()}
    here, there = ((place / f"{name}.lvpr").read_bytes() for name in ("here", "there"))
    if here != there:
        raise SystemExit(f"{places} places: the models of the cluster and of one machine differ")
    single, shared = (json.loads((place / f"{name}.json").read_bytes()) for name in ("here", "there"))
    if single | {"model": ""} != shared | {"model": ""}:
        raise SystemExit(f"{places} places: figures of the cluster and of one machine differ")
    return [row(f"`{what}`, no cluster", places, run) for what, run in runs.items()]


PAPER = (10_000, 100_000)
"""Places of the routes on paper."""


def unit_costs(place: Path) -> dict[object, float]:
    """Seconds of a processor for an image, a stretch, and a query in a map of each of `PAPER`, the least of turns."""
    write_traverses(place / "world", STRETCH, 0)
    traverse, config = open_traverse(place / "world" / "reference"), preset("loihi")
    images = encode_traverse(traverse, config.encoder, Keep.ALL)
    model = integer_model(train([images], config), "long routes")
    shown, network = query_presentations(model, images.take(slice(QUERIES))), model.network
    timed: dict[object, Callable[[], object]] = {
        "image": lambda: encode_traverse(traverse, config.encoder, Keep.ALL),
        "stretch": lambda: learned(config, Lesson(model.stretches[0], images.activity[None], 0, {})),
    }
    for places in PAPER:
        again = {name: np.tile(getattr(network, name), places // len(network.bias)) for name in ("weights", "bias")}
        timed[places] = partial(count_spikes, replace(network, **again), shown.rates, shown.keys)
    taken = turns({name: elapsed(run, time.process_time) for name, run in timed.items()}, 3)
    counts = {"image": STRETCH, "stretch": 1, **dict.fromkeys(PAPER, QUERIES)}
    return {name: min(values) / counts[name] for name, values in taken.items()}


def on_paper(unit: Mapping[object, float]) -> BenchmarkTable:
    """What routes of `PAPER` places would take."""
    inputs = preset("loihi").encoder.inputs
    whole = {places: 4 * inputs * places for places in PAPER}
    linear, square = "with places", "with their square"
    made: Sequence[tuple[str, str, Callable[[int], str]]] = (
        ("reading and encoding, client", linear, lambda n: f"{figure(n * unit['image'], 2)} s"),
        ("learning, workers, s of a processor", linear, lambda n: figure(n / STRETCH * unit["stretch"], 2)),
        ("activity and weights sent, each, over the scheduler", linear, lambda n: size(2 * whole[n])),
        ("network, each worker", linear, lambda n: size(whole[n] // 2)),
        (
            "reference responses, workers, s of a processor",
            f"{square}: a query a place",
            lambda n: figure(n * unit[n], 2),
        ),
        ("responses that come back", f"{square}, if one neuron in a hundred spikes", lambda n: size(8 * n * n // 100)),
        ("activity, learned weights and network, client", linear, lambda n: size(5 * whole[n] // 2)),
        ("reference responses, client and model", f"{square}: 2 bytes each", lambda n: size(2 * n * n)),
        ("the checkpoint, written again and again", linear, lambda n: size(whole[n])),
        ("a query, ms of a processor", linear, lambda n: figure(1e3 * unit[n], 2)),
    )
    rows = [[what, grows, *map(of, PAPER)] for what, grows, of in made]
    return BenchmarkTable(["what", "grows", *(f"at {n:,}" for n in PAPER)], rows, words=2, record="cluster-paper")


@program()
@click.option("--places", "sizes", type=int, multiple=True, default=(1000, 3000, 10000), show_default=True)
@click.option("--alone", "compared", type=int, multiple=True, default=(1000,), show_default=True)
@click.option("--queries", type=int, default=500, show_default=True)
@click.option("--workers", type=int, default=2, show_default=True)
@click.option("--paper", is_flag=True, help="What longer routes would take, on paper, and nothing else.")
def main(sizes: Sequence[int], compared: Sequence[int], queries: int, workers: int, paper: bool) -> Printed:
    """What long routes take at a cluster."""
    rows = []
    with temporary_folder() as place:
        if paper:
            yield on_paper(unit_costs(place))
            return
        write_traverses(place / "world", max(sizes), 0)
        few = min(STRETCH, *sizes)
        for words in commands(few, few, "first").values():  # kernels are compiled before anything is timed
            lava_vpr(place, *words)
        for places in sizes:
            rows += at_cluster(place, places, queries, workers)
            rows += alone(place, places, queries) if places in compared else []
    memory = ("MB sent", "client MB", "scheduler MB", "worker MB")
    yield BenchmarkTable(["", "places", "s", "client's processor s", *memory], rows, record="cluster")
