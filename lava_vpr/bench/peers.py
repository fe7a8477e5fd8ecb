"""Other matchers beside lava-vpr: the same places and queries, one run, one machine, taking turns.

Queries per second count from preprocessed input to match, all queries in one batch shared among threads, each matcher
in a fast form of its own: SAD in 8-bit integers, cosine as a float32 matrix product. More matchers can join the same
rounds (`run_peers`, ``others``): `make peers` adds other systems.
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

from lava_vpr.backends.rivals import BASELINES, chosen, compared
from lava_vpr.bench.measure.child import host_answer
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Peer
from lava_vpr.cluster.tasks import Pool
from lava_vpr.encoding import query_rates
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.presentations import cores, share
from lava_vpr.errors import InputError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.kernelcache import compiled
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.training.templates import template_of

Places = NDArray[np.int64]
Advance = Callable[[str], None]

BATCH = 2048
"""Queries are repeated until a batch has as many: starting threads for a hundred would be timed instead of them."""
FILL = 0.3
"""Seconds that a round takes at least; batches are repeated for it."""


@dataclass(frozen=True)
class TimedMatcher:
    """A matcher whose speed is taken.

    Attributes:
        name: Its name, as in `Peer`.
        what: The matcher in words, as in `Peer`.
        bytes: The bytes that it keeps of the references.
        answer: A function from a part of the queries, repeated `repeats` times, to their places.
        metrics: Its recall.
    """

    name: str
    what: str
    bytes: int
    answer: Callable[[slice], Places]
    metrics: Metrics


def repeats(queries: Sized) -> int:
    """The number of times that ``queries`` are repeated for a batch of at least `BATCH`."""
    return max(1, -(-BATCH // len(queries)))


@compiled(nogil=True)
def _sad(references: NDArray[np.uint8], queries: NDArray[np.uint8], out: NDArray[np.int32]) -> None:
    """Sums of absolute differences: ``out`` (queries, references) of uint8 rows."""
    for q in range(queries.shape[0]):
        for r in range(references.shape[0]):
            total = np.int32(0)
            for i in range(queries.shape[1]):
                total = np.int32(total + abs(np.int32(queries[q, i]) - np.int32(references[r, i])))
            out[q, r] = total


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Matrix products of this process keep to one thread, where that can be set; queries are shared by `share`."""
    try:
        pools = importlib.import_module("threadpoolctl")  # comes with scikit-learn, which Lava needs
    except ImportError:
        yield
        return
    with pools.threadpool_limits(limits=1, user_api="blas"):
        yield


def _grouped(labels: NDArray[np.int64], places: int) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """Order that brings each place's references together, and where each begins; None: one each, in order."""
    if np.array_equal(labels, np.arange(places)):
        return labels, None
    order = np.argsort(labels, kind="stable")
    return order, np.searchsorted(labels[order], np.arange(places))


def sad_answer(model: Model, patches: NDArray[np.uint8]) -> tuple[Callable[[slice], Places], int]:
    """Nearest place of ``patches`` (n, 28, 28) by SAD, and bytes kept."""
    order, starts = _grouped(model.labels, model.places)
    own = np.asarray(model.patches)
    kept = np.ascontiguousarray(own.reshape(len(own), -1)[order])
    flat = np.ascontiguousarray(patches.reshape(len(patches), -1))

    def answer(part: slice) -> Places:
        distances = np.empty((len(flat[part]), len(kept)), np.int32)
        _sad(kept, flat[part], distances)
        near = distances if starts is None else np.minimum.reduceat(distances, starts, axis=1)
        return np.asarray(near.argmin(axis=1))

    return answer, kept.nbytes


def _unit(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows of length 1, or of zeros."""
    lengths = np.sqrt(np.einsum("ij,ij->i", rows, rows))[:, None]
    return np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)


def cosine_answer(model: Model, rates: NDArray[Any]) -> tuple[Callable[[slice], Places], int]:
    """Nearest place of the queries' input ``rates`` (n, inputs) by cosine, and bytes kept."""
    return _nearest_by_cosine(query_rates(model.activity, model.config), rates, model)


def hog_answer(model: Model, hog: NDArray[np.uint8]) -> tuple[Callable[[slice], Places], int]:
    """Nearest place of HOG descriptors ``hog`` (n, 1764) by cosine, and bytes kept."""
    return _nearest_by_cosine(np.asarray(model.hog), hog, model)


def vectors_answer(queries: QuerySet, name: str, times: int) -> tuple[Callable[[slice], Places], int]:
    """Nearest place of the queries' vectors, repeated, by the baseline ``name``, and bytes kept."""
    asked, references = compared(queries.model, queries.images, name)
    return _nearest_by_cosine(references, np.tile(asked, (times, 1)), queries.model)


def _nearest_by_cosine(
    references: NDArray[Any], queries: NDArray[Any], model: Model
) -> tuple[Callable[[slice], Places], int]:
    """Nearest place of ``queries`` by cosine to the model's ``references``, both (images, n), and bytes kept."""
    order, starts = _grouped(model.labels, model.places)
    kept = _unit(references[order].astype(np.float32))
    asked = queries.astype(np.float32)

    def answer(part: slice) -> Places:
        values = asked[part] @ kept.T  # a query's own length does not move its maximum
        near = values if starts is None else np.maximum.reduceat(values, starts, axis=1)
        return np.asarray(near.argmax(axis=1))

    return answer, kept.nbytes


def _kept(model: Model) -> int:
    """Bytes of the model's network and S^R as the host holds them."""
    network = model.network
    arrays = (network.weights, network.theta_mv, network.delays) if isinstance(network, ConductanceState) else None
    return sum(array.nbytes for array in arrays or (network.weights,)) + model.responses.nbytes


def _matchers(queries: QuerySet, known: Recognition) -> list[TimedMatcher]:
    """This model, and every baseline that it can be compared with."""
    model, times = queries.model, repeats(queries)
    rates = np.tile(queries.shown.rates, (times, 1))
    host = host_answer(model, queries.shown.seed)
    cosine, cosine_bytes = cosine_answer(model, rates)
    found = [
        TimedMatcher(
            "lava-vpr",
            "this model on the host engine: input spikes drawn, network run, spikes decoded; sees the input rates",
            _kept(model),
            lambda part: host(rates[part]),
            known.metrics[known.default],
        ),
        TimedMatcher(
            "cosine",
            "nearest neighbour by cosine of the network's own input rates, float32 matrix product",
            cosine_bytes,
            cosine,
            known.metrics["cosine"],
        ),
    ]
    for name in chosen(model, None):
        if name == "sad":
            sad, sad_bytes = sad_answer(model, np.tile(queries.images.kept(Keep.PATCHES, "SAD"), (times, 1, 1)))
            what = (
                "sum of absolute differences of patch-normalised 28x28 images (Milford and Wyeth 2012), 8-bit integers"
            )
            found.insert(1, TimedMatcher("sad", what, sad_bytes, sad, known.metrics["sad"]))
        elif name in ("vectors", "standardised"):
            answer, kept = vectors_answer(queries, name, times)
            what = f"nearest neighbour by cosine of {BASELINES[name]}, float32 matrix product"
            found.append(TimedMatcher(name, what, kept, answer, known.metrics[name]))
        elif name == "hog":
            hog, hog_bytes = hog_answer(model, np.tile(queries.images.kept(Keep.HOG, "HOG"), (times, 1)))
            what = "cosine of OpenCV's HOG of 64x64 grey images, its own settings (Dalal and Triggs 2005), float32"
            found.append(TimedMatcher("hog", what, hog_bytes, hog, known.metrics["hog"]))
        elif name == "template":
            found.append(_template(queries, rates, known))
    return found


def _template(queries: QuerySet, rates: NDArray[Any], known: Recognition) -> TimedMatcher:
    """The network without learning, timed as the model is."""
    template = template_of(queries.model, Pool(cores()))
    host = host_answer(template, queries.shown.seed)
    return TimedMatcher(
        "template",
        "the same network without learning, the references' rates as weights, one neuron a place; as lava-vpr",
        _kept(template),
        lambda part: host(rates[part]),
        known.metrics["template"],
    )


def _round(matcher: TimedMatcher, queries: int, repeats: int, threads: int) -> float:
    """Seconds that ``repeats`` batches of ``queries`` take."""

    def run(part: slice) -> None:
        for _ in range(repeats):
            matcher.answer(part)

    began = time.perf_counter()
    share(run, queries, threads)
    return time.perf_counter() - began


def _rates(matchers: Sequence[TimedMatcher], queries: int, threads: int, rounds: int, fill: float) -> list[float]:
    """Queries per second of each, the fastest of ``rounds``; they take turns, since other programs may run, too."""
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
    truth: NDArray[np.bool_],
    *,
    recognition: Recognition | None = None,
    threads: int | None = None,
    rounds: int = 5,
    fill: float = FILL,
    others: Sequence[TimedMatcher] = (),
    advance: Advance | None = None,
) -> tuple[Peer, ...]:
    """Recall and speed of lava-vpr and the baselines on the same places and queries.

    Args:
        queries: Queries to a trained model.
        truth: bool (n_queries, places).
        recognition: Recall of the model and its baselines on these queries, if known; None: worked out.
        threads: Threads that share the queries; None: one for each processor.
        rounds: The fastest counts.
        fill: Seconds that a round takes at least.
        others: More matchers, which take turns with these.
        advance: Told what comes next.
    Returns:
        lava-vpr first, ``others`` last.
    Raises:
        InputError: there are no queries, or they do not fit the model or the truth.
    """
    model = queries.model
    if len(queries) == 0 or truth.shape != (len(queries), model.places):
        raise InputError(f"{len(queries)} queries, {model.places} places, but ground truth of shape {truth.shape}")
    workers = threads if threads is not None else cores()
    tell: Advance = advance or (lambda text: None)
    tell("recall of lava-vpr and the baselines")
    known = recognition
    if known is None or not {*chosen(model, None), known.default} <= set(known.metrics):
        known = recognise(
            model,
            queries.images,
            truth,
            Comparison(keep_scores=False),
            pool=Pool(workers),
            shown=queries.shown,
        )
    with one_blas_thread():
        matchers = [*_matchers(queries, known), *others]
        tell("speed of each")
        rates = _rates(matchers, len(queries) * repeats(queries), workers, rounds, fill)
    return tuple(
        Peer(matcher.name, matcher.what, matcher.metrics, rate, workers, matcher.bytes, len(queries))
        for matcher, rate in zip(matchers, rates, strict=True)
    )
