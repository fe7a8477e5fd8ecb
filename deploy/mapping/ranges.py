"""Consecutive ranges of excitatory neurons, one a core: the fewest, and even ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.mapping.sizing import Integers, Sizing

_AROUND = 12
"""How far from the last range's size the next one's is looked for first."""

_CLOSE = 32
"""Ranges within 1 / _CLOSE of the shortest are short enough."""


def fitting(sizing: Sizing, sizes: Integers, active: Integers, words: Integers) -> NDArray[np.bool_]:
    """Whether a core holds ranges of ``sizes`` neurons that take so many inputs and words, bool (ranges,)."""
    board = sizing.board
    return np.asarray(
        ((1 + sizing.counters) * sizes <= board.compartments)
        & (active + sizing.inhibits + sizing.counters * sizes <= board.axons_in)
        & (2 * sizes <= board.axons_out)
        & (words <= sizing.words)
    )


def farthest(sizing: Sizing, first: int, most: int, about: int) -> int:
    """Most neurons from ``first`` on, at most ``most``, that a core holds; looked for around ``about`` first."""
    most = min(most, sizing.largest, sizing.network.neurons - first)
    least, end = max(1, min(about, most) - _AROUND), min(most, about + _AROUND)
    while True:
        sizes = np.arange(least, end + 1)
        fits = fitting(sizing, sizes, *sizing.growing(first, least, end))
        if not fits[0] and least > 1:
            least, end, most = 1, least - 1, least - 1
        elif fits.all() and end < most:
            least, end = end + 1, min(most, 2 * end)
        else:
            return int(least - 1 + np.count_nonzero(fits))


def reach(sizing: Sizing, cores: int, most: int) -> Integers:
    """Bounds of at most ``cores`` ranges of at most ``most`` neurons each, every one as long as a core holds: the first
    neuron of each, and the end of the last."""
    bounds, size = [0], min(most, 64)
    while bounds[-1] < sizing.network.neurons and len(bounds) <= cores and size:
        size = farthest(sizing, bounds[-1], most, size)
        bounds += [bounds[-1] + size] if size else []
    return np.array(bounds)


def longest(sizing: Sizing, cores: int, most: int) -> Integers | None:
    """What `reach` returns if it holds all neurons, else None."""
    bounds = reach(sizing, cores, most)
    return bounds if bounds[-1] == sizing.network.neurons else None


def even(sizing: Sizing, cores: int, best: Integers) -> Integers:
    """Bounds of at most ``cores`` ranges: equal ones where they fit, else those whose longest is about the shortest.

    Args:
        sizing: The network and its board.
        cores: Ranges.
        best: Bounds of at most so many, the longest that fit.
    """
    count = sizing.network.neurons
    equal = np.arange(cores + 1) * count // cores
    if int(np.diff(equal).max()) <= sizing.largest:
        if fitting(sizing, np.diff(equal), *sizing.taken(np.diff(equal), counts_of(sizing, equal))).all():
            return equal
    low, high = -(-count // cores), int(np.diff(best).max())
    while high - low > low // _CLOSE:
        middle = (low + high) // 2
        bounds = longest(sizing, cores, middle)
        low, high, best = (middle + 1, high, best) if bounds is None else (low, middle, bounds)
    return best


def counts_of(sizing: Sizing, bounds: Integers) -> NDArray[np.int32]:
    """Non-zero weights of each kind of inputs to each range, int32 (kinds, ranges)."""
    return np.add.reduceat(sizing.pattern.mask, bounds[:-1], axis=1, dtype=np.int32)
