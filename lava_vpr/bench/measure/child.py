"""The work of the fresh processes of `bench.measure.timing`: answer queries, and report times and peak memory."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.backends import deployed
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.deploy.bundle import effort
from lava_vpr.deploy.bundle.targets import TARGETS, open_whole
from lava_vpr.engine.inference import counting
from lava_vpr.engine.presentations import share
from lava_vpr.isolated.child import own_peak
from lava_vpr.matching.decoders import best
from lava_vpr.model import Model, as_integer, checked_network, prepare

Arrays = dict[str, NDArray[Any]]
Answer = Callable[[NDArray[Any]], NDArray[np.int64]]
"""A function from rates (n, inputs) to the matched places (n,)."""


def decoder_of(model: Model) -> Callable[[NDArray[np.int32]], NDArray[np.int64]]:
    """The model's decoder: a function from spike counts (n, neurons) to matched places (n,)."""
    scores_of = prepare(model)
    return lambda counts: best(scores_of(counts))


def host_answer(model: Model, seed: int) -> Answer:
    """A function that answers queries on the host engine, one thread; it checks and prepares the network once."""
    match = decoder_of(model)
    if as_integer(model) is None:
        host = HostBackend()
        return lambda rates: match(host.count_spikes(model, Presentations(rates, seed))[0])
    network = checked_network(model, "host", direct=True)
    return lambda rates: match(counting.count_spikes(network, rates, Presentations(rates, seed).keys)[0])


def bundle_answer(folder: Path, seed: int) -> Answer:
    """A function that answers queries by simulating a bundle's registers and memory, which are read once."""
    bundle, model = open_whole(folder)
    match, play = decoder_of(model), TARGETS[bundle.target].player(bundle)
    size = effort.together(checked_network(model, "bundle"), deployed.BATCH)

    def answer(rates: NDArray[Any]) -> NDArray[np.int64]:
        keys = Presentations(rates, seed).keys
        parts = [slice(k, k + size) for k in range(0, len(rates), size)]
        counts = [play(rates[part], keys[part]).exc.sum(axis=1, dtype=np.int32) for part in parts]
        return match(np.concatenate(counts))

    return answer


def singles(answer: Answer, rates: NDArray[Any], count: int, seconds: float) -> list[float]:
    """Milliseconds of one query after another, ``count`` or as many as fit ``seconds``, the first again after the last.

    A query that is answered again draws the same noise again.
    """
    taken, end = [], time.monotonic() + seconds
    for k in range(count):
        i = k % len(rates)
        rate = rates[i : i + 1]
        began = time.perf_counter()
        answer(rate)
        taken.append(1e3 * (time.perf_counter() - began))
        if time.monotonic() > end:
            break
    return taken


def batch(answer: Answer, rates: NDArray[Any], threads: int) -> NDArray[np.int64]:
    """The answers of all queries in one batch, shared among threads."""
    return np.concatenate(share(lambda part: answer(rates[part]), len(rates), threads))


def measure(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Answer queries of ``rates`` (n, inputs), one by one and all together.

    Args:
        arrays: See above.
        options: ``backend`` (``host`` or ``bundle``), ``path`` of the model or bundle, ``seed``, ``singles`` and
            ``seconds`` (see `singles`), ``threads``, ``rounds`` of the batch, and ``fill``: seconds that a batch should
            take at least, for which queries are repeated.
    Returns:
        ``milliseconds`` float64 (k,); ``rounds`` float64 (rounds, 2): begin and end in seconds of `time.monotonic`;
        ``batch`` int64 (1,): presentations in a round; ``matches`` int64 (n,); ``peak`` int64 (1,), 0 if not known.
    """
    path, seed, threads = Path(options["path"]), int(options["seed"]), int(options["threads"])
    on_host = options["backend"] == "host"
    answer = host_answer(model_file.load(path), seed) if on_host else bundle_answer(path, seed)
    rates = arrays["rates"]
    answer(rates[:1])  # what is compiled or read at the first use is not timed
    milliseconds = singles(answer, rates, int(options["singles"]), float(options["seconds"]))
    matches = batch(answer, rates, threads)
    each = float(np.median(milliseconds)) * 1e-3 / threads
    times = max(1, int(np.ceil(float(options["fill"]) / (each * len(rates)))))
    whole = np.tile(rates, (times, 1))
    rounds = []
    for _ in range(int(options["rounds"])):
        began = time.monotonic()
        batch(answer, whole, threads)
        rounds.append((began, time.monotonic()))
    return {
        "milliseconds": np.array(milliseconds),
        "rounds": np.array(rounds),
        "batch": np.array([len(whole)]),
        "matches": matches,
        "peak": np.array([own_peak() or 0]),
    }
