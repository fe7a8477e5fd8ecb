"""Matches held against the truth, some queries at a time: of a long map, all scores together would not fit a memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching import sequences
from lava_vpr.matching.answers import Answers, answers_of
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import Metrics, Tally, Truth
from lava_vpr.matching.forward_filter import Belief, ForwardFilter, filtered, smooth
from lava_vpr.matching.probability import Calibration

BLOCK = 256
"""Queries whose scores are made together."""


@dataclass(frozen=True, eq=False)
class InBlocks:
    """Scores of queries, made block by block, each time that they are asked for.

    Attributes:
        queries: Number of queries.
        places: Number of places.
        of: The scores float64 (rows, places) of a slice of the queries; higher is better.
    """

    queries: int
    places: int
    of: Callable[[slice], Scores] = field(repr=False)

    @classmethod
    def made(cls, scores: Scores) -> InBlocks:
        """Those of a matrix (queries, places) that is there."""
        return cls(scores.shape[0], scores.shape[1], lambda rows: scores[rows])

    def rows(self) -> list[slice]:
        """The blocks of queries, in order; an empty one if there are no queries."""
        ends = range(0, max(1, self.queries), BLOCK)
        return [slice(start, min(start + BLOCK, self.queries)) for start in ends]

    def __iter__(self) -> Iterator[tuple[slice, Scores]]:
        """Each block of queries and its scores."""
        return ((rows, self.of(rows)) for rows in self.rows())


class Held(NamedTuple):
    """A matcher's answers held against the truth.

    Attributes:
        metrics: Its figures.
        answers: Its answers; of sequences, those of each window.
        scores: The scores float64 (n, places) behind them, if they are to be kept.
    """

    metrics: Metrics
    answers: Answers
    scores: Scores | None


def hold(
    matcher: str,
    scores: InBlocks,
    truth: Truth,
    sequence: int = 1,
    calibration: Calibration | None = None,
    *,
    pace: sequences.Pace | None = None,
    keep: bool = False,
) -> Held:
    """Answer every query, or every sequence of queries, and hold the answers against the truth.

    Args:
        matcher: Name of the decoder or other matcher whose scores these are.
        scores: Its scores of single queries.
        truth: bool (queries, places); with a sequence that of `sequences.sequence_truth`.
        sequence: Queries whose scores are added up; 1: none.
        calibration: Of that decoder; None: probabilities are not known.
        pace: Shown the scores of the single queries.
        keep: Whether the scores are kept.
    """
    windows = sequences.SequenceMatcher(scores.places, sequence) if sequence > 1 else None
    tally, answers, kept, done = Tally(len(truth)), list[Answers](), list[Scores](), 0
    for _, some in scores:
        if pace is not None:
            pace.update(some)
        if windows is None:
            answered = answers_of(matcher, some, calibration)
        else:
            windows, some = windows.update(some)
            answered = answers_of("sequence", some)
        rows = slice(done, done + len(some))
        tally.add(rows, some, answered.confidence, truth[rows])
        answers.append(answered)
        kept += [some] if keep else []
        done = rows.stop
    matches, confidence, probability = (np.concatenate([one[part] for one in answers]) for part in range(3))
    said = Answers(matches, confidence, probability)
    return Held(tally.metrics(), said, np.concatenate(kept) if keep else None)


class Followed(NamedTuple):
    """What a forward filter makes of queries in driving order.

    Attributes:
        answers: Its answers.
        filtered: Its figures, each query seen with those before it.
        smoothed: The same with later queries seen, too (forward-backward).
    """

    answers: Answers
    filtered: Metrics
    smoothed: Metrics


def follow(
    motion: str, scores: InBlocks, moving: NDArray[np.bool_], confidence: NDArray[np.float64], truth: Truth
) -> Followed:
    """Follow queries in driving order, forward, and then back from the last one.

    On the way back each block's beliefs are worked out again, so that those of one block at a time are there.

    Args:
        motion: One of `forward_filter.MOTIONS`.
        scores: Scores of single queries.
        moving: Whether each query shows something else than the one before, bool (queries,).
        confidence: Of the single queries, float64 (queries,).
        truth: bool (queries, places).
    """
    state, states = ForwardFilter(Belief.unknown(scores.places), motion), []
    forward, both = Tally(scores.queries), Tally(scores.queries)
    places, probability = np.empty(scores.queries, np.int64), np.empty(scores.queries)
    for rows, some in scores:
        states.append(state)
        state, beliefs = filtered(state, some, moving[rows], begun=rows.start > 0)
        places[rows], probability[rows] = beliefs.best()
        forward.add(rows, beliefs.places, probability[rows], truth[rows])
    later = None
    for rows, before in zip(reversed(scores.rows()), reversed(states), strict=True):
        some = scores.of(rows)
        _, beliefs = filtered(before, some, moving[rows], begun=rows.start > 0)
        later = smooth(before, beliefs, some, moving[rows], later)
        both.add(rows, beliefs.places, beliefs.best()[1], truth[rows])
    return Followed(Answers(places, confidence, probability), forward.metrics(), both.metrics())
