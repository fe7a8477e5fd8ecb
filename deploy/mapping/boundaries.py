"""Boundaries of consecutive ranges of neurons: how far a range reaches, and the ranges that cost least."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Fits = Callable[[int, int], bool]
"""Whether a core can hold the range from the first number to the second, which is not in it."""


class RangeCosts(NamedTuple):
    """What some ranges cost, arrays (ranges,).

    Attributes:
        fits: Whether a core can hold each range.
        cost: What is summed over the chosen ranges.
        time: What counts by its largest value among the chosen ranges.
    """

    fits: NDArray[np.bool_]
    cost: NDArray[np.float64]
    time: NDArray[np.float64]


CostOf = Callable[[int, Integers], RangeCosts]
"""The costs of the ranges from one start to several ends."""


def farthest(first: int, count: int, fits: Fits) -> int:
    """Largest end of a range from ``first`` that fits, at most ``count``; ``first`` if not even one neuron does."""
    low, high, step = first, first + 1, 1
    while high <= count and fits(first, high):
        low, high, step = high, high + step, 2 * step
    high = min(high, count + 1)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(first, middle) else (low, middle)
    return low


def _nearest(end: int, fits: Fits) -> int:
    """Smallest start of a range to ``end`` that fits."""
    return end - farthest(0, end, lambda _, size: fits(end - size, end))


def windows(count: int, parts: int, fits: Fits) -> list[Integers] | None:
    """Where the boundaries of ``parts`` ranges of neurons 0 .. count - 1 can be; None if so few cannot hold them.

    Args:
        count: Neurons.
        parts: Ranges, at most ``count``.
        fits: Whether a core can hold a range; what lies within a range that fits, fits.
    Returns:
        The possible positions of each of the ``parts + 1`` boundaries, ascending.
    """
    rightmost, leftmost = [0], [count]
    for _ in range(parts):
        rightmost.append(farthest(rightmost[-1], count, fits))
        if rightmost[-1] == rightmost[-2] < count:
            return None
    if rightmost[-1] < count:
        return None
    for _ in range(parts):
        leftmost.append(_nearest(leftmost[-1], fits) if leftmost[-1] else 0)
    layers = []
    for number, (last, first) in enumerate(zip(rightmost, reversed(leftmost), strict=True)):
        layers.append(np.arange(max(first, number), min(last, count - parts + number) + 1))
    return layers


def cheapest(layers: Sequence[Integers], cost_of: CostOf) -> Integers | None:
    """The boundaries, one of each layer, whose ranges cost least, and among these take the least longest time.

    A cheapest way is cheapest up to each of its boundaries, so costs come first exactly; among equal costs the least
    longest time up to a boundary is enough to know.
    """
    cost, time = np.zeros(1), np.zeros(1)
    predecessors = []
    for starts, ends in pairwise(layers):
        least_cost, least_time = np.full(ends.size, np.inf), np.full(ends.size, np.inf)
        predecessor = np.full(ends.size, -1)
        for number in np.flatnonzero(np.isfinite(cost)):
            begin = int(np.searchsorted(ends, starts[number], side="right"))
            if begin == ends.size:
                continue
            costs = cost_of(int(starts[number]), ends[begin:])
            total, longest = cost[number] + costs.cost, np.maximum(time[number], costs.time)
            known_total, known_longest = least_cost[begin:], least_time[begin:]
            better = costs.fits & ((total < known_total) | ((total == known_total) & (longest < known_longest)))
            known_total[better], known_longest[better] = total[better], longest[better]
            predecessor[begin:][better] = number
        cost, time = least_cost, least_time
        predecessors.append(predecessor)
    if not np.isfinite(cost[-1]):
        return None
    bounds, number = [int(layers[-1][-1])], layers[-1].size - 1
    for layer, predecessor in zip(reversed(layers[:-1]), reversed(predecessors), strict=True):
        number = int(predecessor[number])
        bounds.append(int(layer[number]))
    return np.array(bounds[::-1])


def search(layers: Sequence[Integers], cost_of: CostOf, most: int) -> Integers | None:
    """The boundaries that `cheapest` finds, or near to them.

    Where there are more than ``most`` ranges to look at, boundaries are tried in steps first and then ever finer around
    the best.
    """
    width = max(layer.size for layer in layers)
    tried = width
    if sum(starts.size * ends.size for starts, ends in pairwise(layers)) > most:
        tried = max(3, int((most / len(layers)) ** 0.5))
    bounds = cheapest([_evenly(layer, tried) for layer in layers], cost_of)
    reach = -(-width // max(1, tried - 1))
    while bounds is not None and tried < width and reach > 1:
        near = [layer[np.abs(layer - bound) <= reach] for layer, bound in zip(layers, bounds, strict=True)]
        # The best so far stays among what is tried, so it never gets worse.
        chosen = [np.union1d(_evenly(layer, tried), [bound]) for layer, bound in zip(near, bounds, strict=True)]
        bounds = cheapest(chosen, cost_of)
        reach = -(-2 * reach // max(1, tried - 1)) if tried > 3 else reach // 2
    return bounds


def _evenly(layer: Integers, most: int) -> Integers:
    """At most ``most`` boundaries of ``layer``, evenly spread, its ends among them."""
    if layer.size <= most:
        return layer
    return layer[np.unique(np.linspace(0, layer.size - 1, most).round().astype(np.int64))]
