"""The compiled kernels of `lava_vpr.matching.forward_filter` and `lava_vpr.matching.smoothing`: one step of all tracks
forward, and one back.

Tracks are float64 (speeds, positions). From one query to the next, a track keeps its speed with probability `STAYING`,
changes to the next lower and to the next higher one with `NEXT` each, and else to any speed by its prior probability.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

STAYING, NEXT = 0.9, 0.04
"""Share of a track that keeps its speed from one query to the next, and that changes to each neighbouring speed."""


@compiled()
def move(
    tracks: NDArray[np.float64],
    positions: NDArray[np.float64],
    entering: NDArray[np.float64],
    shifts: NDArray[np.int64],
    prior: NDArray[np.float64],
    following: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tracks before the next query, and their sums over speeds; what moves past an end of the route is dropped.

    Args:
        tracks: Tracks after the last query, float64 (speeds, positions).
        positions: Their sums over speeds, float64 (positions,).
        entering: Probability of tracks that begin at each place, float64 (places,).
        shifts: Positions by which each speed moves, int64 (speeds,).
        prior: Prior probability of each speed, float64 (speeds,).
        following: Share of a track that does not end.
    """
    speeds, length = tracks.shape
    fractions = length // len(entering)
    moved, sums = np.zeros_like(tracks), np.zeros_like(positions)
    stay, near, rest = following * STAYING, following * NEXT, following * (1.0 - STAYING - 2.0 * NEXT)
    for speed in range(speeds):
        shift, any_speed, begun = shifts[speed], rest * prior[speed], prior[speed]
        first, last = min(max(0, -shift), length), max(0, min(length, length - shift))
        here, every = tracks[speed, first:last], positions[first:last]
        slower, faster = tracks[max(speed - 1, 0), first:last], tracks[min(speed + 1, speeds - 1), first:last]
        there, total = moved[speed, first + shift : last + shift], sums[first + shift : last + shift]
        for k in range(len(here)):  # from 0, so that the compiler takes several at a time
            there[k] = stay * here[k] + near * (slower[k] + faster[k]) + any_speed * every[k]
        for place in range(-(-first // fractions), -(-last // fractions)):
            moved[speed, place * fractions + shift] += begun * entering[place]
        for k in range(len(total)):
            total[k] += there[k]
    return moved, sums


@compiled()
def look_back(
    later: NDArray[np.float64],
    alone: float,
    shifts: NDArray[np.int64],
    prior: NDArray[np.float64],
    following: float,
    fractions: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Likelihood of later queries for tracks before one `move`, float64 (speeds, positions), and for tracks that begin
    at each place, float64 (places,).

    Args:
        later: Their likelihood for tracks after it, float64 (speeds, positions).
        alone: Their likelihood for a robot that is not followed after it.
        shifts, prior, following: As in `move`.
        fractions: Positions per place.
    """
    speeds, length = later.shape
    reached = np.full((speeds, length), alone)
    entered, over = np.zeros(length // fractions), np.zeros(length)
    for speed in range(speeds):
        shift = shifts[speed]
        for at in range(max(0, -shift), min(length, length - shift)):
            reached[speed, at] = later[speed, at + shift]
        for at in range(length):
            over[at] += prior[speed] * reached[speed, at]
    for place in range(len(entered)):
        entered[place] = over[place * fractions]
    stay, near, rest = following * STAYING, following * NEXT, following * (1.0 - STAYING - 2.0 * NEXT)
    before, leaving = np.empty_like(later), (1.0 - following) * alone
    for speed in range(speeds):
        here, slower, faster = reached[speed], reached[max(speed - 1, 0)], reached[min(speed + 1, speeds - 1)]
        for at in range(length):
            before[speed, at] = stay * here[at] + near * (slower[at] + faster[at]) + rest * over[at] + leaving
    return before, entered
