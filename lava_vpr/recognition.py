"""Queries through a trained model: spike counts, scores by every decoder and baseline, figures against the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.answering import Turn, in_turn, teachers
from lava_vpr.backends.asking import PLAINLY, Asker, Asking, summed
from lava_vpr.backends.interface import Advance, Backend, Events, HostBackend, Presentations, query_presentations
from lava_vpr.backends.rivals import Rivals, Scored, chosen as rivals_of, decoded, descriptor_similarities
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.adaptation import Adaptation, Motion
from lava_vpr.engine.gains import Season
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.matching import sequences
from lava_vpr.matching.against_truth import Followed, Held, InBlocks, follow, hold
from lava_vpr.matching.answers import Answers, Together
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import HALF, Calibration
from lava_vpr.matching.trust import Trust, trust
from lava_vpr.model import Model, integer_model
from lava_vpr.season.table import Used
from lava_vpr.storage.arrays import narrow
from lava_vpr.truth.alignment import PositionErrors


@dataclass(frozen=True)
class Recognition:
    """What a model and its rivals made of a set of queries.

    Attributes:
        default: Name of the decoder that answers.
        scores: Scores of the default decoder and of the baselines, float64 (n, places), higher is better, if they were
            to be kept. With sequences, row and column are the first query and place of each window.
        metrics: Figures by matcher.
        adapted: Figures of the default decoder and of the baselines where they adapt to the queries before, by matcher;
            empty unless that was asked for. Everything else is without.
        learned: Figures of the default decoder where it adapts and answers teach; empty unless that was asked for.
        used: What the queries were presented with, part by part, where answers teach, or have: to be filtered, if a
            motion was given.
        taught: How many answers taught, and how many of those were wrong, by `SINGLE` and `FILTERED`.
        season: What was known of the season after the last query, filtered if a motion was given; None: it did not
            count.
        followed: Figures of the default decoder's scores once a filter has followed the queries: `FILTERED`, and
            `SMOOTHED`, which also looks ahead; empty unless a motion was given.
        truth: bool (n, places).
        matches: The default decoder's place of each query, -1 for none, int64 (n,); adapted, if that was asked for.
        confidence: Confidence of those matches, float64 (n,).
        single: Each query's answer by itself, without adaptation, if queries are not matched in sequences.
        filtered: Its answer by the filter, if a motion was given.
        trust: How far the probabilities of both can be trusted, by `SINGLE` and `FILTERED`, as far as there are any.
        contradiction: Why sequence matching does not suit these queries; None if it does, or is off.
        counts: Spike counts of all queries, int32 (queries, neurons).
        events: Counted events, summed over all queries.
    """

    default: str
    scores: dict[str, NDArray[np.float64]] = field(repr=False)
    metrics: dict[str, Metrics]
    adapted: dict[str, Metrics]
    learned: dict[str, Metrics]
    used: list[Used] = field(repr=False)
    taught: dict[str, tuple[int, int]]
    season: Season | None = field(repr=False)
    followed: dict[str, Metrics]
    truth: NDArray[np.bool_] = field(repr=False)
    matches: NDArray[np.int64] = field(repr=False)
    confidence: NDArray[np.float64] = field(repr=False)
    single: Answers | None = field(repr=False)
    filtered: Answers | None = field(repr=False)
    trust: dict[str, Trust]
    contradiction: str | None
    counts: NDArray[Any] = field(repr=False)
    events: dict[str, int]

    @property
    def changed(self) -> dict[tuple[str, str], Metrics]:
        """The figures ``adapted`` and ``learned``, by matcher and by `ADAPTED` or `GAINS`."""
        ways = {ADAPTED: self.adapted, GAINS: self.learned}
        return {(name, way): metrics for way, found in ways.items() for name, metrics in found.items()}


def count_query_spikes(
    model: Model,
    queries: EncodedTraverse,
    *,
    backend: str | Backend = "host",
    seed: int | None = None,
    threads: int = 1,
    advance: Advance | None = None,
    shown: Presentations | None = None,
) -> tuple[NDArray[np.int32], Events]:
    """Spike counts of every query, int32 (n, neurons), and the run's events.

    Args:
        model: A trained model.
        queries: Encoded with the model's settings.
        backend: Name in `lava_vpr.backends.registry.BACKENDS`, or a backend.
        seed: The seed of the queries' noise; None: the model's.
        threads: For a backend that is given by name; does not change the result.
        advance: Called with how many queries are done, by backends that are slow and given by name.
        shown: The queries as the backend is shown them, if that is known; None: worked out.
    Raises:
        InputError: the queries were encoded with other settings.
        BackendUnavailableError: there is no backend of that name, or it cannot run here, or not this model.
    """
    shown = query_presentations(model, queries, seed) if shown is None else shown
    chosen = backends.get(backend, threads, advance) if isinstance(backend, str) else backend
    return chosen.count_spikes(model, shown)


@dataclass(frozen=True)
class Comparison:
    """How queries are matched, and what the decoder that answers is compared with.

    Attributes:
        sequence: Queries that are matched together; 1: each alone.
        rivals: Baselines to compute, of `lava_vpr.backends.rivals.BASELINES`; None: all that
            the model can be compared with.
        descriptors: .npy files of reference and query descriptors, one row per image in use; None: no such matcher.
        keep_scores: Whether the result holds matrices of scores, which a report draws.
        asking: How queries are asked; where the network adapts, there are also figures without adaptation, but those of
            a filter are of a network that adapts as it does for who tracks a robot.
        motion: How the robot may have moved (`lava_vpr.matching.forward_filter.MOTIONS`), for figures of a filter
            beside; ``none``: there are none. Not with sequences.
        calibration: Of the model's decoder; None: probabilities of single queries are not known.
        off_map: The share of the queries that is taken to be off the map, at least 0 and below 1.
    """

    sequence: int = 1
    rivals: Sequence[str] | None = None
    descriptors: tuple[Path, Path] | None = None
    keep_scores: bool = True
    asking: Asking = PLAINLY
    motion: str = NONE
    calibration: Calibration | None = None
    off_map: float = HALF


SINGLE, FILTERED, SMOOTHED = "single", "filtered", "forward_backward"
"""What figures are called of queries by themselves, of the forward filter, and of the same with later queries seen."""
ADAPTED, GAINS = "adapted", "gains"
"""What figures are called of queries to which the network adapts, and of such whose inputs have gains."""
EVERYTHING = Comparison()
"""Each query alone, with every baseline that the model can be compared with."""
DECODERS_ONLY = Comparison(rivals=(), keep_scores=False)
"""Each query alone, no baseline, nothing kept that a report draws."""


def recognise(
    model: Model,
    queries: EncodedTraverse,
    truth: NDArray[np.bool_],
    comparison: Comparison = EVERYTHING,
    *,
    backend: str | Backend = "host",
    seed: int | None = None,
    pool: Pool = ONE_THREAD,
    advance: Advance | None = None,
    shown: Presentations | None = None,
    further: Sequence[EncodedTraverse] = (),
) -> Recognition:
    """Answer every query and compare the answers with the truth.

    Args:
        model: A trained model.
        queries: Encoded with the model's settings.
        truth: bool (n_queries, places).
        comparison: How queries are matched, and with what the decoder is compared.
        backend, seed, advance, shown: As in `count_query_spikes`.
        further: The queries in the further views in which they are presented (`Asking.of`).
        pool: Who counts the spikes of the backend ``host``; threads for others that are given by name.
    Raises:
        LavaVprError: the queries, the descriptors, the baselines or the sequence do not fit the model, or the backend
            cannot run.
    """
    if not pool.here and backend == "host":
        backend = HostBackend(pool)
    # What files or options can be wrong about comes first, before the work.
    if comparison.sequence > 1:
        truth = sequences.sequence_truth(truth, comparison.sequence)
    names = rivals_of(model, comparison.rivals)
    files, labels = comparison.descriptors, model.labels
    others = files and descriptor_similarities(*files, n_references=len(labels), n_queries=len(queries), labels=labels)
    asking = comparison.asking
    asking.check(model)
    asking.check_length(len(queries))
    shown = Asker(model, seed=seed).presentations((queries, *further)) if shown is None else shown
    chosen = backends.get(backend, pool.threads, advance) if isinstance(backend, str) else backend
    shown_counts, events = chosen.count_spikes(model, shown)
    counts = narrow(summed(shown_counts, asking.views))
    del shown_counts
    default = model.config.decoder.default
    rivals = Rivals(model, queries, shown, names, asking, pool)
    sequence, pace, off_map = comparison.sequence, sequences.Pace(), comparison.off_map
    held: dict[str, Held] = {}
    followed: Followed | None = None
    for name, matcher, scores in _every_matcher(model, counts, rivals, others):
        answers_here = name == default
        calibration = comparison.calibration if answers_here else None
        keep = comparison.keep_scores and (answers_here or name not in DECODERS)
        seen = pace if answers_here else None
        with nullcontext() if answers_here else DECODERS.spared(name):
            together = Together(sequence, NONE, calibration, off_map)
            held[name] = hold(matcher, scores, truth, together, pace=seen, keep=keep)
    adapting = cache(partial(_adapted_scores, rivals, chosen))
    adapted = {
        name: hold(matcher, scores, truth, Together(sequence))
        for name, matcher, scores in _adapted_matchers(rivals, adapting)
    }
    teaching = partial(_taught, rivals, further, chosen, truth)
    if sequence > 1:
        asking.check_together(Together(sequence))
    tracking, known = asking.tracking(model, comparison.motion), comparison.calibration
    learned: dict[str, Metrics] = {}
    taught: dict[str, tuple[int, int]] = {}
    turns: list[Turn] = []
    if tracking.gained and (known is not None or comparison.motion == NONE or not asking.learn):
        scores, taught[SINGLE], turns = teaching(tracking, Together(sequence, NONE, known, off_map))
        learned = {default: hold(default, scores, truth, Together(sequence)).metrics}
    if comparison.motion != NONE and sequence == 1:
        asked = strengths(shown.rates[: len(queries)], model.config.encoder.direct is not None)
        moving, by = Motion().moving(asked), Together(1, comparison.motion, known, off_map)
        if tracking.gained:
            scores, taught[FILTERED], turns = teaching(tracking, by)
        else:
            scores = decoded(model, counts, default) if tracking.adapt is None else adapting(tracking.adapt)
        followed = follow(default, scores, truth, by, moving)
    single = held[default].answers
    answers = adapted[default].answers if default in adapted else single
    by_filter = None if followed is None else followed.answers
    return Recognition(
        default=default,
        scores={name: one.scores for name, one in held.items() if one.scores is not None},
        metrics={name: one.metrics for name, one in held.items()},
        adapted={name: one.metrics for name, one in adapted.items()},
        learned=learned,
        used=[turn.used for turn in turns if turn.used is not None],
        taught=taught,
        season=turns[-1].season if turns else None,
        followed={} if followed is None else {FILTERED: followed.filtered, SMOOTHED: followed.smoothed},
        truth=truth,
        matches=answers.matches,
        confidence=answers.confidence,
        single=single if sequence == 1 else None,
        filtered=by_filter,
        contradiction=pace.contradiction(sequence) if sequence > 1 else None,
        trust=_trusts(comparison, single, by_filter, truth),
        counts=counts,
        events=events,
    )


def _trusts(
    comparison: Comparison, single: Answers, by_filter: Answers | None, truth: NDArray[np.bool_]
) -> dict[str, Trust]:
    """How far probabilities can be trusted, as far as there are any."""
    found = {}
    if comparison.sequence == 1:
        found[SINGLE] = trust(single, truth, Together(calibration=comparison.calibration, off_map=comparison.off_map))
    if by_filter is not None:
        by = Together(1, comparison.motion, comparison.calibration, comparison.off_map)
        found[FILTERED] = trust(by_filter, truth, by)
    return {name: value for name, value in found.items() if value is not None}


def _adapted_scores(rivals: Rivals, backend: Backend, tau: float) -> InBlocks:
    """The scores of the default decoder where the network adapts to the queries before."""
    model, shown, views = rivals.model, rivals.shown, rivals.asking.views
    bias = Adaptation(integer_model(model, "--adapt").network, tau).biases(shown.rates[: len(rivals.queries)])
    counts, _ = backend.count_spikes(model, replace(shown, bias=np.tile(bias, (views, 1))))
    return decoded(model, summed(counts, views), model.config.decoder.default)


def _taught(
    rivals: Rivals,
    further: Sequence[EncodedTraverse],
    backend: Backend,
    truth: NDArray[np.bool_],
    asking: Asking,
    together: Together,
) -> tuple[InBlocks, tuple[int, int], list[Turn]]:
    """The scores of the default decoder where answers teach, or have; how many did, and how many of these wrong; and
    all else of the drive."""
    model, asker = rivals.model, Asker(rivals.model, asking, rivals.shown.seed)
    turns = list(in_turn(model, asker, [(rivals.queries, *further)], backend, together))
    counts = np.concatenate([turn.counts for turn in turns])
    return decoded(model, counts, model.config.decoder.default), teachers(turns, truth), turns


def _adapted_matchers(rivals: Rivals, adapting: Callable[[float], InBlocks]) -> Iterator[Scored]:
    """The scores of the default decoder and the baselines, all adapted; none unless that is asked."""
    default, tau = rivals.model.config.decoder.default, rivals.asking.adapt
    if tau is not None:
        yield Scored(default, default, adapting(tau))
        yield from rivals.scored(tau)


def _every_matcher(
    model: Model, counts: NDArray[Any], rivals: Rivals, descriptors: NDArray[np.float64] | None
) -> Iterator[Scored]:
    """The scores (n, places) of every decoder, of the baselines and of ``descriptors``, one by one."""
    # The default is followed by a filter, too, so it comes last.
    for name in sorted(DECODERS, key=lambda name: name == model.config.decoder.default):
        yield Scored(name, name, decoded(model, counts, name))
    yield from rivals.scored()
    if descriptors is not None:
        yield Scored("descriptors", "descriptors", InBlocks.made(descriptors))


def _groups(result: Recognition) -> dict[str, dict[str, Metrics]]:
    """The figures of every matcher, by the group in which `as_json` has them."""
    groups: dict[str, dict[str, Metrics]] = {
        "decoders": {name: metrics for name, metrics in result.metrics.items() if name in DECODERS},
        "baselines": {name: metrics for name, metrics in result.metrics.items() if name not in DECODERS},
        "adapted": result.adapted,
        "followed": result.followed,
    }
    return groups | {"learned": result.learned} if result.learned else groups


def _of_groups(groups: dict[str, dict[str, Metrics]]) -> dict[str, dict[str, Any]]:
    """The figures of every matcher of `_groups` as JSON has them."""
    return {group: {name: one.as_json() for name, one in found.items()} for group, found in groups.items()}


def seeds_as_json(seeds: Sequence[int], results: Sequence[Recognition]) -> list[dict[str, Any]]:
    """What ``lava-vpr eval --seeds --json`` has of each seed of the queries' noise: `as_json`'s figures of matchers."""
    return [{"seed": seed, **_of_groups(_groups(one))} for seed, one in zip(seeds, results, strict=True)]


def as_json(model: Model, result: Recognition, errors: PositionErrors | None = None) -> dict[str, Any]:
    """The figures in the layout that scripts rely on (``lava-vpr eval --json``); ``errors`` where they are known."""
    groups = _groups(result)
    figures = _of_groups(groups)
    taught = {name: {"answers": many, "wrong": wrong} for name, (many, wrong) in result.taught.items()}
    return {
        "places": model.places,
        "queries": len(result.counts),
        "network": {
            "neurons": model.neurons,
            "weight_bits": model.weight_bits,
            "steps": model.config.steps,
        },
        "default_decoder": result.default,
        "decoders": figures["decoders"],
        "baselines": figures["baselines"],
        "adapted": figures["adapted"],
        **({"learned": figures.get("learned", {}), "taught": taught} if taught else {}),
        "position_error": None if errors is None else errors.as_json(),
        "followed": figures["followed"],
        "probability": {name: found.as_json() for name, found in result.trust.items()},
        "curves": {group: {name: one.curve_json() for name, one in found.items()} for group, found in groups.items()},
    }
