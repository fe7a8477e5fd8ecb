"""Placement of neurons: excitatory ones in few, even, consecutive ranges, one per core; inhibitory neurons and input
compartments beside them as far as there is room, then on further cores."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.mapping.sizing import Floats, Integers, Sizing

_AROUND = 12
"""Distance from the last range's size within which the next one's is searched first."""

_CLOSE = 32
"""The search for the shortest longest range stops within 1 / _CLOSE of it."""


def fitting(sizing: Sizing, sizes: Integers, active: Integers, words: Integers) -> NDArray[np.bool_]:
    """Whether a core holds ranges of ``sizes`` neurons with so many inputs and words, bool (ranges,)."""
    board = sizing.board
    return np.asarray(
        ((1 + sizing.counters) * sizes <= board.compartments)
        & (active + sizing.inhibits + sizing.counters * sizes <= board.axons_in)
        & (2 * sizes <= board.axons_out)
        & (words <= board.memory.capacity)
    )


def farthest(sizing: Sizing, first: int, most: int, about: int) -> int:
    """Most neurons from ``first`` on, at most ``most``, that a core holds; the search starts around ``about``."""
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
    """Bounds of at most ``cores`` ranges of at most ``most`` neurons each, each as long as a core holds: the first
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


COMPARTMENTS, INDEXED, AXONS_IN, AXONS_OUT, WORDS = range(5)
"""Columns of `Placed.room`: the room of a core; indexed: compartments that a sparse synapse can name."""


@dataclass(frozen=True)
class Placed:
    """The content of each core: cores with excitatory neurons first, in their order, then the others.

    Attributes:
        bounds: First neuron of each core with excitatory ones, and the number of all, int64 (k + 1,).
        inh, inputs: First and number of each core's, int64 (cores, 2).
        room: Room left for inputs on each core, with each row in its smallest format, int64 (cores, 5).
    """

    bounds: Integers = field(repr=False)
    inh: Integers = field(repr=False)
    inputs: Integers = field(repr=False)
    room: Integers = field(repr=False)

    @property
    def cores(self) -> int:
        """The number of cores."""
        return len(self.room)


def place(sizing: Sizing, bounds: Integers, most: int) -> Placed | None:
    """Place the inhibitory neurons and the inputs beside the ranges of ``bounds``, on the fewest cores found.

    Returns:
        The content of at most ``most`` cores; None if it does not fit.
    """
    cores = bounds.size - 1
    empty = _empty(sizing)
    room = np.repeat(empty[None], cores, axis=0)
    size = np.diff(bounds)
    counts = counts_of(sizing, bounds)
    active, words = sizing.taken(size, counts)
    places, axons = (1 + sizing.counters) * size, active + sizing.inhibits + sizing.counters * size
    room -= np.stack([places, places, axons, 2 * size, words], axis=1)
    if room.min() < 0:
        return None
    placed = _place_inhibitory(sizing, room, most)
    if placed is None:
        return None
    inh, room = placed
    inputs = _place_inputs(sizing, counts, room, most)
    if inputs is None:
        return None
    added = len(inputs) - len(room)
    room = np.concatenate([room, np.repeat(empty[None], added, axis=0)])
    inh = np.concatenate([inh, np.zeros((added, 2), np.int64)])
    return Placed(bounds, inh, consecutive(inputs), room)


def _empty(sizing: Sizing) -> Integers:
    """The room of an empty core."""
    board = sizing.board
    return np.array(
        [
            board.compartments,
            min(board.compartments, board.memory.indexable),
            board.axons_in,
            board.axons_out,
            board.memory.capacity,
        ]
    )


def _place_inhibitory(sizing: Sizing, room: Integers, most: int) -> tuple[Integers, Integers] | None:
    """First and number of the inhibitory neurons on each core, and the room they leave; None if they do not fit.

    Each is placed on the core of the one before it, else on the core without inhibitory neurons that has most room for
    input axons, else on a core of its own.
    """
    empty, targets = _empty(sizing), len(room) * sizing.inhibits
    inh = np.zeros((len(room), 2), np.int64)
    at = -1
    for number, listened in enumerate(sizing.listened.tolist()):
        root = number == sizing.network.leaves
        need = np.array([1, 1, listened, targets if root else 1, listened])
        able = np.flatnonzero((room >= need).all(axis=1) & (inh[:, 1] == 0))
        if at < 0 or (room[at] < need).any():
            if able.size == 0:
                room, inh = np.concatenate([room, empty[None]]), np.concatenate([inh, np.zeros((1, 2), np.int64)])
                able = np.array([len(room) - 1])
                if len(room) > most or (empty < need).any():
                    return None
            at = int(able[np.argmax(room[able, AXONS_IN])])
            inh[at, 0] = number
        inh[at, 1] += 1
        room[at] -= need
    return inh, room


def _place_inputs(sizing: Sizing, counts: NDArray[np.int32], room: Integers, most: int) -> Integers | None:
    """Number of input compartments of each core, with the fewest further cores, int64 (cores,); None if they do not
    fit."""
    if sizing.network.input_compartments == 0:
        return np.zeros(len(room), np.int64)
    axons = np.concatenate([[0], np.cumsum(np.count_nonzero(counts, axis=1)[sizing.pattern.kind])])
    empty, start = _empty(sizing), 0
    sizes: list[int] = []
    while start < sizing.network.inputs or len(sizes) < len(room):
        if len(sizes) == most:
            return None
        own = room[len(sizes)] if len(sizes) < len(room) else empty
        end = int(np.searchsorted(axons, axons[start] + own[AXONS_OUT], side="right")) - 1
        sizes.append(min(end - start, int(own[_of_inputs(sizing)].min()), sizing.network.inputs - start))
        start += sizes[-1]
        if len(sizes) > len(room) and sizes[-1] == 0:
            return None
    return np.array(sizes)


def _of_inputs(sizing: Sizing) -> list[int]:
    """What limits the inputs on a core besides output axons, in the order of `Placed.room`."""
    return [COMPARTMENTS, INDEXED, AXONS_IN, WORDS] if sizing.network.relayed else [COMPARTMENTS]


def balanced(sizing: Sizing, placed: Placed) -> Placed:
    """``placed`` with its inputs spread so that the busiest core has the least load."""
    if sizing.network.input_compartments == 0:
        return placed
    size, counts = np.diff(placed.bounds), counts_of(sizing, placed.bounds)
    axons, spiking = np.count_nonzero(counts, axis=1)[sizing.pattern.kind], sizing.grains
    times = sizing.board.busy(accesses=1.0, updates=1.0, spikes=spiking, messages_out=spiking * axons)
    busy = np.append(_busy(sizing, size, counts), np.zeros(placed.cores - size.size))
    sizes = spread(times, axons, placed.room[:, _of_inputs(sizing)].min(axis=1), placed.room[:, AXONS_OUT], busy)
    return placed if sizes is None else replace(placed, inputs=consecutive(sizes))


def _busy(sizing: Sizing, size: Integers, counts: NDArray[np.int32]) -> Floats:
    """About what a step keeps each core with excitatory neurons busy (`Board.busy`): their updates, arriving spikes."""
    spikes = np.bincount(sizing.pattern.kind, weights=sizing.grains, minlength=len(counts))
    mapped = (1 + sizing.counters) * size
    arriving, operations = spikes @ (counts > 0), spikes @ counts
    return sizing.board.busy(messages_in=arriving, operations_sparse=operations, accesses=mapped, updates=size)


def consecutive(sizes: Integers) -> Integers:
    """First and number of consecutive parts, int64 (parts, 2)."""
    return np.stack([np.cumsum(sizes) - sizes, sizes], axis=1)


def spread(each: Floats, axons: Integers, room: Integers, room_axons: Integers, busy: Floats) -> Integers | None:
    """Inputs of each core, consecutive ones in the order of the cores, so that the busiest core has the least load.

    Args:
        each: Time of each input, (inputs,).
        axons: Output axons of each input, int64 (inputs,).
        room, room_axons: Inputs and output axons that are left on each core, int64 (cores,).
        busy: Time of each core without inputs, (cores,).
    Returns:
        Numbers, int64 (cores,); None if the inputs do not fit.
    """
    axons_before, time_before = [0, *np.cumsum(axons).tolist()], [0.0, *np.cumsum(each).tolist()]
    cores = list(zip(room.tolist(), room_axons.tolist(), busy.tolist(), strict=True))

    def below(level: float) -> Integers:
        """The number of inputs on each core: as many, from the first core on, as keep it within ``level``."""
        start, sizes = 0, []
        for places, free_axons, taken in cores:
            end = min(start + places, bisect_right(axons_before, axons_before[start] + free_axons) - 1)
            end = min(end, bisect_right(time_before, time_before[start] + level - taken) - 1)
            sizes.append(max(0, end - start))
            start += sizes[-1]
        return np.array(sizes)

    best = below(np.inf)
    if best.sum() < axons.size:
        return None
    low, high = 0.0, float(busy.max()) + time_before[-1]
    for _ in range(40):
        level = (low + high) / 2
        sizes = below(level)
        low, high, best = (low, level, sizes) if sizes.sum() == axons.size else (level, high, best)
    return best
