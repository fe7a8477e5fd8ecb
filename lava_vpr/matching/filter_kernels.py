"""The compiled kernels of `lava_vpr.matching.forward_filter`: tracks moved by one query, and looked at from the next.

Tracks are float64 (speeds, positions). A track keeps its speed with `STAYING`, goes to the next slower or faster one
with `NEXT` each, and else to any, as often as the prior says.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

STAYING, NEXT = 0.9, 0.04
"""Share of a track that keeps its speed from one query to the next, and that goes to each of the two next to it."""


@compiled()
def move(
    tracks: NDArray[np.float64],
    positions: NDArray[np.float64],
    entering: NDArray[np.float64],
    shifts: NDArray[np.int64],
    prior: NDArray[np.float64],
    following: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tracks before the next query, and their sums over speeds; what goes over an end is gone.

    Args:
        tracks: Before, float64 (speeds, positions).
        positions: Their sums over speeds, float64 (positions,).
        entering: What begins at each place, float64 (places,).
        shifts: Positions by which each speed moves, int64 (speeds,).
        prior: How often each speed is, float64 (speeds,).
        following: Share of a track that goes on being followed.
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
    """What later queries say of tracks one `move` before, float64 (speeds, positions), and of what enters (places,).

    Args:
        later: What they say of tracks after it, float64 (speeds, positions).
        alone: What they say of who is not followed after it.
        shifts, prior, following: As in `move`.
        fractions: Positions a place.
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
