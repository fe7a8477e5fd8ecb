"""What a forward filter believes of a traverse, query after query: places, off the map, and how much of it is sure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.equations import Scores
from lava_vpr.matching.forward_filter import POSITIONS, ForwardFilter

RADIUS = 1
"""The probability of an answer is that of its place and of so many on either side."""


def at_places(positions: NDArray[np.float64], likely: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is between two places goes to both, by how near they are and how ``likely`` each is: float64 (places,)."""
    parts = positions.reshape(-1, POSITIONS)
    part = np.arange(POSITIONS) / POSITIONS
    here, there = likely[:, None] * (1.0 - part), np.append(likely[1:], 0.0)[:, None] * part
    kept = parts * (here / (here + there))
    places = kept.sum(axis=1)
    places[1:] += (parts - kept).sum(axis=1)[:-1]
    return places


class Belief(NamedTuple):
    """Where the robot may be after a query.

    Attributes:
        places: Probability of each place, float64 (places,).
        off_map: Probability of being off the map; with ``places`` 1.
        sure: The part of ``places`` that does not rest on hidden tracks, float64 (places,).
        followed: Probability that the robot is followed, and by this query, too.
    """

    places: NDArray[np.float64]
    off_map: float
    sure: NDArray[np.float64]
    followed: float

    @classmethod
    def of(cls, state: ForwardFilter) -> Belief:
        """What a state says."""
        tracks, alone = at_places(state.positions, state.evidence), state.alone
        total = float(state.positions.sum())
        left = state.hidden * state.off_map  # where queries tell nothing, what was believed before speaks
        off_map = max(0.0, state.lost - float(alone.sum())) + left * total
        return cls(
            alone + (1.0 - left) * tracks, off_map, alone + (1.0 - state.hidden) * tracks, (1.0 - state.hidden) * total
        )


@dataclass(frozen=True, eq=False)
class Beliefs:
    """The beliefs of a traverse, query after query: of n, the attributes of `Belief` as arrays, n the first axis."""

    places: NDArray[np.float64] = field(repr=False)
    off_map: NDArray[np.float64] = field(repr=False)
    sure: NDArray[np.float64] = field(repr=False)
    followed: NDArray[np.float64] = field(repr=False)

    @classmethod
    def empty(cls, queries: int, places: int) -> Beliefs:
        """Beliefs that are not known yet."""
        return cls(np.empty((queries, places)), np.empty(queries), np.empty((queries, places)), np.empty(queries))

    def put(self, number: int, state: ForwardFilter) -> None:
        """Take what ``state`` says after one query."""
        said = Belief.of(state)
        self.places[number], self.off_map[number], self.sure[number], self.followed[number] = said

    def best(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The most probable place of each query, int64 (n,), and the probability of being near it, float64 (n,).

        It is rounded to 9 digits, so that it is the same number on every machine.
        """
        places = self.places.argmax(axis=1)
        found = zip(self.sure, places.tolist(), strict=True)
        near = [float(row[max(0, at - RADIUS) : at + RADIUS + 1].sum()) for row, at in found]
        return places, np.minimum(np.round(np.array(near), 9), 1.0)


def filtered(
    state: ForwardFilter,
    scores: Scores,
    moving: NDArray[np.bool_] | None = None,
    odometry: float | None = None,
    stamps: NDArray[np.float64] | None = None,
) -> tuple[ForwardFilter, Beliefs]:
    """The filter after some queries of a traverse, and the belief after each.

    Args:
        state: The filter before the first of them.
        scores: float64 (n, places), at least 0.
        moving: Whether each query shows something else than the one before, bool (n,); None: all do.
        odometry: Metres before each of them, either sign; None: unknown.
        stamps: When each was taken, in seconds, float64 (n,); None: unknown.
    Raises:
        InputError: as `ForwardFilter.update`.
    """
    beliefs, after = Beliefs.empty(*scores.shape), state
    for number, after in enumerate(followed(state, scores, moving, odometry, stamps)):
        beliefs.put(number, after)
    return after, beliefs


def followed(
    state: ForwardFilter,
    scores: Scores,
    moving: NDArray[np.bool_] | None,
    odometry: float | None = None,
    stamps: NDArray[np.float64] | None = None,
) -> Iterator[ForwardFilter]:
    """The state after each of some queries, as in `filtered`."""
    chances = state.chances(scores)
    for number, row in enumerate(scores):
        state = state.update(
            row,
            moving=moving is None or bool(moving[number]),
            odometry=odometry,
            stamp=None if stamps is None else float(stamps[number]),
            chance=float(chances[number]),
        )
        yield state
