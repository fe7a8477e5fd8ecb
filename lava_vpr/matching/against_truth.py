"""Answers compared with the truth, some queries at a time: the scores of a long map would not fit into memory.

`hold` answers the queries once, forward; `follow` goes back from the last one, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching import sequences
from lava_vpr.matching.answers import ALONE, UNRANKED, Answerer, Answers, Together
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import Metrics, Tally, Truth
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.smoothing import smooth

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
    """A matcher's answers compared with the truth.

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
    together: Together = ALONE,
    *,
    moving: NDArray[np.bool_] | None = None,
    pace: sequences.Pace | None = None,
    keep: bool = False,
    states: list[Answerer] | None = None,
) -> Held:
    """Answer every query, or every sequence of queries, and compare the answers with the truth.

    Args:
        matcher: Name of the decoder or other matcher whose scores these are.
        scores: Its scores of single queries.
        truth: bool (queries, places); with sequences that of `sequences.sequence_truth`.
        together: How queries are matched with those before them.
        moving: Whether each query shows something else than the one before, bool (queries,); None: all do.
        pace: Shown the scores of the single queries.
        keep: Whether the scores are kept.
        states: Gets the state before each block.
    """
    state = Answerer.of(matcher, scores.places, together)
    shift = together.sequence - 1  # a window is named after its first query and place here, after its last in a stream
    tally, answers, kept = Tally(len(truth)), list[Answers](), list[Scores]()
    for rows, some in scores:
        if pace is not None:
            pace.update(some)
        if states is not None:
            states.append(state)
        state, found = state.step(some, None if moving is None else moving[rows])
        by, sure = found.ranking.by, found.confidence if together.motion == NONE else found.probability
        ends = slice(rows.stop - len(by) - shift, rows.stop - shift)
        tally.add(ends, by, sure[len(some) - len(by) :], truth[ends])
        answers.append(found._replace(ranking=UNRANKED))
        kept += [by] if keep else []
    matches, confidence, probability = (np.concatenate([one[part] for one in answers])[shift:] for part in range(3))
    whole = Answers(np.where(matches >= 0, matches - shift, -1), confidence, probability)
    return Held(tally.metrics(), whole, np.concatenate(kept) if keep else None)


class Followed(NamedTuple):
    """The answers of a forward filter to queries in driving order.

    Attributes:
        answers: Its answers.
        filtered: Its figures, each query seen with those before it.
        smoothed: The same, using later queries, too (forward-backward).
    """

    answers: Answers
    filtered: Metrics
    smoothed: Metrics


def follow(
    matcher: str, scores: InBlocks, truth: Truth, together: Together, moving: NDArray[np.bool_] | None = None
) -> Followed:
    """Follow queries in driving order, forward, and then back from the last one.

    On the way back each block's beliefs are computed again, so that memory holds those of one block at a time.

    Args:
        matcher, scores, truth, together, moving: As in `hold`; ``together`` has a motion.
    """
    states: list[Answerer] = []
    forward = hold(matcher, scores, truth, together, moving=moving, states=states)
    both, later = Tally(scores.queries), None
    for rows, before in zip(reversed(scores.rows()), reversed(states), strict=True):
        if before.filter is None:
            raise ValueError("following needs a motion")
        some, moves = scores.of(rows), np.ones(rows.stop - rows.start, np.bool_) if moving is None else moving[rows]
        beliefs, later = smooth(before.filter, some, moves, later)
        both.add(rows, beliefs.places, beliefs.best()[1], truth[rows])
    return Followed(forward.answers, forward.metrics, both.metrics())
