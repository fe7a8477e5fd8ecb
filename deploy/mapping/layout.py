"""What stands on each core: ranges of neurons, relays beside them or on cores of their own, and inputs in what is left.

Relays and inputs of a core are consecutive ones, in the order of the cores.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Part, PopulationName
from lava_vpr.deploy.boards.step_time import neuron_nanoseconds
from lava_vpr.deploy.mapping.boundaries import Integers
from lava_vpr.deploy.mapping.row_formats import StoredRows, choose_formats
from lava_vpr.deploy.mapping.sizing import NO_NEURONS, Floats, Sizing, limit_of, load


@dataclass(frozen=True)
class Layout:
    """What stands on each of the cores: those with excitatory neurons first, in their order, then the others.

    Attributes:
        sizing: The network and its board.
        bounds: First neuron of each core with excitatory ones, and the number of all, int64 (k + 1,).
        relays, inputs: First and number of each core's, int64 (cores, 2).
        rows: How the k cores store their rows.
        reached: Inputs with a weight to each of the k cores, bool (k, inputs).
    """

    sizing: Sizing = field(repr=False)
    bounds: Integers
    relays: Integers
    inputs: Integers
    rows: tuple[StoredRows, ...] = field(repr=False)
    reached: NDArray[np.bool_] = field(repr=False)

    @cached_property
    def sizes(self) -> Integers:
        """Excitatory neurons of each core, int64 (cores,)."""
        return np.append(np.diff(self.bounds), np.zeros(len(self.relays) - len(self.rows), np.int64))

    @cached_property
    def relay_axons(self) -> Integers:
        """Output axons of relays 0 .. i - 1, int64 (neurons + 1,): one for each core with neurons that the relay
        inhibits."""
        size = np.diff(self.bounds)
        axons = np.zeros(self.sizing.network.neurons, np.int64)
        if self.sizing.inhibits:
            axons = np.repeat(np.where(size == 1, size.size - 1, size.size), size)
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(axons)])

    @property
    def added(self) -> float:
        """Operations in a step that dense rows add, summed over the cores."""
        return sum(rows.added for rows in self.rows)

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """What each core is expected to do in a step."""
        return tuple(self._load(number) for number in range(len(self.relays)))

    @property
    def busiest(self) -> float:
        """Time in ns of the busiest core in a step."""
        return max(load.nanoseconds for load in self.loads)

    def _load(self, number: int) -> Load:
        """What a core is expected to do in a step."""
        sizing, size = self.sizing, int(self.sizes[number])
        spiking = sizing.spiking
        (first, relays), (begin, inputs) = self.relays[number], self.inputs[number]
        arriving, dense, sparse = 0.0, 0.0, 0.0
        if size:
            rows = self.rows[number]
            arriving = float(sizing.grains[self.reached[number]].sum()) + sizing.relay_axons_of(size) * spiking
            dense, sparse = rows.dense, rows.sparse
        input_spikes = sizing.grains[begin : begin + inputs]
        relay_spikes = relays * spiking
        leaving = (2 * size + float(self.relay_axons[first + relays] - self.relay_axons[first])) * spiking
        leaving += float((input_spikes * self.reached[:, begin : begin + inputs].sum(axis=0)).sum())
        return load(
            messages_in=arriving + relay_spikes,
            dense=dense,
            sparse=sparse + relay_spikes,
            updates=size + inputs + relay_spikes,
            spikes=size * spiking + relay_spikes + float(input_spikes.sum()),
            messages_out=leaving,
        )

    def needs(self, number: int) -> Needs:
        """What a core's content takes of the limits: one profile and one threshold register for each population that is
        present, and one synapse format for each kind of rows, dense or sparse."""
        sizing, size = self.sizing, int(self.sizes[number])
        network, board = sizing.network, sizing.board
        (first, relays), (begin, inputs) = self.relays[number].tolist(), self.inputs[number].tolist()
        axons_in, words = relays, relays
        formats: set[tuple[str, bool]] = {("to relays", False)} if relays else set()
        if size:
            rows, reached = self.rows[number], self.reached[number]
            words += rows.words
            axons_in += int(reached.sum()) + sizing.relay_axons_of(size)
            formats |= {("of inputs", bool(dense)) for dense in rows.dense_inputs[reached]}
            if sizing.inhibits and size > 1:
                formats.add(("of relays", rows.dense_lateral))
            if sizing.inhibits and size < network.neurons:
                formats.add(("of relays", True))
        axons_out = 2 * size + int(self.relay_axons[first + relays] - self.relay_axons[first])
        axons_out += int(self.reached[:, begin : begin + inputs].sum())
        populations = np.count_nonzero([size, relays, inputs])

        def if_public(limit: int | None, value: int) -> int | None:
            return None if limit is None else value

        return Needs(
            compartments=size + relays + inputs,
            axons_in=if_public(board.axons_in, axons_in),
            axons_out=if_public(board.axons_out, axons_out),
            synapse_words=if_public(board.synapse_words, words),
            profiles=if_public(board.profiles, populations),
            thresholds=if_public(board.thresholds, populations),
            formats=if_public(board.formats, len(formats)),
        )

    def core_plan(self, number: int, chip: int, core: int) -> CorePlan:
        """The plan of core ``number``, which becomes ``core`` of ``chip``."""
        members: list[tuple[PopulationName, Integers]] = [
            ("exc", np.array([0, 0])),
            ("inh", self.relays[number]),
            ("inputs", self.inputs[number]),
        ]
        dense_inputs, dense_lateral = np.zeros(self.sizing.network.inputs, np.bool_), self.sizing.all_dense
        if number < len(self.rows):
            members[0] = ("exc", np.array([self.bounds[number], self.sizes[number]]))
            dense_inputs, dense_lateral = self.rows[number].dense_inputs, self.rows[number].dense_lateral
        parts, compartment = [], 0
        for population, (first, size) in members:
            if size:
                parts.append(Part(population, int(first), int(size), compartment))
                compartment += int(size)
        return CorePlan(chip, core, tuple(parts), dense_inputs, dense_lateral, self.needs(number), self.loads[number])

    def traffic(self) -> Floats:
        """Expected messages in a step from core to core, float64 (cores, cores)."""
        cores, total, spiking = len(self.rows), len(self.relays), self.sizing.spiking
        home = np.repeat(np.arange(total), self.sizes)
        relay_home = np.repeat(np.arange(total), self.relays[:, 1])
        flow = np.zeros((total, total))
        np.add.at(flow, (home, relay_home), spiking)
        if self.sizing.inhibits:
            flow[:, :cores] += (self.relays[:, 1] * spiking)[:, None]
            alone = np.flatnonzero(self.sizes[home] == 1)
            np.add.at(flow, (relay_home[alone], home[alone]), -spiking)
        sent = self.reached * self.sizing.grains
        for number, (begin, inputs) in enumerate(self.inputs):
            flow[number, :cores] += sent[:, begin : begin + inputs].sum(axis=1)
        return flow


def fill(sizing: Sizing, bounds: Integers, further: int) -> Layout | None:
    """Relays and inputs beside the neurons of ``bounds`` and on ``further`` more cores; None if they do not fit.

    As many relays as fit stand beside their neurons; the others go to the first cores with room.
    """
    cores, empty = bounds.size - 1, np.zeros(further, np.int64)
    ranges = [sizing.range_of(int(first), int(end)) for first, end in pairwise(bounds)]
    room = np.array([int(sizing.relay_room(neurons, neurons.words_least, cores)[0]) for neurons in ranges])
    if room.min() < 0:
        return None
    room = np.append(room, empty + sizing.relay_room(NO_NEURONS, NO_NEURONS.words_least, cores))
    relays = np.minimum(np.append(np.diff(bounds), empty), room)
    missing, free = sizing.network.neurons - int(relays.sum()), room - relays
    relays = relays + np.clip(missing - (np.cumsum(free) - free), 0, free)
    return with_relays(sizing, bounds, relays) if relays.sum() == sizing.network.neurons else None


def with_relays(sizing: Sizing, bounds: Integers, relays: Integers) -> Layout | None:
    """The layout with so many relays on each core, and inputs where they keep the busiest core least busy.

    Args:
        sizing: The network and its board.
        bounds: As in `Layout`.
        relays: Relays of each core, int64 (cores,), cores with neurons first.
    Returns:
        The layout, without cores that stay empty; None if it does not fit.
    """
    network, board = sizing.network, sizing.board
    words = limit_of(board.synapse_words)
    stored = [  # cores without neurons store no such rows
        choose_formats(sizing, int(first), int(end), words - int(relays_here))
        for (first, end), relays_here in zip(pairwise(bounds), relays[: bounds.size - 1], strict=True)
    ]
    rows = tuple(core_rows for core_rows in stored if core_rows is not None)
    if len(rows) < len(stored):
        return None
    reached = np.asarray(np.logical_or.reduceat(network.weights > 0, bounds[:-1], axis=1).T)
    parts = _consecutive(relays)
    layout = Layout(sizing, bounds, parts, np.zeros_like(parts), rows, reached)
    axons_left = limit_of(board.axons_out) - 2 * layout.sizes
    axons_left -= layout.relay_axons[parts.sum(axis=1)] - layout.relay_axons[parts[:, 0]]
    if axons_left.min() < 0:
        return None
    axons = reached.sum(axis=0)[: network.input_compartments]
    spiking = sizing.grains[: axons.size]
    each = neuron_nanoseconds(LOIHI_1, "nominal", 1.0, 1.0, spiking, spiking * axons)
    compartments_left = limit_of(board.compartments) - layout.sizes - relays
    inputs = spread(each, axons, compartments_left, axons_left, np.array([load.nanoseconds for load in layout.loads]))
    if inputs is None:
        return None
    used = (layout.sizes + relays + inputs) > 0
    return replace(layout, relays=parts[used], inputs=_consecutive(inputs)[used])


def _consecutive(sizes: Integers) -> Integers:
    """First and number of consecutive parts, int64 (parts, 2)."""
    return np.stack([np.cumsum(sizes) - sizes, sizes], axis=1)


def spread(each: Floats, axons: Integers, room: Integers, room_axons: Integers, busy: Floats) -> Integers | None:
    """Inputs of each core, consecutive ones in the order of the cores, so that the busiest core is least busy.

    Args:
        each: Time of each input, (inputs,).
        axons: Output axons of each input, int64 (inputs,).
        room, room_axons: Compartments and output axons that are left on each core, int64 (cores,).
        busy: Time of each core without inputs, (cores,).
    Returns:
        Numbers, int64 (cores,); None if the inputs do not fit.
    """
    axons_before, time_before = [0, *np.cumsum(axons).tolist()], [0.0, *np.cumsum(each).tolist()]
    cores = list(zip(room.tolist(), room_axons.tolist(), busy.tolist(), strict=True))

    def below(level: float) -> Integers:
        """The number of inputs on each core: as many, from the first core on, as keep it within ``level``."""
        start, sizes = 0, []
        for compartments, free_axons, taken in cores:
            end = min(start + compartments, bisect_right(axons_before, axons_before[start] + free_axons) - 1)
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
