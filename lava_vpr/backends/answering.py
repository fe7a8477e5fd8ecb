"""Queries answered in turn, batch by batch: matched with those before them, and teaching if that is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import PLAINLY, Asker, Asking, calibration_of, summed
from lava_vpr.backends.interface import Advance, Backend, HostBackend, Presentations
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.encoding import EncodedTraverse, Keep, encoded_batches
from lava_vpr.engine.adaptation import Motion
from lava_vpr.engine.gains import Season
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.framing import NO_CROP
from lava_vpr.inputs.doubts import Doubts, Sign, signs_of
from lava_vpr.matches import likeness_of
from lava_vpr.matching import sequences
from lava_vpr.matching.answers import ALONE, Answerer, Answers, Together
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.model import Model, integer_model, prepare
from lava_vpr.season.file import unlearned
from lava_vpr.season.table import Used
from lava_vpr.traverse import Traverse

BATCH = 256
"""Queries of a stream that are encoded and decoded together: enough for the threads of a large machine."""


class Turn(NamedTuple):
    """Queries that were answered together.

    Attributes:
        counts: Spike counts, int32 (n, neurons).
        scores: Scores, float64 (n, places).
        answers: The answers.
        signs: Signs of doubt of each query.
        taught: Whether each answer taught, bool (n,).
        season: The season afterwards; None if all inputs count alike.
        seen: The encoded queries in the straight view.
        used: Gains and biases of their presentations; None if inputs have no gains, or replayed ones.
    """

    counts: NDArray[np.int32]
    scores: NDArray[np.float64]
    answers: Answers
    signs: list[Sign]
    taught: NDArray[np.bool_]
    season: Season | None
    seen: EncodedTraverse
    used: Used | None


def in_turn(
    model: Model,
    asker: Asker,
    batches: Iterable[Sequence[EncodedTraverse]],
    backend: Backend,
    together: Together,
    calls: int = 1,
    traverse: Traverse | None = None,
    known: NDArray[np.int64] | None = None,
) -> Iterator[Turn]:
    """Answer queries batch by batch, and let the answers teach.

    Args:
        model: A trained model.
        asker: Presents the queries.
        batches: The queries in each of their views.
        backend: Counts the spikes.
        together: How queries are matched with those before them.
        calls: Batches whose spikes are counted together.
        traverse: The images, for their times and positions; None: neither is known.
        known: The place that each query shows, -1 for none, int64 (queries,), which teaches; None: the answers teach.
    Yields:
        Each batch, answered.
    Raises:
        ConfigError: answers cannot teach, because they have no probabilities.
    """
    asker.asking.check_together(together)
    state, motion = Answerer.of(model.config.decoder.default, model.places, together), Motion()
    scores_of, first, shown = prepare(model), 0, asker.in_turn(batches)
    doubts = Doubts(likeness_of(model), framed=asker.asking.crop != NO_CROP)
    while group := list(islice(shown, calls)):
        counts, _ = backend.count_spikes(asker.model, Presentations.joined([asked for _, asked in group]))
        ends = np.cumsum([len(asked.rates) for _, asked in group])
        for of_batch, (seen, asked) in zip(np.split(counts, ends[:-1]), group, strict=True):
            some = summed(of_batch, asker.asking.views)
            rates = strengths(asked.seen[: len(some)], model.config.encoder.direct is not None)
            moving = None if together.motion == NONE else motion.moving(rates)
            scores = scores_of(some)
            part = None if traverse is None else traverse.take(range(first, first + len(some)))
            stamps, positions = (None, None) if part is None else (part.stamps, part.positions)
            state, answers = state.step(scores, moving, stamps=stamps)
            signs = signs_of(doubts, seen.activity, stamps, None if positions is None else positions.points())
            teaching = answers if known is None else answers.told(known[first : first + len(some)])
            used = asker.used(asked, len(some))
            taught = asker.learn(teaching, signs)
            yield Turn(some, scores, answers, signs, taught, asker.season, seen, used)
            first += len(some)


def paired(model: Model, queries: EncodedTraverse, places: NDArray[np.int64], pool: Pool = ONE_THREAD) -> Season:
    """The season that a drive teaches whose images have known places.

    Args:
        model: A trained model.
        queries: The images, in driving order, encoded with its settings.
        places: The place that each shows, -1 for none, int64 (n,).
        pool: Counts the spikes.
    Raises:
        ConfigError: the model has no neurons with biases.
    """
    season, asking = unlearned(integer_model(model, "--pairs")), Asking(tracked_adapt=True, learn=True)
    asking = asking.tracking(model, NONE)
    asking.check(model)
    together = Together(calibration=calibration_of(model, pool))
    for turn in in_turn(model, Asker(model, asking), [(queries,)], HostBackend(pool), together, known=places):
        season = turn.season or season
    return season


def teachers(turns: Sequence[Turn], truth: NDArray[np.bool_]) -> tuple[int, int]:
    """The number of answers that taught, and of those among them that are wrong by ``truth``, bool (n, places)."""
    taught = np.concatenate([turn.taught for turn in turns])
    places = np.concatenate([turn.answers.matches for turn in turns])[taught]
    return len(places), int((~truth[np.flatnonzero(taught), places]).sum())


class Answered(NamedTuple):
    """A batch of queries of a stream, in order, and their answers.

    Attributes:
        images: The queries.
        answers: Their answers.
        counts: Their spike counts, int32 (n, neurons).
        thumbnails: The queries as pages show them, uint8 (n, 48, 64, 3) BGR; None if they are not kept.
        signs: Signs of doubt of each of them.
        season: The season after them; None if all inputs count alike.
        used: Gains and biases of their presentations; None if inputs have no gains, or replayed ones.
        grey: Their pixels as a spiking front end takes them, uint8 (n, *shape); None if these are not kept.
    """

    images: Traverse
    answers: Answers
    counts: NDArray[np.int32]
    signs: list[Sign]
    season: Season | None
    thumbnails: NDArray[np.uint8] | None = None
    used: Used | None = None
    grey: NDArray[np.uint8] | None = None


def answer_stream(
    model: Model,
    traverse: Traverse,
    *,
    backend: str = "host",
    together: Together = ALONE,
    asking: Asking = PLAINLY,
    seed: int | None = None,
    threads: int = 1,
    pace: sequences.Pace | None = None,
    at_once: bool = False,
    read: Advance | None = None,
    advance: Advance | None = None,
    keep: Keep = Keep.NOTHING,
) -> Iterator[Answered]:
    """Answer the images of a traverse batch by batch; only a few are in memory at once.

    Batches change no answer, bit for bit. Unless the network adapts, learns a season, or queries are matched together,
    each answer is the one that its image alone would get.

    Args:
        model: A trained model.
        traverse: The images.
        backend: Name in `lava_vpr.backends.registry.BACKENDS`.
        together: How queries are matched with those before them.
        asking: How queries are asked.
        seed: The seed of the queries' noise; None: the model's.
        threads: Threads that read images, and those of the backend; they do not change the result.
        pace: Called with the scores of the queries.
        at_once: Answer the first image before the second is read, then more and more together; without effect on
            backends that are slow to start.
        read: Called with the number of further images that were read.
        advance: Called with the number of further queries that a slow backend has run.
        keep: `Keep.THUMBNAILS` and `Keep.GREY`, if answers need them.
    Raises:
        LavaVprError: an image cannot be read, the sequence exceeds the places, or the backend cannot run.
    """
    chosen, calls = backends.get(backend, threads, advance), max(1, BACKENDS[backend].together // BATCH)
    asking.check(model)
    asking.check_length(len(traverse))
    asker, framing = Asker(model, asking, seed), asking.framing(model)
    batches = encoded_batches(
        traverse,
        model.config.encoder,
        asking.of(model),
        BATCH,
        read,
        1 if at_once and calls == 1 else None,
        model.standard,
        threads,
        keep if model.config.encoder.direct is None else keep | Keep.GREY,
        framing,
    )
    first = 0
    for turn in in_turn(model, asker, batches, chosen, together, 1 if asking.learn else calls, traverse):
        if pace is not None:
            pace.update(turn.scores)
        part = traverse.take(range(first, first + len(turn.counts)))
        found = turn.answers, turn.counts, turn.signs, turn.season, turn.seen.thumbnails, turn.used, turn.seen.grey
        yield Answered(part, *found)
        first += len(part)
