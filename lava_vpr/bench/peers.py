"""Other matchers beside lava-vpr: the same places and queries, one run, one machine, taking turns.

Queries per second count from preprocessed input to match, all queries in one batch shared among threads, each matcher
in a fast form of its own: SAD in 8-bit integers, cosine and VPRTempo as float32 matrix products. The reference network
runs in Brian2, in an environment that has it; a few queries, one thread.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

from lava_vpr.bench import vprtempo
from lava_vpr.bench.measure.timed import NOISE, host_answer
from lava_vpr.bench.results import Peer
from lava_vpr.config import ConductanceNetwork, Config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import EncodedTraverse, query_rates
from lava_vpr.engine.conductance.model import ConductanceState, initial_state
from lava_vpr.engine.threads import cores, share
from lava_vpr.errors import BackendUnavailableError, InputError
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.model import Model
from lava_vpr.recognition import BASELINES, Recognition, recognise

Places = NDArray[np.int64]
Advance = Callable[[str], None]

PYTHON = "LAVA_VPR_PEERS"
"""Environment variable that names a Python with Brian2 and lava-vpr."""
REMEDY = (
    f"pip install 'lava-vpr[peers]' adds it; or let {PYTHON} name a Python that has both (in a checkout: make peers)"
)
TIMEOUT = 600.0
BATCH = 2048
"""Queries are repeated until a batch has as many: starting threads for a hundred would be timed instead of them."""
FILL = 0.3
"""Seconds that a round takes at least; batches are repeated for it."""
MODULE = 500
"""Places of one of VPRTempo's modules, which are trained apart (default of the released code)."""

WHATS = {
    "lava-vpr": "this model on the host engine: input spikes drawn, network run, spikes decoded",
    "sad": "sum of absolute differences of patch-normalised 28x28 images (Milford and Wyeth 2012), 8-bit integers",
    "cosine": "nearest neighbour by cosine of the network's own input rates, float32 matrix product",
    "vprtempo": "VPRTempo (Hines et al. 2024) from its equations, its settings, trained here on the model's 28x28 "
    "patch-normalised images; float32 matrix products",
    "brian2": "VPRSNN's network (Hussaini et al. 2022) in Brian2, one thread",
}


@dataclass(frozen=True)
class _Matcher:
    """Something that answers queries, whose speed is taken.

    Attributes:
        name: As in `Peer`.
        bytes: That it keeps of the references.
        answer: From a part of the queries, repeated up to `BATCH`, to their places.
        metrics: Recall.
    """

    name: str
    bytes: int
    answer: Callable[[slice], Places]
    metrics: Metrics


@nb.njit(cache=True, nogil=True)
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
    kept = np.ascontiguousarray(model.patches.reshape(len(model.patches), -1)[order])
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
    order, starts = _grouped(model.labels, model.places)
    kept = _unit(query_rates(model.activity, model.config)[order].astype(np.float32))
    given = rates.astype(np.float32)

    def answer(part: slice) -> Places:
        values = given[part] @ kept.T  # a query's own length does not move its maximum
        near = values if starts is None else np.maximum.reduceat(values, starts, axis=1)
        return np.asarray(near.argmax(axis=1))

    return answer, kept.nbytes


def train_modules(model: Model, seed: int = 0) -> tuple[vprtempo.VprTempo, ...]:
    """VPRTempo on the model's references, in modules of at most `MODULE` places, in order."""
    spikes = vprtempo.input_spikes(model.patches)
    modules = []
    for first in range(0, model.places, MODULE):
        own = (model.labels >= first) & (model.labels < first + MODULE)
        modules.append(vprtempo.train(spikes[own], model.labels[own] - first, seed=seed))
    return tuple(modules)


def _vprtempo(model: Model, queries: EncodedTraverse, truth: NDArray[np.bool_], patches: NDArray[np.uint8]) -> _Matcher:
    """VPRTempo, trained now; the best amplitude is the confidence."""
    modules = train_modules(model)

    def scores_of(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        spikes = vprtempo.input_spikes(images)
        return np.concatenate([module.scores(spikes) for module in modules], axis=1)

    scores = scores_of(queries.patches).astype(np.float64)
    metrics = evaluate(scores, scores.max(axis=1), truth)
    kept = sum(module.nbytes for module in modules)
    return _Matcher("vprtempo", kept, lambda part: scores_of(patches[part]).argmax(axis=1), metrics)


def _kept(model: Model) -> int:
    """Bytes of the model's network and S^R as the host holds them."""
    network = model.network
    arrays = (network.weights, network.theta_mv, network.delays) if isinstance(network, ConductanceState) else None
    return sum(array.nbytes for array in arrays or (network.weights,)) + model.responses.nbytes


def _matchers(
    model: Model, queries: EncodedTraverse, truth: NDArray[np.bool_], known: Recognition, seed: int, advance: Advance
) -> list[_Matcher]:
    """All but Brian2, each with the queries repeated up to `BATCH`."""
    times = max(1, -(-BATCH // len(queries)))
    rates = query_rates(queries.activity, model.config)
    again, patches = np.tile(rates, (times, 1)), np.tile(queries.patches, (times, 1, 1))
    ids = np.concatenate([queries.indices + k * NOISE for k in range(times)])
    own = host_answer(model, seed)
    sad, sad_bytes = sad_answer(model, patches)
    cosine, cosine_bytes = cosine_answer(model, again)
    advance("VPRTempo learns the references")
    return [
        _Matcher("lava-vpr", _kept(model), lambda part: own(again[part], ids[part]), known.metrics[known.default]),
        _Matcher("sad", sad_bytes, sad, known.metrics["sad"]),
        _Matcher("cosine", cosine_bytes, cosine, known.metrics["cosine"]),
        _vprtempo(model, queries, truth, patches),
    ]


def _round(matcher: _Matcher, queries: int, repeats: int, threads: int) -> float:
    """Seconds that ``repeats`` batches of ``queries`` take."""

    def run(part: slice) -> None:
        for _ in range(repeats):
            matcher.answer(part)

    began = time.perf_counter()
    share(run, queries, threads)
    return time.perf_counter() - began


def _rates(matchers: list[_Matcher], queries: int, threads: int, rounds: int, fill: float) -> list[float]:
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


def interpreter() -> str | None:
    """A Python with Brian2: named by `PYTHON`, this one, or the checkout's ``.venv-peers``; None: there is none."""
    named = os.environ.get(PYTHON)
    if named:
        return named
    if importlib.util.find_spec("brian2") is not None:
        return sys.executable
    made = Path(__file__).parents[2] / ".venv-peers" / "bin" / "python"
    return str(made) if made.exists() else None


def _reference(model: Model) -> tuple[Config, ConductanceState, str]:
    """The reference network: the model's own if it is one, else untrained; and what to say of it."""
    if isinstance(model.network, ConductanceState) and isinstance(model.config.network, ConductanceNetwork):
        return model.config, model.network, "this model's own network, frozen"
    config = preset("paper")
    return config, initial_state(config, model.patches[0].size), "untrained and frozen: speed only, recall not computed"


def in_brian2(
    config: Config, state: ConductanceState, rate_hz: NDArray[np.float64], python: str, timeout: float = TIMEOUT
) -> dict[str, Any]:
    """Present ``rate_hz`` (n, inputs) to the frozen network in another Python: version, seconds and spikes of each.

    Raises:
        BackendUnavailableError: it cannot be started, lacks Brian2 or lava-vpr, fails, or takes too long.
    """
    with tempfile.TemporaryDirectory(prefix="lava-vpr-") as name:
        folder = Path(name)
        np.savez(
            folder / "given.npz", weights=state.weights, theta_mv=state.theta_mv, delays=state.delays, rate_hz=rate_hz
        )
        (folder / "config.json").write_text(json.dumps(to_dict(config)), encoding="utf-8")
        command = [python, "-m", "lava_vpr.bench.brian2_reference", str(folder)]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
        except OSError as error:
            raise BackendUnavailableError(f"{python}: cannot be started ({error.strerror}); {REMEDY}") from None
        except subprocess.TimeoutExpired:
            raise BackendUnavailableError(
                f"{python}: Brian2 took more than {timeout:.0f} s; give fewer queries"
            ) from None
        if done.returncode or not (folder / "found.json").is_file():
            last = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
            raise BackendUnavailableError(f"{python}: Brian2 did not run ({last}); {REMEDY}")
        found: dict[str, Any] = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    return found


def brian2_peer(model: Model, queries: EncodedTraverse, limit: int, python: str | None = None) -> Peer:
    """The reference network in Brian2 on the first ``limit`` queries; ``absent`` says why it did not run."""
    blank = Peer("brian2", WHATS["brian2"])
    chosen = python or interpreter()
    if chosen is None:
        return replace(blank, absent=f"Brian2 is not installed; {REMEDY}")
    config, state, which = _reference(model)
    network = config.network
    silent = f" and {network.rest_steps} of rest" if isinstance(network, ConductanceNetwork) else ""
    patches = queries.patches[:limit].reshape(min(limit, len(queries)), -1)
    try:
        found = in_brian2(config, state, patches * (config.encoder.max_rate_hz / 255.0), chosen)
    except BackendUnavailableError as error:
        return replace(blank, absent=str(error))
    seconds = found["seconds"]
    return replace(
        blank,
        what=f"{blank.what}, version {found['version']}; {len(state.theta_mv)} neurons, {which}; "
        f"a query has {network.steps} steps with input{silent}",
        queries_per_second=1.0 / float(np.median(seconds)),
        bytes=state.weights.nbytes + state.theta_mv.nbytes + state.delays.nbytes,
        queries=len(seconds),
    )


def run_peers(
    model: Model,
    queries: EncodedTraverse,
    truth: NDArray[np.bool_],
    *,
    recognition: Recognition | None = None,
    seed: int | None = None,
    threads: int | None = None,
    rounds: int = 5,
    fill: float = FILL,
    brian2_queries: int = 3,
    advance: Advance | None = None,
) -> tuple[Peer, ...]:
    """lava-vpr, SAD, cosine, VPRTempo and Brian2 on the same places and queries.

    Args:
        model: A trained model.
        queries: Encoded with its settings.
        truth: bool (n_queries, places).
        recognition: Recall of the model and its baselines on these queries, if known; None: worked out.
        seed: Of the queries' noise; None: the model's.
        threads: That share the queries; None: one for each processor.
        rounds: The fastest counts.
        fill: Seconds that a round takes at least.
        brian2_queries: How many Brian2 is given; 0: it is left out.
        advance: Told what comes next.
    Returns:
        lava-vpr first.
    Raises:
        InputError: there are no queries, or they do not fit the model or the truth.
    """
    if len(queries) == 0 or truth.shape != (len(queries), model.places):
        raise InputError(f"{len(queries)} queries, {model.places} places, but ground truth of shape {truth.shape}")
    workers = threads if threads is not None else cores()
    tell: Advance = advance or (lambda text: None)
    own = model.config.seed if seed is None else seed
    tell("recall of lava-vpr, SAD and cosine")
    known = recognition
    if known is None or not {*BASELINES, known.default} <= set(known.metrics):
        known = recognise(model, queries, truth, seed=own, threads=workers, keep_scores=False)
    with one_blas_thread():
        matchers = _matchers(model, queries, truth, known, own, tell)
        tell("speed of each")
        size = len(queries) * max(1, -(-BATCH // len(queries)))
        rates = _rates(matchers, size, workers, rounds, fill)
    peers = [
        Peer(one.name, WHATS[one.name], one.metrics, rate, workers, one.bytes, len(queries))
        for one, rate in zip(matchers, rates, strict=True)
    ]
    if brian2_queries > 0:
        tell("the reference network in Brian2")
        peers.append(brian2_peer(model, queries, brian2_queries))
    return tuple(peers)
