"""Time, memory and energy of queries on each backend, measured on this machine; nothing here is modelled.

A single query is timed from its input rates to its matched place (spikes drawn, network run, counts decoded), in
batches of 1 on one thread, without what a program does once at its start. Throughput is that of all queries in one
batch.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.backends import deployed, registry as backends
from lava_vpr.backends.interface import FromPixels, Presentations
from lava_vpr.backends.lava import LavaBackend
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.bench.measure import board_power, rapl
from lava_vpr.bench.measure.child import decoder_of
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Measured
from lava_vpr.config import Config
from lava_vpr.encoding import activity_of
from lava_vpr.engine.presentations import cores
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import BackendUnavailableError, LavaVprError
from lava_vpr.inputs.vectors import Standard
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.localizer import Localizer
from lava_vpr.model import Model
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.traverse import Traverse

SINGLES, SINGLE_SECONDS = 1000, 8.0
ROUNDS, FILL = 5, 0.3
TIMEOUT = 600.0
_BLAS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def measure(
    queries: QuerySet,
    backend: str,
    *,
    limit: int | None = None,
    rounds: int = ROUNDS,
    rapl_root: Path = rapl.ROOT,
) -> Measured:
    """Time a backend in fresh processes.

    Args:
        queries: Queries to a trained model.
        backend: Name in `lava_vpr.backends.registry.BACKENDS`.
        limit: Most queries to use; None: the limit of the backend's row.
        rounds: How often the whole batch is answered; the fastest counts.
        rapl_root: Folder of the processor's energy counters.
    Returns:
        The figures; ``absent`` says why there are none. A backend that this machine lacks raises no error.
    """
    row = BACKENDS[backend]
    model, shown = queries.model, queries.shown.part(slice(0, limit if limit is not None else row.limit))
    made = Measured(backend, row.title, queries=len(shown.rates))
    on_board = row.timing == "board"
    try:
        backends.require(backend, model)
        if made.queries == 0:
            return replace(made, absent="there are no queries")
        if backend != "host" and model.config.encoder.direct is not None:
            return replace(made, absent="from pixels to places nothing but the host engine is timed")
        if on_board:
            return board_power.measure(model, shown, backend)
        if row.timing == "compiled":
            return _compiled(model, shown, made, rounds, rapl_root)
        return _lava(model, shown, made, row.batch, rapl_root)
    except LavaVprError as error:
        missing = on_board and isinstance(error, BackendUnavailableError)
        return replace(made, queries=0, absent=f"no board here: {error}" if missing else str(error))


def _with_energy(
    made: Measured, meter: rapl.Meter, spans: NDArray[np.float64], presentations: float, watts: float | None
) -> Measured:
    """``made`` with the energy of a presentation and the counters that gave it, or the reason why there is none.

    Args:
        made: All other figures.
        meter: The meter that was open during the runs.
        spans: Begin and end of each run, in seconds.
        presentations: Presentations in all runs.
        watts: The idle power; None: unknown.
    """
    parts = [meter.joules(float(began), float(ended)) for began, ended in spans]
    spent = [part for part in parts if part is not None]
    if len(spent) < len(parts):
        return replace(made, no_energy=meter.reason)
    idle = "" if watts is None else f", which draw {watts:.1f} W when this program does nothing (not subtracted)"
    what = f"{made.what}; energy of {meter.sources}{idle}"
    return replace(made, what=what, joules_per_query=sum(spent) / presentations)


@contextlib.contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Limit matrix products to one thread in processes that are started meanwhile; these share queries among threads
    themselves."""
    before = {name: os.environ.get(name) for name in _BLAS}
    os.environ.update(dict.fromkeys(_BLAS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _on_disk(model: Model, backend: str) -> Iterator[Path]:
    """The path at which a fresh process finds the model or its bundle."""
    if backend == "bundle":
        with deployed.bundle_of(model) as bundle:
            yield bundle.path
        return
    with temporary_folder() as folder:
        path = folder / "model.lvpr"
        model_file.save(model, path)
        yield path


def _compiled(model: Model, shown: Presentations, made: Measured, rounds: int, rapl_root: Path) -> Measured:
    """The figures of the host engine, or of a bundle's simulation, timed in fresh processes."""
    threads = cores() if made.name == "host" else 1
    watts = rapl.idle_watts(root=rapl_root)
    options = {"backend": made.name, "seed": shown.seed, "threads": threads, "rounds": rounds}
    options |= {"singles": SINGLES, "seconds": SINGLE_SECONDS, "fill": FILL if made.name == "host" else 0.0}
    with _on_disk(model, made.name) as path, _one_blas_thread(), rapl.Meter(rapl_root) as meter:
        timed = run_isolated(
            "lava_vpr.bench.measure.child:measure",
            {"rates": shown.rates},
            options | {"path": str(path.absolute())},
            timeout=TIMEOUT,
        )
    spans, size = timed["rounds"], int(timed["batch"][0])
    times = size // made.queries
    repeats = f", each {times} times" if times > 1 else ""
    made = replace(
        made,
        what=f"{made.what}; input rates to match, spikes drawn; in one batch all queries{repeats}",
        threads=threads,
        queries_per_second=size / float((spans[:, 1] - spans[:, 0]).min()),
        milliseconds=tuple(sorted(float(x) for x in timed["milliseconds"])),
        peak_bytes=int(timed["peak"][0]) or None,
    )
    return _with_energy(made, meter, spans, size * len(spans), watts)


def _lava(model: Model, shown: Presentations, made: Measured, least: int, rapl_root: Path) -> Measured:
    """The figures of Lava, timed with one query per run and with many queries per run, without compiling and
    starting."""
    backend = backends.get(made.name)
    backend = backend.alone if isinstance(backend, FromPixels) else backend
    if not isinstance(backend, LavaBackend):
        return replace(made, absent=f"{made.name} cannot be timed")
    watts = rapl.idle_watts(root=rapl_root)
    # The first run is the start of Lava, so there is one query more than is timed.
    queries = shown.part(np.concatenate([[0], np.arange(len(shown.rates))]))
    n = len(queries.rates)
    counts, alone, _ = backend.timed(model, queries, single=True)
    more = Presentations.joined([queries] * -(-least // n))
    with rapl.Meter(rapl_root) as meter:
        again, together, held = backend.timed(model, more, single=False)
    match, decoded = decoder_of(model), []
    match(counts[:1])
    for k in range(1, n):
        began = time.perf_counter()
        match(counts[k : k + 1])
        decoded.append(1e3 * (time.perf_counter() - began))
    milliseconds = 1e3 * (alone[1:, 2] - alone[1:, 1]) + np.array(decoded)
    later = together[1:] if len(together) > 1 else together[:0]
    presented, seconds = float(later[:, 0].sum()), float((later[:, 2] - later[:, 1]).sum())
    start = float(alone[0, 2] - alone[0, 1])
    if not np.array_equal(counts, again[: len(counts)]):
        return replace(made, absent="two runs of the same queries gave different spikes; see lava-vpr verify")
    made = replace(
        made,
        what=f"{made.what}; input rates to match, spikes drawn; Lava's start, {start:.1f} s with its first query, is "
        "not in it; memory of all its processes together",
        threads=cores(),
        queries_per_second=presented / seconds if seconds else None,
        milliseconds=tuple(sorted(milliseconds.tolist())),
        peak_bytes=held,
    )
    if not presented:
        return replace(made, no_energy="too few queries")
    return _with_energy(made, meter, later[:, 1:], presented, watts)


def each_image(traverse: Traverse, work: Callable[[NDArray[Any]], object], limit: int = 200) -> list[float]:
    """Milliseconds for each of at most ``limit`` images to be read from its file and processed by ``work``.

    Raises:
        InputError: an image cannot be read.
    """
    taken = []
    for image in traverse.take([0]).images():
        work(image)  # compile before timing
    images = traverse.take(range(min(limit, len(traverse)))).images()
    began = time.perf_counter()
    for image in images:
        work(image)
        now = time.perf_counter()
        taken.append(1e3 * (now - began))
        began = now
    return taken


def measure_encoding(
    traverse: Traverse, config: Config, limit: int = 200, standard: Standard | None = None
) -> Measured:
    """The figures of the encoding: each image file, or vector, read and turned into input rates, one by one.

    Raises:
        InputError: an image cannot be read.
    """

    def encode(image: NDArray[Any]) -> None:
        query_rates(activity_of(image, config.encoder, standard=standard)[None], config)

    to = "input rates" if config.encoder.direct is None else "bursts of the cells"
    does = f"an image file read, its channels computed, to {to}; one thread"
    if traverse.stored is not None:
        does = "a vector in memory to input rates; one thread; what made it of an image is not in it"
    return _stage("encoding", does, each_image(traverse, encode, limit))


def measure_localizer(traverse: Traverse, model: Model, seed: int | None = None, limit: int = 200) -> Measured:
    """The figures of the public path: each image file read and passed to `Localizer.update`, one by one.

    Raises:
        InputError: an image cannot be read.
    """
    robot = Localizer(model, seed=seed)
    does = "an image file read, and Localizer.update of it: all that a robot waits for; one thread"
    return _stage("localizer", does, each_image(traverse, lambda image: robot.update(image) and None, limit))


def _stage(name: str, does: str, taken: Sequence[float]) -> Measured:
    """The figures of a stage from its milliseconds for each image."""
    return Measured(
        name,
        does,
        queries=len(taken),
        queries_per_second=1e3 * len(taken) / math.fsum(taken) if taken else None,
        milliseconds=tuple(sorted(taken)),
        no_energy="not measured for this stage",
    )
