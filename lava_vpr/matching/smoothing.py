"""Beliefs of who has seen all queries of a traverse: forward-backward (Rabiner, Proc. IEEE 1989).

What later queries say goes back through the very moves and evidence by which the filter came forward; which share of
its tracks was hidden, and where who is not followed was, are taken as the filter knew them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.beliefs import Beliefs, followed
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.forward_filter import (
    BEGINNING,
    ENDING,
    POSITIONS,
    ForwardFilter,
    at_positions,
    speeds_of,
    steps_of,
)

_KEPT = 16
"""States that `smooth` keeps at a time."""


class Later(NamedTuple):
    """How likely later queries are from each state, up to a factor.

    Attributes:
        tracks: From each track, float64 (speeds, positions).
        alone: From each place without being followed, float64 (places,).
        off_map: From off the map.
    """

    tracks: NDArray[np.float64]
    alone: NDArray[np.float64]
    off_map: float

    @classmethod
    def nothing(cls, state: ForwardFilter) -> Later:
        """What no query says of ``state``."""
        return cls(np.ones_like(state.tracks), np.ones_like(state.alone), 1.0)


def given(state: ForwardFilter, later: Later) -> ForwardFilter:
    """``state`` once what ``later`` queries say of it is known, too."""
    tracks, alone = state.tracks * later.tracks, state.alone * later.alone
    off_map = (state.lost - float(state.alone.sum())) * later.off_map
    total = float(tracks.sum()) + float(alone.sum()) + off_map
    lost, positions = (float(alone.sum()) + off_map) / total, tracks.sum(axis=0) / total
    return replace(state, tracks=tracks / total, positions=positions, lost=lost, alone=alone / total, hidden=0.0)


def looked_back(after: ForwardFilter, later: Later, pace: float = 1.0) -> Later:
    """What a query and all later ones say of the state before it.

    Args:
        after: The state after that query.
        later: What the later ones say of that.
        pace: As in `ForwardFilter.moved`.
    """
    from lava_vpr.matching.filter_kernels import look_back

    shifts, prior = speeds_of(after.motion)
    single = after.alone / after.lost
    unfollowed = float((single * later.alone).sum()) + (1.0 - float(single.sum())) * later.off_map
    told = later.tracks * at_positions(after.evidence)
    tracks, entered = look_back(told, unfollowed, steps_of(shifts, pace), prior, 1.0 - ENDING, POSITIONS)
    alone = BEGINNING * entered + (1.0 - BEGINNING) * unfollowed
    most = max(float(tracks.max()), float(alone.max()), unfollowed)
    return Later(tracks / most, alone / most, unfollowed / most)


def smooth(
    state: ForwardFilter,
    scores: Scores,
    moving: NDArray[np.bool_],
    later: Later | None = None,
    stamps: NDArray[np.float64] | None = None,
) -> tuple[Beliefs, Later | None]:
    """The beliefs of who has seen all queries, some of which these are.

    States are kept for a few queries at a time, and worked out again from there.

    Args:
        state, scores, moving, stamps: As in `filtered`.
        later: What this function returned for the queries that follow these; None: none do.
    Returns:
        The beliefs, and what these queries and all later ones say of ``state``.
    """
    beliefs, starts = Beliefs.empty(*scores.shape), [state]
    for number, after in enumerate(followed(state, scores, moving, stamps=stamps), 1):
        starts += [after] if number % _KEPT == 0 else []
    for first, before in reversed(list(zip(range(0, len(scores), _KEPT), starts, strict=False))):
        rows = slice(first, first + _KEPT)
        times = None if stamps is None else stamps[rows]
        states = [before, *followed(before, scores[rows], moving[rows], stamps=times)]
        for number in range(len(states) - 2, -1, -1):
            before, after = states[number : number + 2]
            later = later or Later.nothing(after)
            beliefs.put(first + number, given(after, later))
            if before.begun and moving[first + number]:
                pace = before.timed(after.stamp)[0]
                later = looked_back(after, later, pace)
    return beliefs, later
