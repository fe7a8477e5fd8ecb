"""What goes where: boundaries of ranges, dense rows, what fills the rest of the cores, and cores on tiles.

Tile t of a chip is at column t // rows, row t % rows, as SANA-FE 2.2.9 numbers them; core c is on tile c // 4. A
message crosses as many tiles as columns and rows lie between. How the chips of a board are joined is not public: they
are taken to stand side by side, the second chip's column 0 beside the first one's last.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board

Integers = NDArray[np.int64]
Fits = Callable[[int, int], bool]
Found = tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]
"""Of some ranges: whether each can be, its cost (summed), its time (the largest counts)."""

Edge = Callable[[int, Integers], Found]
"""Of ranges from one start to several ends."""

_UNITS = 1 << 20


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


def cheapest(layers: Sequence[Integers], edge: Edge) -> Integers | None:
    """The boundaries, one of each layer, whose ranges cost least, and among these take the least longest time.

    A cheapest way is cheapest up to each of its boundaries, so costs come first exactly; among equal costs the least
    longest time up to a boundary is enough to know.
    """
    cost, time = np.zeros(1), np.zeros(1)
    ways = []
    for starts, ends in pairwise(layers):
        own_cost, own_time = np.full(ends.size, np.inf), np.full(ends.size, np.inf)
        way = np.full(ends.size, -1)
        for number in np.flatnonzero(np.isfinite(cost)):
            begin = int(np.searchsorted(ends, starts[number], side="right"))
            if begin == ends.size:
                continue
            able, more, busy = edge(int(starts[number]), ends[begin:])
            more, busy = cost[number] + more, np.maximum(time[number], busy)
            known, longest = own_cost[begin:], own_time[begin:]
            better = able & ((more < known) | ((more == known) & (busy < longest)))
            known[better], longest[better] = more[better], busy[better]
            way[begin:][better] = number
        cost, time = own_cost, own_time
        ways.append(way)
    if not np.isfinite(cost[-1]):
        return None
    bounds, place = [int(layers[-1][-1])], layers[-1].size - 1
    for layer, way in zip(reversed(layers[:-1]), reversed(ways), strict=True):
        place = int(way[place])
        bounds.append(int(layer[place]))
    return np.array(bounds[::-1])


def search(layers: Sequence[Integers], edge: Edge, most: int) -> Integers | None:
    """`cheapest`; where that has more than ``most`` ranges to look at, in steps first and then ever finer around it."""
    width = max(layer.size for layer in layers)
    most_places = width
    if sum(one.size * two.size for one, two in pairwise(layers)) > most:
        most_places = max(3, int((most / len(layers)) ** 0.5))
    chosen = [_some(layer, most_places) for layer in layers]
    bounds = cheapest(chosen, edge)
    reach = -(-width // max(1, most_places - 1))
    while bounds is not None and most_places < width and reach > 1:
        near = [layer[np.abs(layer - bound) <= reach] for layer, bound in zip(layers, bounds, strict=True)]
        # The best so far stays among what is tried, so it never gets worse.
        chosen = [np.union1d(_some(layer, most_places), [b]) for layer, b in zip(near, bounds, strict=True)]
        bounds = cheapest(chosen, edge)
        reach = -(-2 * reach // max(1, most_places - 1)) if most_places > 3 else reach // 2
    return bounds


def _some(layer: Integers, most: int) -> Integers:
    """At most ``most`` of ``layer``, evenly, its ends among them."""
    if layer.size <= most:
        return layer
    return layer[np.unique(np.linspace(0, layer.size - 1, most).round().astype(np.int64))]


def spread(
    each: NDArray[np.float64], axons: Integers, room: Integers, room_axons: Integers, busy: NDArray[np.float64]
) -> Integers | None:
    """Inputs of each core, consecutive ones in the order of the cores, so that the busiest core is least.

    Args:
        each: Time of each input, (inputs,).
        axons: Output axons of each input, int64 (inputs,).
        room, room_axons: Compartments and output axons that are left on each core, int64 (cores,).
        busy: Time of each core without inputs, (cores,).
    Returns:
        Numbers, int64 (cores,); None if the inputs do not fit.
    """
    out, time = [0, *np.cumsum(axons).tolist()], [0.0, *np.cumsum(each).tolist()]
    cores = list(zip(room.tolist(), room_axons.tolist(), busy.tolist(), strict=True))

    def fill(level: float) -> Integers:
        start, sizes = 0, []
        for places, left, taken in cores:
            end = min(start + places, bisect_right(out, out[start] + left) - 1)
            end = min(end, bisect_right(time, time[start] + level - taken) - 1)
            sizes.append(max(0, end - start))
            start += sizes[-1]
        return np.array(sizes)

    best = fill(np.inf)
    if best.sum() < axons.size:
        return None
    low, high = 0.0, float(busy.max()) + time[-1]
    for _ in range(40):
        level = (low + high) / 2
        sizes = fill(level)
        low, high, best = (low, level, sizes) if sizes.sum() == axons.size else (level, high, best)
    return best


def packed(
    most_relays: Integers, room: Integers, room_axons: Integers, relays: Integers, inputs: Integers, alike: int
) -> tuple[Integers, Integers] | None:
    """Consecutive relays and inputs on cores in any order, found if there is a way; the time is exponential in cores.

    For cores already filled and relays placed on them, only the farthest input matters that can have been reached.

    Args:
        most_relays, room, room_axons: Relays that fit, and compartments and output axons that are left, (cores,).
        relays: Output axons of relays 0 .. i - 1, int64 (relays + 1,).
        inputs: Output axons of each input, int64 (inputs,).
        alike: So many cores, the last, are the same.
    Returns:
        First and number of relays, and of inputs, of each core, int64 (cores, 2) each.
    """
    cores, count = room.size, relays.size - 1
    out = [0, *np.cumsum(inputs).tolist()]
    states: list[dict[int, tuple[int, int, int]]] = [{} for _ in range(1 << cores)]
    states[0][0] = (0, -1, -1)
    for filled in range(1 << cores):
        for placed, (reached, _, _) in states[filled].items():
            for core in range(cores):
                if filled >> core & 1 or (core > cores - alike and not filled >> (core - 1) & 1):
                    continue
                then = states[filled | 1 << core]
                for more in range(min(int(most_relays[core]), int(room[core]), count - placed) + 1):
                    left = int(room_axons[core] - relays[placed + more] + relays[placed])
                    if left < 0:
                        break
                    end = min(reached + int(room[core]) - more, bisect_right(out, out[reached] + left) - 1)
                    if then.get(placed + more, (-1, 0, 0))[0] < end:
                        then[placed + more] = (end, core, placed)
    filled, placed = (1 << cores) - 1, count
    if states[filled].get(count, (-1, 0, 0))[0] < inputs.size:
        return None
    own_relays, own_inputs = np.zeros((cores, 2), np.int64), np.zeros((cores, 2), np.int64)
    while filled:
        end, core, before = states[filled][placed]
        filled ^= 1 << core
        begin = states[filled][before][0]
        own_relays[core], own_inputs[core] = (before, placed - before), (begin, end - begin)
        placed = before
    return own_relays, own_inputs


def cheapest_choice(saved: NDArray[np.float64], added: NDArray[np.float64], need: int) -> list[int] | None:
    """What to choose so that ``saved`` sums to ``need``, by most saved per ``added``; None: there is not so much."""
    candidates = np.flatnonzero(saved > 0)
    order = candidates[np.argsort(-saved[candidates] / added[candidates], kind="stable")]
    reached = np.cumsum(saved[order])
    last = int(np.searchsorted(reached, need))
    if last == order.size:
        return None
    turned, spare = order[: last + 1].tolist(), reached[last] - need
    for place in range(last, -1, -1):
        if spare <= 0:
            break
        if saved[turned[place]] <= spare:
            spare -= saved[turned[place]]
            del turned[place]
    return turned


def firsts(sizes: Integers) -> Integers:
    """First and number of consecutive parts, int64 (parts, 2)."""
    return np.stack([np.cumsum(sizes) - sizes, sizes], axis=1)


def relay_axons(bounds: Integers, inhibit: bool) -> Integers:
    """Output axons of relays 0 .. i - 1, int64 (neurons + 1,): one for each core with neurons that the relay inhibits.

    Args:
        bounds: First neuron of each core, and their number, int64 (cores + 1,).
        inhibit: Whether relays inhibit at all.
    """
    size = np.diff(bounds)
    own = np.repeat(np.where(size == 1, size.size - 1, size.size), size) * inhibit
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(own)])


def reached_inputs(weights: NDArray[np.uint8], bounds: Integers) -> NDArray[np.bool_]:
    """Inputs with a weight to each core's neurons, bool (cores, inputs)."""
    return np.asarray(np.logical_or.reduceat(weights > 0, bounds[:-1], axis=1).T)


def traffic(
    bounds: Integers, relays: Integers, inputs: Integers, sent: NDArray[np.float64], spiking: float, inhibit: bool
) -> NDArray[np.float64]:
    """Expected messages in a step from core to core, float64 (cores, cores).

    Args:
        bounds: As in `relay_axons`; these cores come first.
        relays, inputs: First and number of each core's, int64 (cores, 2).
        sent: Spikes in a step that each input sends to each core with neurons, float64 (those cores, inputs).
        spiking: Spikes of one neuron in a step.
        inhibit: Whether relays inhibit at all.
    """
    size, total = np.diff(bounds), len(relays)
    home, relay = np.repeat(np.arange(size.size), size), np.repeat(np.arange(total), relays[:, 1])
    flow = np.zeros((total, total))
    np.add.at(flow, (home, relay), spiking)
    if inhibit:
        flow[:, : size.size] += (relays[:, 1] * spiking)[:, None]
        alone = np.flatnonzero(size[home] == 1)
        np.add.at(flow, (relay[alone], home[alone]), -spiking)
    for number, (begin, count) in enumerate(inputs):
        flow[number, : size.size] += sent[:, begin : begin + count].sum(axis=1)
    return flow


def tiles(cores: Integers, board: Board) -> Integers:
    """Column and row of the tiles of ``cores`` (n, 2: chip, core), int64 (n, 2); columns go on from chip to chip.

    Raises:
        ValueError: the board's mesh is not public.
    """
    if board.tile_cores is None or board.columns is None or board.rows is None:
        raise ValueError(f"the mesh of {board.title} is not public")
    tile = cores[:, 1] // board.tile_cores
    return np.stack([cores[:, 0] * board.columns + tile // board.rows, tile % board.rows], axis=1)


def distances(cores: Integers, board: Board) -> Integers:
    """Tiles between any two of ``cores`` (n, 2: chip, core), int64 (n, n)."""
    place = tiles(cores, board)
    return np.asarray(np.abs(place[:, None] - place[None, :]).sum(axis=2))


def place(traffic: NDArray[np.float64], board: Board) -> tuple[Integers, float | None]:
    """Chip and core of each of a plan's cores.

    Starts with the tiles of a corner, as near to a square as they come, in the order given; then exchanges the two
    places that save most, until none do. The first chip is filled before the second is touched.

    Args:
        traffic: Expected messages in a step from core to core, float64 (cores, cores).
        board: The board; it has at least so many cores.
    Returns:
        Chip and core, int64 (cores, 2); and expected tiles that messages cross in a step, None if the mesh is not
        public.
    """
    count = len(traffic)
    numbers = np.arange(count)
    start = np.stack([numbers // board.cores, numbers % board.cores], axis=1)
    if board.tile_cores is None or board.columns is None or board.rows is None:
        return start, None
    slots = _slots(count, board)
    between = distances(slots, board).astype(np.float64)
    # Whole numbers: their sums are exact, so ties are ties on every machine.
    scale = _UNITS / max(float(traffic.max(initial=0.0)), 1e-12)
    flow = np.zeros((len(slots), len(slots)))
    flow[:count, :count] = np.round((traffic + traffic.T) * scale)
    np.fill_diagonal(flow, 0)
    order = _exchanged(flow, between)
    hops = float((traffic * between[np.ix_(order[:count], order[:count])]).sum())
    return slots[order[:count]], hops


def _slots(count: int, board: Board) -> Integers:
    """Places that ``count`` cores may take, int64 (>= count, 2): whole chips, then tiles of a growing square."""
    found, left = [], count
    for chip in range(-(-count // board.cores)):
        own = np.arange(board.cores)
        place = tiles(np.stack([np.zeros_like(own), own], axis=1), board)
        order = np.lexsort((own, place.sum(axis=1), place.max(axis=1)))
        if left < board.cores and board.tile_cores is not None:
            order = order[: min(board.cores, -(-left // board.tile_cores) * board.tile_cores)]
        found.append(np.stack([np.full(order.size, chip), order], axis=1))
        left -= board.cores
    return np.concatenate(found)


def _exchanged(flow: NDArray[np.float64], between: NDArray[np.float64]) -> Integers:
    """The slot of each item after exchanges, int64 (items,); ``flow`` is symmetric."""
    order = np.arange(len(flow))
    while True:
        near = between[np.ix_(order, order)]
        reach = flow @ near
        own = np.diag(reach)
        change = reach + reach.T - own[:, None] - own[None, :] + 2 * flow * near
        best = int(np.argmin(change))
        i, k = divmod(best, len(flow))
        if change[i, k] >= 0:
            return order
        order[[i, k]] = order[[k, i]]
