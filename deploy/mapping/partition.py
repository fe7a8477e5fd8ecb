"""Which neurons stand on which core: few cores, then few operations, then the least busy core.

The strategy, for k cores that hold excitatory neurons in consecutive ranges:

1. **The least k.** What a range takes (compartments, axons, words with each row in its smaller format) grows with the
   range, so if each core takes as many neurons as fit, k cores reach the farthest neuron that they can.
2. **Ranges of k cores.** Three ways are tried, each only if it can need fewer cores than the ones before: ranges whose
   relays all fit beside them; equal ranges; the ranges with most room for relays. Where relays fit, the sum of
   operations that dense rows add counts first, then the largest time of a core.
3. **Relays** stand beside their neurons as far as there is room, the others on other cores with room, then on cores of
   their own. They cost the same wherever they stand: one compartment, one input axon, one word, k output axons.
4. **Inputs** that integrate a bias fill what is left of all cores, so that the busiest core is least busy.

Every k is tried up to the number of cores found. Of the layouts on the fewest cores the one with the fewest operations
is chosen, then the one with the least busy core.

What this finds is exact where spikes are injected: no plan takes fewer cores in which every neuron shares its core with
another, because only the number of relays that fit beside the ranges matters then, and the third way finds the most (of
more than `_ROOM_RANGES` ranges, near to the most). A plan on fewer cores may exist where neurons stand alone on their
cores, whose relays take an axon less, and where inputs integrate a bias, if they have weights to some cores only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.mapping.boundaries import Integers, RangeCosts, farthest, search, windows
from lava_vpr.deploy.mapping.layout import Layout, fill
from lava_vpr.deploy.mapping.limits import check, host_spikes
from lava_vpr.deploy.mapping.mesh import assign_cores
from lava_vpr.deploy.mapping.refusal import refusal
from lava_vpr.deploy.mapping.row_formats import choose_formats
from lava_vpr.deploy.mapping.sizing import EXC_SPIKES, NO_NEURONS, NeuronRanges, Sizing, limit_of
from lava_vpr.engine.inference.fixed import FixedNetwork

_EQUALLY_FEW = 4
"""Layouts on equally few cores that are compared; after these only fewer cores are looked for."""

_RANGES, _FORMATTED_RANGES, _ROOM_RANGES = 40_000, 2_000, 500_000
"""Ranges that a search looks at: where rows may be sparse, where each range's formats are chosen, and for room."""


def partition(
    network: FixedNetwork, board: Board, rates: NDArray[np.float64], *, exc_spikes: float = EXC_SPIKES
) -> Plan:
    """Put ``network`` on the cores of ``board``.

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
    layouts = layouts_on_fewest_cores(sizing)
    if not layouts:
        raise refusal(sizing, fewest_cores)
    layout = min(layouts, key=lambda layout: (layout.added, layout.busiest))
    positions, hops = assign_cores(layout.traffic(), board)
    order = np.lexsort((positions[:, 1], positions[:, 0]))
    cores = tuple(layout.core_plan(int(number), *positions[number].tolist()) for number in order)
    spikes = host_spikes(network, rates)
    return Plan(network, board, cores, sizing.weight_bits, sizing.lateral_bits, hops, spikes)


def layouts_on_fewest_cores(sizing: Sizing) -> list[Layout]:
    """Layouts on equally few cores, by the number of cores with excitatory neurons; none if none was found."""
    layouts: list[Layout] = []
    cores, most = least_cores(sizing), sizing.board.chips * sizing.board.cores
    while cores is not None and cores <= min(most, sizing.network.neurons):
        layout = _layout_on(sizing, cores, most - 1 if len(layouts) == _EQUALLY_FEW else most)
        if layout is not None:
            if len(layout.relays) < most:
                layouts, most = [], len(layout.relays)
            layouts.append(layout)
        cores += 1
    return layouts


def fewest_cores(sizing: Sizing) -> int | None:
    """Cores that a plan takes; None if the network does not fit."""
    layouts = layouts_on_fewest_cores(sizing)
    return len(layouts[0].relays) if layouts else None


def least_cores(sizing: Sizing) -> int | None:
    """Fewest cores that hold the excitatory neurons, without regard to relays and inputs; None: none can."""
    count, most = sizing.network.neurons, sizing.board.chips * sizing.board.cores
    # All neurons together need no row for relays elsewhere, so they may fit where fewer do not.
    if sizing.holds(0, count):
        return 1
    end = cores = 0
    while end < count and cores <= most:
        start, end = end, farthest(end, count, sizing.holds)
        if start == end:
            return None
        cores += 1
    return cores


def least_further(sizing: Sizing, cores: int) -> int | None:
    """Cores without excitatory neurons that a layout with ``cores`` others has at least; None: there is no layout."""
    network, board = sizing.network, sizing.board
    compartments = 2 * network.neurons + network.input_compartments
    axons_out = 2 * network.neurons
    if sizing.inhibits:
        # A relay spares one output axon if its neuron is alone on its core.
        axons_out += cores * network.neurons - cores
    if network.input_compartments:
        axons_out += int(network.weights.any(axis=1).sum())
    total = max(cores, -(-compartments // limit_of(board.compartments)), -(-axons_out // limit_of(board.axons_out)))
    elsewhere = network.neurons - cores * _relays_beside(sizing, sizing.least_range, cores)
    if elsewhere > 0:
        room = _relays_beside(sizing, NO_NEURONS, cores)
        if room <= 0:
            return None
        total = max(total, cores + -(-elsewhere // room))
    return total - cores


def _relays_beside(sizing: Sizing, neurons: NeuronRanges, cores: int) -> int:
    """Relays that fit beside the one range ``neurons``, negative if not even that fits."""
    return int(sizing.relay_room(neurons, neurons.words_least, cores)[0])


def _layout_on(sizing: Sizing, cores: int, most: int) -> Layout | None:
    """A layout with ``cores`` cores of excitatory neurons on the fewest cores that are found, at most ``most``."""
    further, best = least_further(sizing, cores), None
    for choose_ranges in (_ranges_beside_their_relays, _equal_ranges, _ranges_with_most_room):
        if further is None or cores + further > most:
            break
        bounds = choose_ranges(sizing, cores)
        layout = None if bounds is None else _fill_fewest(sizing, bounds, further, most - cores)
        if layout is not None:
            best, most = layout, len(layout.relays) - 1
    return best


def _fill_fewest(sizing: Sizing, bounds: Integers, least: int, most: int) -> Layout | None:
    """A layout with ``bounds`` and the fewest cores without excitatory neurons, from ``least`` to ``most``."""
    layout = fill(sizing, bounds, least)
    if layout is not None:
        return layout
    too_few = farthest(least, most, lambda _, further: fill(sizing, bounds, further) is None)
    return fill(sizing, bounds, too_few + 1) if too_few < most else None


def _equal_ranges(sizing: Sizing, cores: int) -> Integers:
    """Bounds of ranges of equal size: soon made, and often as good as those with most room."""
    return np.arange(cores + 1) * sizing.network.neurons // cores


def _ranges_beside_their_relays(sizing: Sizing, cores: int) -> Integers | None:
    """The best bounds where every relay stands beside its neuron; None if there are none.

    First only the rows of a core's own relays may turn dense; if memory demands more, formats are chosen row by row.
    """
    limit = limit_of(sizing.board.synapse_words)
    lateral_rate = sizing.spiking if sizing.inhibits else 0.0

    def able(ranges: NeuronRanges, words: Integers) -> NDArray[np.bool_]:
        """Whether cores hold ``ranges``, stored in ``words``, and their relays."""
        return sizing.relay_room(ranges, words, cores) >= ranges.size

    def with_sparse_inputs(first: int, ends: Integers) -> RangeCosts:
        """The operations that the rows of a core's own relays add if they have to be dense."""
        ranges = sizing.ranges(first, ends)
        sparse = able(ranges, ranges.words_lateral_sparse)
        added = np.where(sparse | sizing.all_dense, 0.0, ranges.size * lateral_rate)
        fits = sparse | able(ranges, ranges.words_lateral_dense)
        return RangeCosts(fits, added, sizing.time(ranges, cores, ~sparse))

    def with_chosen_formats(first: int, ends: Integers) -> RangeCosts:
        """Operations that the rows add which `choose_formats` turns dense."""
        ranges = sizing.ranges(first, ends)
        fits, sparse = able(ranges, ranges.words_least), able(ranges, ranges.words_lateral_sparse)
        added, time = np.zeros(ends.size), sizing.time(ranges, cores, ~sparse)
        for i in np.flatnonzero(fits & ~sparse):
            rows = choose_formats(sizing, first, int(ends[i]), limit - int(ranges.size[i]))
            if rows is None:
                fits[i] = False
            else:
                added[i] = rows.added
                time[i] = sizing.time_of(ranges, rows.dense, rows.sparse, cores)[i]
        return RangeCosts(fits, added, time)

    def fits_with_sparse_inputs(first: int, end: int) -> bool:
        return bool(with_sparse_inputs(first, np.array([end])).fits[0])

    def fits_in_least_words(first: int, end: int) -> bool:
        ranges = sizing.range_of(first, end)
        return bool(able(ranges, ranges.words_least)[0])

    layers = windows(sizing.network.neurons, cores, fits_with_sparse_inputs)
    if layers is not None:
        return search(layers, with_sparse_inputs, _RANGES)
    layers = windows(sizing.network.neurons, cores, fits_in_least_words)
    return None if layers is None else search(layers, with_chosen_formats, _FORMATTED_RANGES)


def _ranges_with_most_room(sizing: Sizing, cores: int) -> Integers | None:
    """The bounds with most room for relays; None if so few cores cannot hold the neurons."""

    def by_room(first: int, ends: Integers) -> RangeCosts:
        """The costs of ranges by which those with the most room for relays are the cheapest."""
        ranges = sizing.ranges(first, ends)
        room = np.minimum(sizing.relay_room(ranges, ranges.words_least, cores), sizing.network.neurons)
        return RangeCosts(room >= 0, -room.astype(np.float64), np.zeros(ends.size))

    layers = windows(sizing.network.neurons, cores, sizing.holds)
    return None if layers is None else search(layers, by_room, _ROOM_RANGES)
