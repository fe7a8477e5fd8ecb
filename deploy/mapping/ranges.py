"""Consecutive ranges of excitatory neurons, one a core: the fewest, and even ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.mapping.sizing import Integers, Sizing, limit_of


def fitting(sizing: Sizing, sizes: Integers, active: Integers, words: Integers) -> NDArray[np.bool_]:
    """Whether a core holds ranges of ``sizes`` neurons that take so many inputs and words, bool (ranges,)."""
    board = sizing.board
    return np.asarray(
        (sizes <= limit_of(board.compartments))
        & (active + sizing.inhibits <= limit_of(board.axons_in))
        & (2 * sizes <= limit_of(board.axons_out))
        & (words <= sizing.words)
    )


def farthest(sizing: Sizing, first: int, most: int, about: int = 64) -> int:
    """Most neurons from ``first`` on, at most ``most``, that a core holds; what fits grows from ``about``."""
    most, tried = min(most, sizing.largest, sizing.network.neurons - first), max(1, about)
    while True:
        tried = min(tried, most)
        sizes = np.arange(1, tried + 1)
        fits = fitting(sizing, sizes, *sizing.growing(first, tried))
        if not fits.all() or tried == most:
            return int(np.argmin(np.append(fits, False)))
        tried *= 2


def longest(sizing: Sizing, cores: int, most: int) -> Integers | None:
    """First neurons of ranges of at most ``most`` neurons that reach as far as they can, and the number of all; None if
    ``cores`` cannot hold them."""
    count, bounds, about = sizing.network.neurons, [0], min(most, 64)
    while bounds[-1] < count:
        size = farthest(sizing, bounds[-1], most, about)
        if size == 0 or len(bounds) > cores:
            return None
        bounds.append(bounds[-1] + size)
        about = size + 8
    return np.array(bounds)


def even(sizing: Sizing, cores: int) -> Integers | None:
    """Bounds of at most ``cores`` ranges, the longest of which is as short as can be found; None: they hold not all."""
    count = sizing.network.neurons
    equal = np.arange(cores + 1) * count // cores
    if int(np.diff(equal).max()) <= sizing.largest:
        if fitting(sizing, np.diff(equal), *sizing.taken(np.diff(equal), counts_of(sizing, equal))).all():
            return equal
    low, high = -(-count // cores), sizing.largest
    best = longest(sizing, cores, high)
    if best is None:
        return None
    high = int(np.diff(best).max())
    while low < high:
        middle = (low + high) // 2
        bounds = longest(sizing, cores, middle)
        low, high, best = (middle + 1, high, best) if bounds is None else (low, middle, bounds)
    return best


def counts_of(sizing: Sizing, bounds: Integers) -> NDArray[np.int32]:
    """Non-zero weights of each kind of inputs to each range, int32 (kinds, ranges)."""
    return np.add.reduceat(sizing.pattern.mask, bounds[:-1], axis=1, dtype=np.int32)
