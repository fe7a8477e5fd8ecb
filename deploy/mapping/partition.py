"""Which neurons stand on which core: the fewest cores, then the fewest operations, then the least busy core.

**Fewest cores.** Let k cores hold excitatory neurons, in ranges. What a range takes (compartments, axons, words with
each row in its smaller format) grows with the range, so if each of k cores takes as much as fits, they reach the
farthest neuron that k cores can: the least k is known. Relays cost the same wherever they stand, one compartment, one
input axon, one word and k output axons, so for given ranges only the number matters that fits beside each; the ranges
with most room for relays are found by dynamic programming over all places that the boundaries of k cores can take.
Relays beyond that room need cores of their own, as many as divide them. The least sum over every k up to that sum is
therefore exact. Input compartments fill what is left of all cores in order; what they need of all compartments and
output axons bounds the number of cores from below. Where a plan stays above the bounds (inputs with weights to some
cores only, relays of neurons that stand alone), small networks are searched exhaustively.

**Fewest operations, least busy core.** The ranges of k cores are chosen by dynamic programming in that order: the sum
of operations that dense rows add where memory demands them, then the largest time of a core. Where there are very many
ranges, boundaries are tried in steps and then refined around the best. Ranges that need relays elsewhere are taken as
found. Input compartments are then spread so that the busiest core is least.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, pairwise
from math import comb

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Part, Plan, PopulationName
from lava_vpr.deploy.mapping import placement
from lava_vpr.deploy.mapping.limits import check, host_spikes
from lava_vpr.deploy.mapping.placement import Found, Integers
from lava_vpr.deploy.mapping.refusal import refusal
from lava_vpr.deploy.mapping.sizing import EXC_SPIKES, Ranges, Sizing, Stored, limit_of, load
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.loihi import ACCESS_NS, MESSAGE_NS, SPIKE_NS, UPDATE_NS

_TIES = 4
"""Numbers of cores with excitatory neurons that are tried to the end among those that give equally few cores."""

_RANGES, _TIGHT_RANGES, _ROOM_RANGES = 40_000, 2_000, 500_000
"""Ranges that a search looks at: where rows may be sparse, where each range's formats are chosen, and for room."""

_ZERO, _SILENT = np.zeros(1, np.int64), np.zeros(1)
_NOTHING = Ranges(_ZERO, _ZERO, _SILENT, _SILENT, _SILENT, _ZERO, _ZERO, _ZERO)
"""A core without excitatory neurons."""
_WORK = 300_000
"""Steps of an exhaustive search that are worth it."""


@dataclass(frozen=True)
class Layout:
    """What stands on each of the cores: those with excitatory neurons first, in their order, then the others.

    Attributes:
        bounds: First neuron of each core with excitatory ones, and the number of all, int64 (k + 1,).
        axons: Output axons of relays 0 .. i - 1, int64 (neurons + 1,).
        relays, inputs: First and number of each core's, int64 (cores, 2).
        stored: How the k cores store their rows.
        reached: Inputs with a weight to each of the k cores, bool (k, inputs).
        added: Operations in a step that dense rows add, summed.
        busiest: Time in ns of the busiest core in a step.
    """

    bounds: Integers
    axons: Integers = field(repr=False)
    relays: Integers
    inputs: Integers
    stored: tuple[Stored, ...] = field(repr=False)
    reached: NDArray[np.bool_] = field(repr=False)
    added: float
    busiest: float


def partition(
    network: FixedNetwork, board: Board, rates: NDArray[np.float64], *, exc_spikes: float = EXC_SPIKES
) -> Plan:
    """Place ``network`` on the cores of ``board``.

    Args:
        network: The network.
        board: The board.
        rates: Expected spikes of each input in a step, float64 (inputs,), at least 0.
        exc_spikes: Expected spikes of all excitatory neurons together in a step.
    Raises:
        NetworkLimitError: it does not fit; the message names resource, need, limit and remedy.
        ValueError: ``rates`` are not those of the network's inputs.
    """
    if rates.shape != (network.inputs,) or not (rates >= 0).all():
        raise ValueError(f"rates of shape {rates.shape} for {network.inputs} inputs, or below 0")
    sizing = Sizing(network, board, rates, exc_spikes)
    check(sizing)
    layouts = arrange(sizing)
    if not layouts:
        raise refusal(sizing, fewest)
    best = min(layouts, key=lambda layout: (layout.added, layout.busiest))
    sent, inhibit = best.reached * sizing.grains, network.inhibition > 0
    flow = placement.traffic(best.bounds, best.relays, best.inputs, sent, sizing.spiking, inhibit)
    places, hops = placement.place(flow, board)
    cores = [_core(sizing, best, number, places[number]) for number in np.lexsort((places[:, 1], places[:, 0]))]
    bits = sizing.weight_bits, sizing.lateral_bits
    return Plan(network, board, tuple(cores), *bits, hops, host_spikes(network, rates))


def arrange(sizing: Sizing) -> list[Layout]:
    """Layouts on the fewest cores, by the number of cores with excitatory neurons; none if it does not fit."""
    most = sizing.board.chips * sizing.board.cores
    found: list[Layout] = []
    cores = least_cores(sizing)
    while cores is not None and cores <= min(most, sizing.network.neurons):
        layout = _on(sizing, cores, most - (len(found) == _TIES))
        if layout is not None:
            found = [layout] if len(layout.relays) < most else [*found, layout]
            most = len(layout.relays)
        cores += 1
    return found


def fewest(sizing: Sizing) -> int | None:
    """The fewest cores; None if it does not fit."""
    return next((len(layout.relays) for layout in arrange(sizing)), None)


def least_cores(sizing: Sizing) -> int | None:
    """Fewest cores that hold the excitatory neurons, without regard to relays and inputs; None: none can."""
    count, most = sizing.network.neurons, sizing.board.chips * sizing.board.cores
    if _holds(sizing, 0, count, 1):
        return 1
    end = cores = 0
    while end < count and cores <= most:
        start, end = end, placement.farthest(end, count, lambda a, b: _holds(sizing, a, b, 2))
        if start == end:
            return None
        cores += 1
    return max(2, cores)


def _holds(sizing: Sizing, first: int, end: int, cores: int) -> bool:
    """Whether a core holds this range without any relay."""
    return bool(_room(sizing, first, np.array([end]), cores)[1][0] >= 0)


def _room(sizing: Sizing, first: int, ends: Integers, cores: int) -> tuple[Ranges, Integers]:
    """Ranges, and relays that fit beside each with all rows in their smaller format."""
    ranges = sizing.ranges(first, ends)
    return ranges, sizing.relay_room(ranges, ranges.least_words, cores)


def _on(sizing: Sizing, cores: int, most: int) -> Layout | None:
    """A layout with ``cores`` cores of excitatory neurons on the fewest cores, at most ``most``."""
    network, board = sizing.network, sizing.board
    compartments = 2 * network.neurons + network.input_compartments
    # A relay spares one output axon if its neuron is alone on its core.
    axons = 2 * network.neurons + (network.inhibition > 0) * (cores * network.neurons - cores)
    if network.bias_input:
        axons += int(network.weights.any(axis=1).sum())
    bounds_below = (-(-compartments // limit_of(board.compartments)), -(-axons // limit_of(board.axons_out)))
    least = others = max(0, *(bound - cores for bound in bounds_below))
    if cores + least > most:
        return None
    bounds = _with_relays(sizing, cores)
    best = None if bounds is None else _least_others(sizing, bounds, least, most - cores)
    if best is not None and len(best.relays) == cores + least:
        return best
    own = int(sizing.relay_room(_NOTHING, _ZERO, cores)[0])
    most_room = cores * int(sizing.relay_room(*sizing.least_range, cores)[0])
    for easy in (True, False):
        limit = most if best is None else len(best.relays) - 1
        others = _others(network.neurons - most_room, own, least, most)
        if cores + others > limit:
            break
        # Equal ranges are tried first: they are soon made, and often as good as those with most room.
        roomy: Integers | None = np.arange(cores + 1) * network.neurons // cores
        if not easy:
            roomy, most_room = _with_room(sizing, cores)
            others = _others(network.neurons - most_room, own, least, most)
        if roomy is not None:
            best = _least_others(sizing, roomy, others, limit - cores) or best
    limit = most if best is None else len(best.relays) - 1
    # Relays of neurons that stand alone take an axon less, so the search starts below what the others need.
    tries = (_exhaustive(sizing, cores, others) for others in range(least, limit - cores + 1))
    return next((found for found in tries if found is not None), best)


def _others(missing: int, own: int, least: int, most: int) -> int:
    """Cores that ``missing`` relays need if one holds ``own``, at least ``least``."""
    return least if missing <= 0 else max(least, -(-missing // own) if own > 0 else most)


def _with_relays(sizing: Sizing, cores: int) -> Integers | None:
    """The best bounds where every relay stands with its neuron; None if there are none."""
    count, rate = sizing.network.neurons, sizing.spiking * (sizing.network.inhibition > 0)
    limit = limit_of(sizing.board.synapse_words)

    def able(ranges: Ranges, words: Integers) -> NDArray[np.bool_]:
        return sizing.relay_room(ranges, words, cores) >= ranges.size

    def loose(first: int, ends: Integers) -> Found:
        ranges = sizing.ranges(first, ends)
        sparse = able(ranges, ranges.sparse_words)
        added = np.where(sparse | sizing.all_dense, 0.0, ranges.size * rate)
        fits = sparse | able(ranges, ranges.mixed_words)
        return fits, added, sizing.time(ranges, cores, ~sparse)

    def tight(first: int, ends: Integers) -> Found:
        ranges = sizing.ranges(first, ends)
        fits, sparse = able(ranges, ranges.least_words), able(ranges, ranges.sparse_words)
        added, time = np.zeros(ends.size), sizing.time(ranges, cores, ~sparse)
        for i in np.flatnonzero(fits & ~sparse):
            stored = sizing.formats(first, int(ends[i]), limit - int(ranges.size[i]))
            if stored is None:
                fits[i] = False
            else:
                added[i] = stored.added
                time[i] = sizing.time_of(ranges, i, stored, cores)
        return fits, added, time

    def fits(first: int, end: int, tight: bool) -> bool:
        ranges = sizing.ranges(first, np.array([end]))
        return bool(able(ranges, ranges.least_words if tight else ranges.easy_words)[0])

    layers = placement.windows(count, cores, partial(fits, tight=False))
    if layers is not None:
        return placement.search(layers, loose, _RANGES)
    layers = placement.windows(count, cores, partial(fits, tight=True))
    return None if layers is None else placement.search(layers, tight, _TIGHT_RANGES)


def _with_room(sizing: Sizing, cores: int) -> tuple[Integers | None, int]:
    """The bounds with most room for relays, and that room."""
    count = sizing.network.neurons

    def edge(first: int, ends: Integers) -> Found:
        room = np.minimum(_room(sizing, first, ends, cores)[1], count)
        return room >= 0, -room.astype(np.float64), np.zeros(ends.size)

    layers = placement.windows(count, cores, lambda a, b: _holds(sizing, a, b, cores))
    bounds = None if layers is None else placement.search(layers, edge, _ROOM_RANGES)
    if bounds is None:
        return None, 0
    pairs = pairwise(bounds)
    return bounds, int(sum(-edge(int(a), np.array([b]))[1][0] for a, b in pairs))


def _least_others(sizing: Sizing, bounds: Integers, least: int, most: int) -> Layout | None:
    """A layout with ``bounds`` and the fewest cores without excitatory neurons, from ``least`` to ``most``."""
    low, tried, step, best = least, least, 1, None
    while best is None and tried <= most:
        best = settle(sizing, bounds, tried)
        if best is None:
            low, tried, step = tried + 1, max(tried + 1, min(tried + step, most)), 2 * step
    high = tried
    while best is not None and low < high:
        middle = (low + high) // 2
        layout = settle(sizing, bounds, middle)
        low, high, best = (middle + 1, high, best) if layout is None else (low, middle, layout)
    return best


def settle(sizing: Sizing, bounds: Integers, others: int) -> Layout | None:
    """Relays and inputs beside the neurons of ``bounds`` and on ``others`` more cores; None if they do not fit."""
    cores, count = bounds.size - 1, sizing.network.neurons
    parts = [_room(sizing, int(a), np.array([b]), cores) for a, b in pairwise(bounds)]
    room = np.array([own[0] for _, own in parts] + [0] * others)
    if room.min() < 0:
        return None
    if others:
        room[cores:] = sizing.relay_room(_NOTHING, _ZERO, cores)[0]
    relays = np.minimum(np.append(np.diff(bounds), np.zeros(others, np.int64)), room)
    missing = count - int(relays.sum())
    free = room - relays
    relays = relays + np.clip(missing - (np.cumsum(free) - free), 0, free)
    if relays.sum() < count:
        return None
    return complete(sizing, bounds, placement.firsts(relays), None)


def complete(sizing: Sizing, bounds: Integers, relays: Integers, inputs: Integers | None) -> Layout | None:
    """The layout with these relays; without ``inputs`` those are spread. None if it does not fit."""
    network, board = sizing.network, sizing.board
    cores = bounds.size - 1
    size = np.zeros(len(relays), np.int64)
    size[:cores] = np.diff(bounds)
    axons = placement.relay_axons(bounds, network.inhibition > 0)
    out = limit_of(board.axons_out) - 2 * size - (axons[relays.sum(axis=1)] - axons[relays[:, 0]])
    if out.min() < 0:
        return None
    words = limit_of(board.synapse_words)
    stored = [sizing.formats(int(a), int(b), words - int(relays[i, 1])) for i, (a, b) in enumerate(pairwise(bounds))]
    kept = tuple(own for own in stored if own is not None)
    if len(kept) < cores:
        return None
    reached = placement.reached_inputs(network.weights, bounds)
    layout = Layout(bounds, axons, relays, np.zeros_like(relays), kept, reached, sum(own.added for own in kept), 0.0)
    busy = np.array([_load(sizing, layout, number).nanoseconds for number in range(len(relays))])
    if inputs is None:
        room = limit_of(board.compartments) - size - relays[:, 1]
        targets = reached.sum(axis=0)[: network.input_compartments]
        each = ACCESS_NS + UPDATE_NS + sizing.grains[: targets.size] * (SPIKE_NS + MESSAGE_NS * targets)
        sizes = placement.spread(each, targets, room, out, busy)
        if sizes is None:
            return None
        inputs = placement.firsts(sizes)
    used = (size + relays[:, 1] + inputs[:, 1]) > 0
    layout = Layout(bounds, axons, relays[used], inputs[used], kept, reached, layout.added, 0.0)
    busiest = max(_load(sizing, layout, number).nanoseconds for number in range(len(layout.relays)))
    return replace(layout, busiest=busiest)


def _exhaustive(sizing: Sizing, cores: int, others: int) -> Layout | None:
    """A layout on exactly so many cores if there is one; None also if the search would take too long."""
    network, total = sizing.network, cores + others
    choices = comb(network.neurons - 1, cores - 1)
    if choices * (2**total * total * network.neurons**2 // 4 + 1) > _WORK:
        return None
    for inner in combinations(range(1, network.neurons), cores - 1):
        bounds = np.array([0, *inner, network.neurons])
        sets = [_room(sizing, int(a), np.array([b]), 1) for a, b in pairwise(bounds)]
        # Asked for one core, room regards output axons too little; `packed` counts them itself.
        most = [int(room[0]) for _, room in sets] + [int(sizing.relay_room(_NOTHING, _ZERO, 1)[0])] * others
        size = np.append(np.diff(bounds), np.zeros(others, np.int64))
        room = limit_of(sizing.board.compartments) - size
        out = limit_of(sizing.board.axons_out) - 2 * size
        targets = placement.reached_inputs(network.weights, bounds).sum(axis=0)[: network.input_compartments]
        parts = placement.packed(
            np.array(most), room, out, placement.relay_axons(bounds, network.inhibition > 0), targets, others
        )
        layout = None if parts is None else complete(sizing, bounds, *parts)
        if layout is not None:
            return layout
    return None


def _load(sizing: Sizing, layout: Layout, number: int) -> Load:
    """What a core is expected to do in a step."""
    rate, cores = sizing.spiking, layout.bounds.size - 1
    first, relays = layout.relays[number]
    begin, inputs = layout.inputs[number]
    size, arriving, dense, sparse = 0, 0.0, 0.0, 0.0
    if number < cores:
        size, stored = int(layout.bounds[number + 1] - layout.bounds[number]), layout.stored[number]
        arriving = float(sizing.grains[layout.reached[number]].sum()) + sizing.relay_axons_of(size) * rate
        dense, sparse = stored.dense, stored.sparse
    own = sizing.grains[begin : begin + inputs]
    axons = layout.axons
    leaving = (2 * size + float(axons[first + relays] - axons[first])) * rate
    leaving += float((own * layout.reached[:, begin : begin + inputs].sum(axis=0)).sum())
    arriving, sparse, hits = arriving + relays * rate, sparse + relays * rate, relays * rate
    return load(arriving, dense, sparse, size + inputs + hits, size * rate + hits + float(own.sum()), leaving)


def _needs(sizing: Sizing, layout: Layout, number: int) -> Needs:
    """What a core's content takes."""
    network, board, cores = sizing.network, sizing.board, layout.bounds.size - 1
    first, relays = (int(value) for value in layout.relays[number])
    begin, inputs = (int(value) for value in layout.inputs[number])
    axons = layout.axons
    size, axons_in, words, kinds = 0, relays, relays, {"relay"} if relays else set()
    if number < cores:
        size, stored = int(layout.bounds[number + 1] - layout.bounds[number]), layout.stored[number]
        reached, words = layout.reached[number], words + stored.words
        axons_in += int(reached.sum()) + sizing.relay_axons_of(size)
        kinds |= {f"inputs {dense}" for dense in np.unique(stored.inputs[reached])}
        if network.inhibition and size > 1:
            kinds.add(f"lateral {stored.lateral}")
        if network.inhibition and size < network.neurons:
            kinds.add("lateral True")
    axons_out = 2 * size + int(axons[first + relays] - axons[first])
    axons_out += int(layout.reached[:, begin : begin + inputs].sum())
    populations = (size > 0) + (relays > 0) + (inputs > 0)

    def known(limit: int | None, value: int) -> int | None:
        return None if limit is None else value

    return Needs(
        size + relays + inputs,
        known(board.axons_in, axons_in),
        known(board.axons_out, axons_out),
        known(board.synapse_words, words),
        known(board.profiles, populations),
        known(board.thresholds, populations),
        known(board.formats, len(kinds)),
    )


def _core(sizing: Sizing, layout: Layout, number: int, where: Integers) -> CorePlan:
    """The plan of one core."""
    cores, parts, compartment = layout.bounds.size - 1, [], 0
    own: list[tuple[PopulationName, Integers]] = [("inh", layout.relays[number]), ("inputs", layout.inputs[number])]
    dense, lateral = np.zeros(sizing.network.inputs, np.bool_), sizing.all_dense
    if number < cores:
        first, end = layout.bounds[number : number + 2]
        own.insert(0, ("exc", np.array([first, end - first])))
        dense, lateral = layout.stored[number].inputs, layout.stored[number].lateral
    for population, (begin, size) in own:
        if size:
            parts.append(Part(population, int(begin), int(size), compartment))
            compartment += int(size)
    needs, load = _needs(sizing, layout, number), _load(sizing, layout, number)
    return CorePlan(int(where[0]), int(where[1]), tuple(parts), dense, lateral, needs, load)
