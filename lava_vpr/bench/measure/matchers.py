"""Speed of matchers on the processor: each with single queries, and all of them in turns.

Single queries run one after another on one thread, as a robot sends them; in a batch each takes less time. In turns,
all matchers answer the same places and queries in one run; queries per second count from preprocessed input to match,
all queries in one batch shared among threads. Each matcher has its own fast form: SAD in 8-bit integers, cosine as a
float32 matrix product. More matchers can join the same rounds (`run_peers`, ``others``): `make peers` adds others.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Callable, Iterator, Sequence, Sized
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import HostBackend
from lava_vpr.backends.rivals import BASELINES, Rivals, chosen
from lava_vpr.bench.measure.child import decoder_of, host_answer, singles
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Peer
from lava_vpr.cluster.tasks import Pool
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import biases, schedule, slopes, start_membranes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import cores, share
from lava_vpr.kernelcache import compiled
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import Model, checked_network
from lava_vpr.recognition import Recognition
from lava_vpr.training.templates import template_of

Places = NDArray[np.int64]
PartAnswer = Callable[[slice], Places]
"""A function from a part of the queries to their places."""

BATCH = 2048
"""Fewest queries of a batch; queries are repeated to reach it. With a hundred, the start of the threads would dominate
the time."""
FILL = 0.3
"""Shortest round in seconds; batches are repeated to reach it."""
SINGLES, SECONDS = 1000, 1.0
"""Most single queries that are timed, and the longest time for them in seconds."""

WHAT = {
    "lava-vpr": "this model on the host engine: input spikes drawn, network run, spikes decoded; sees the input rates",
    "sad": "sum of absolute differences of patch-normalised 28x28 images (Milford and Wyeth 2012), 8-bit integers",
    "cosine": "nearest neighbour by cosine of the network's own input rates, float32 matrix product",
    "hog": "cosine of OpenCV's HOG of 64x64 grey images, its own settings (Dalal and Triggs 2005), float32",
    "template": "the same network without learning, the references' rates as weights, one neuron a place; as lava-vpr",
    "vectors": f"nearest neighbour by cosine of {BASELINES['vectors']}, float32 matrix product",
    "standardised": f"nearest neighbour by cosine of {BASELINES['standardised']}, float32 matrix product",
}
"""This model and every baseline in words."""


@dataclass(frozen=True)
class TimedMatcher:
    """A matcher to be timed.

    Attributes:
        name: Its name, as in `Peer`.
        what: The matcher in words, as in `Peer`.
        bytes: Bytes that it stores of the references.
        answer: A function from a part of the queries, repeated `repeats` times, to their places.
        metrics: Its recall.
    """

    name: str
    what: str
    bytes: int
    answer: PartAnswer
    metrics: Metrics


def repeats(queries: Sized) -> int:
    """How often ``queries`` are repeated for a batch of at least `BATCH`."""
    return max(1, -(-BATCH // len(queries)))


@compiled(nogil=True)
def _sad(references: NDArray[np.uint8], queries: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Negative sums of absolute differences, so that the nearest reference scores highest: (queries, references) of
    uint8 rows."""
    out = np.empty((queries.shape[0], references.shape[0]), np.int32)
    for q in range(queries.shape[0]):
        for r in range(references.shape[0]):
            total = np.int32(0)
            for i in range(queries.shape[1]):
                total = np.int32(total - abs(np.int32(queries[q, i]) - np.int32(references[r, i])))
            out[q, r] = total
    return out


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit matrix products of this process to one thread, where that can be set; `share` distributes the queries."""
    try:
        pools = importlib.import_module("threadpoolctl")  # comes with scikit-learn, which Lava needs
    except ImportError:
        yield
        return
    with pools.threadpool_limits(limits=1, user_api="blas"):
        yield


def _grouped(labels: NDArray[np.int64], places: int) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """The order that brings each place's references together, and where each place begins; None: one reference per
    place, in order."""
    if np.array_equal(labels, np.arange(places)):
        return labels, None
    order = np.argsort(labels, kind="stable")
    return order, np.searchsorted(labels[order], np.arange(places))


def _unit(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows of length 1, or of zeros."""
    lengths = np.sqrt(np.einsum("ij,ij->i", rows, rows))[:, None]
    return np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)


def _nearest(model: Model, references: NDArray[Any], queries: NDArray[Any], by_sad: bool) -> tuple[PartAnswer, int]:
    """A function to the nearest place among the model's ``references``, and the bytes stored for it.

    By SAD, both uint8 (images, h, w), or by cosine, both (images, n).
    """
    order, starts = _grouped(model.labels, model.places)
    if by_sad:
        kept, asked = (np.ascontiguousarray(seen.reshape(len(seen), -1)) for seen in (references[order], queries))
    else:  # a query's own length does not move its maximum
        kept, asked = _unit(references[order].astype(np.float32)), queries.astype(np.float32)

    def answer(part: slice) -> Places:
        values = _sad(kept, asked[part]) if by_sad else asked[part] @ kept.T
        near = values if starts is None else np.maximum.reduceat(values, starts, axis=1)
        return np.asarray(near.argmax(axis=1))

    return answer, kept.nbytes


def _kept(model: Model) -> int:
    """Bytes of the model's network and S^R as the host holds them."""
    network = model.network
    arrays = (network.weights, network.theta_mv, network.delays) if isinstance(network, ConductanceState) else None
    return sum(array.nbytes for array in arrays or (network.weights,)) + model.responses.nbytes


def answer_of(queries: QuerySet, name: str, times: int = 1) -> tuple[PartAnswer, int]:
    """The function by which ``lava-vpr`` (this model) or a baseline answers ``queries``, repeated ``times`` times, and
    the bytes stored.

    Raises:
        ConfigError: the model cannot be compared with this baseline.
        InputError: the queries were encoded without what it compares.
    """
    model, rates = queries.model, queries.shown.rates
    if name in ("lava-vpr", "template"):
        network = template_of(model, Pool(cores())) if name == "template" else model
        of_rates, shown = host_answer(network, queries.shown.seed), np.concatenate([rates] * times)
        return lambda part: of_rates(shown[part]), _kept(network)
    chosen(model, (name,))
    seen, references = Rivals(model, queries.images, queries.shown, (name,)).seen(name)
    return _nearest(model, references, np.concatenate([seen] * times), name == "sad")


def alone(queries: QuerySet, name: str) -> float:
    """Median time in ms of single queries, answered as in `answer_of`."""
    first = slice(SINGLES)
    some = QuerySet(queries.model, queries.images.take(first), queries.shown.part(first))
    answer, _ = answer_of(some, name)
    return _median(lambda k: answer(slice(k, k + 1)), len(some))


def _median(answer: Callable[[int], object], queries: int) -> float:
    """The median time in ms of a query; ``answer`` is called with its number."""

    def of_one(chosen: NDArray[np.int64]) -> Places:
        answer(int(chosen[0]))
        return chosen

    with one_blas_thread():
        of_one(np.zeros(1, np.int64))  # what is compiled or prepared at the first use is not timed
        return float(np.median(singles(of_one, np.arange(queries), SINGLES, SECONDS)))


def beside_board(queries: QuerySet) -> float:
    """Median time in ms of the host's own work for a query that a board answers, encoding and traffic apart.

    The host draws input spikes, or computes the settings of inputs, and decodes spike counts. Where neurons hear the
    cells of a front end directly, it only decodes.

    Raises:
        ConfigError: the model has no integer network.
    """
    network, match = checked_network(queries.model, "bench", direct=True), decoder_of(queries.model)
    counts, _ = HostBackend().count_spikes(queries.model, queries.shown.part(slice(1)))
    rates, keys = queries.shown.rates, queries.shown.keys

    def work(k: int) -> None:
        if not network.direct:
            _draw(network, rates[k], keys[k])
        match(counts)

    return _median(work, len(queries))


def _draw(network: FixedNetwork, rates: NDArray[np.uint16], key: np.uint64) -> None:
    """Compute what the host sends for a presentation: input spikes, or settings of the inputs that integrate a bias."""
    if network.bias_input:
        biases(rates)
        start_membranes(int(key), len(rates))
    elif network.regular:
        schedule(slopes()[rates], key, network.steps)
    else:
        poisson_spikes(rates, key, network.steps)


def _round(matcher: TimedMatcher, queries: int, repeats: int, threads: int) -> float:
    """Seconds that ``repeats`` batches of ``queries`` take."""

    def answered(part: slice) -> None:
        for _ in range(repeats):
            matcher.answer(part)

    began = time.perf_counter()
    share(answered, queries, threads)
    return time.perf_counter() - began


def _rates(matchers: Sequence[TimedMatcher], queries: int, threads: int, rounds: int, fill: float) -> list[float]:
    """Queries per second of each matcher, the fastest of ``rounds``; matchers take turns, because other programs may
    run meanwhile."""
    repeats = []
    for matcher in matchers:
        matcher.answer(slice(0, 2))  # what is compiled at the first use is not timed
        once = _round(matcher, queries, 1, threads)
        repeats.append(max(1, int(np.ceil(fill / max(once, 1e-6)))))
    best = [np.inf] * len(matchers)
    for _ in range(rounds):
        for k, (matcher, times) in enumerate(zip(matchers, repeats, strict=True)):
            best[k] = min(best[k], _round(matcher, queries, times, threads) / times)
    return [queries / seconds for seconds in best]


def run_peers(
    queries: QuerySet,
    known: Recognition,
    *,
    threads: int | None = None,
    rounds: int = 5,
    fill: float = FILL,
    others: Sequence[TimedMatcher] = (),
) -> tuple[Peer, ...]:
    """Recall and speed of lava-vpr and the baselines on the same places and queries.

    Args:
        queries: Queries to a trained model, at least one.
        known: Recall of the model and all its baselines on these queries.
        threads: Threads that share the queries; None: one for each processor.
        rounds: Number of rounds; the fastest counts.
        fill: Shortest round in seconds.
        others: More matchers, which take turns with these.
    Returns:
        lava-vpr first, ``others`` last.
    """
    workers, times = threads if threads is not None else cores(), repeats(queries)
    recall = {"lava-vpr": known.metrics[known.default]} | {k: known.metrics[k] for k in chosen(queries.model, None)}
    with one_blas_thread():
        made = [(name, *answer_of(queries, name, times), metrics) for name, metrics in recall.items()]
        matchers = [TimedMatcher(name, WHAT[name], size, answer, metrics) for name, answer, size, metrics in made]
        matchers += others
        rates = _rates(matchers, len(queries) * times, workers, rounds, fill)
    return tuple(
        Peer(matcher.name, matcher.what, matcher.metrics, rate, workers, matcher.bytes, len(queries))
        for matcher, rate in zip(matchers, rates, strict=True)
    )
