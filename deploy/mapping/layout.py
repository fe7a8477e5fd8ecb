"""Content of each core, its needs and load, and the format of its rows of inputs: sparse, with indices, or, where
allowed, dense, without indices."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import public
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, PopulationName, PopulationPart
from lava_vpr.deploy.mapping.placing import Placed
from lava_vpr.deploy.mapping.sizing import GRAIN, Floats, Integers, Sizing
from lava_vpr.engine.inference import fixed


@dataclass(frozen=True)
class StoredRows:
    """How a core stores the rows to its excitatory neurons.

    Attributes:
        dense_inputs: Rows of the inputs that are dense, bool (inputs,).
        words: Words of these rows, of the root's and of the counters'.
        added: Additional synaptic operations in a step of dense rows, compared with sparse ones.
        dense, sparse: Synaptic operations of the inputs in a step.
    """

    dense_inputs: NDArray[np.bool_] = field(repr=False)
    words: int
    added: float
    dense: float
    sparse: float


def choose_formats(sizing: Sizing, first: int, end: int, words: int) -> StoredRows | None:
    """The formats in which a core stores the rows to neurons ``first`` .. ``end - 1`` in at most ``words``; None if it
    cannot.

    All rows are sparse, unless `Sizing.may_be_dense`: then those without a zero are dense, and where memory demands
    more, rows turn dense in the order of words saved per operation added; if that saves more than needed, rows turn
    back, the last one first. Where no index is wide enough for so many neurons, all rows count as dense.
    """
    size, counts = end - first, sizing.counts(first, end)
    all_dense = sizing.board.memory.sparse_bits(size) is None
    dense = (counts > 0) & ((counts == size) & sizing.may_be_dense | all_dense)
    operations, least = (table[size, counts] for table in sizing.row_tables)
    used = int(operations.sum() + sizing.root_row[size]) + sizing.counters * size
    if used > words:
        added = np.maximum(sizing.grains * (size - counts), 0.5 / GRAIN)
        saved = operations - least
        turned = _cheapest_choice(saved, added, used - words)
        if turned is None:
            return None
        used -= int(saved[turned].sum())
        dense[turned] = True
    dense_spikes = sizing.grains * dense
    return StoredRows(
        dense,
        used,
        0.0 if all_dense else float(dense_spikes @ (size - counts)),
        float(dense_spikes.sum()) * size,
        float((sizing.grains - dense_spikes) @ counts),
    )


def _cheapest_choice(saved: NDArray[np.int64], added: Floats, need: int) -> list[int] | None:
    """The choice whose ``saved`` sums to at least ``need``, by most saved per ``added``; None if all together save
    less."""
    candidates = np.flatnonzero(saved > 0)
    order = candidates[np.argsort(-saved[candidates] / added[candidates], kind="stable")]
    sums = np.cumsum(saved[order])
    last = int(np.searchsorted(sums, need))
    if last == order.size:
        return None
    chosen, spare = order[: last + 1].tolist(), int(sums[last]) - need
    for number in range(last, -1, -1):
        if spare <= 0:
            break
        if saved[chosen[number]] <= spare:
            spare -= int(saved[chosen[number]])
            del chosen[number]
    return chosen


@dataclass(frozen=True)
class CoreLayout:
    """Content of each core, and the formats of the rows on the first k cores, which have excitatory neurons.

    Attributes:
        sizing: The network and its board.
        placed: The neurons and inputs of each core.
        rows: How each of the k cores stores its rows.
    """

    sizing: Sizing = field(repr=False)
    placed: Placed = field(repr=False)
    rows: tuple[StoredRows, ...] = field(repr=False)

    @cached_property
    def sizes(self) -> Integers:
        """Excitatory neurons of each core, int64 (cores,)."""
        bounds = self.placed.bounds
        return np.append(np.diff(bounds), np.zeros(self.placed.cores - bounds.size + 1, np.int64))

    @cached_property
    def reached(self) -> NDArray[np.bool_]:
        """Inputs with a weight to each of the k cores, bool (k, inputs)."""
        pattern = self.sizing.pattern
        found = np.logical_or.reduceat(pattern.mask, self.placed.bounds[:-1], axis=1)
        return np.asarray(found[pattern.kind].T)

    @cached_property
    def input_axons(self) -> Integers:
        """Output axons of each input, int64 (inputs,): one for each core that it reaches."""
        return np.count_nonzero(self.reached, axis=0)

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """The expected load of each core in a step."""
        return tuple(self._load(number) for number in range(self.placed.cores))

    @property
    def costs(self) -> tuple[float, float]:
        """Operations that dense rows add in a step on all cores, and the time for which a step keeps the busiest core
        busy."""
        return sum(rows.added for rows in self.rows), max(load.busy for load in self.loads)

    def _own(self, number: int) -> tuple[int, slice, slice]:
        """Excitatory neurons, inhibitory ones and inputs of a core."""
        (first, inh), (begin, inputs) = self.placed.inh[number].tolist(), self.placed.inputs[number].tolist()
        return int(self.sizes[number]), slice(first, first + inh), slice(begin, begin + inputs)

    def _inh_axons(self, inh: slice) -> Integers:
        """Output axons of some inhibitory neurons, int64: one of a leaf, and one of the root to each of the k cores."""
        axons = np.ones(self.sizing.network.inhibitory, np.int64)
        axons[-1] = len(self.rows) if self.sizing.inhibits else 0
        return axons[inh]

    def _heard(self, inh: slice) -> float:
        """Expected spikes that arrive at some inhibitory neurons in a step: from excitatory ones, and at the root from
        leaves."""
        sizing, network = self.sizing, self.sizing.network
        heard = sizing.listened * sizing.spiking
        if network.leaves:
            heard[-1] = sizing.inh_spikes[:-1].sum()
        return float(heard[inh].sum())

    def _load(self, number: int) -> Load:
        """The expected load of a core in a step."""
        sizing = self.sizing
        size, inh, inputs = self._own(number)
        spikes, inh_spikes, input_spikes = size * sizing.spiking, sizing.inh_spikes[inh], sizing.grains[inputs]
        heard = self._heard(inh)
        relayed = float(input_spikes.sum()) if sizing.network.relayed else 0.0
        arriving, dense, sparse = heard + relayed, 0.0, heard + relayed
        if size:
            root = float(sizing.inh_spikes[-1]) if sizing.inhibits else 0.0
            arriving += float(sizing.grains[self.reached[number]].sum()) + root
            dense, sparse = self.rows[number].dense, sparse + self.rows[number].sparse + root * size
        counted = sizing.counters * spikes
        arriving, sparse = arriving + counted, sparse + counted
        updates = (1 + sizing.counters) * size + heard + (relayed if sizing.network.relayed else input_spikes.size)
        fired = spikes + float(inh_spikes.sum() + input_spikes.sum())
        leaving = 2 * spikes + float(inh_spikes @ self._inh_axons(inh) + input_spikes @ self.input_axons[inputs])
        busy = sizing.board.busy(
            messages_in=arriving,
            operations_dense=dense,
            operations_sparse=sparse,
            accesses=updates,
            updates=updates,
            spikes=fired,
            messages_out=leaving,
        )
        return Load(arriving, dense, sparse, updates, fired, leaving, float(busy))

    def needs(self, number: int) -> Needs:
        """The resources that a core's content needs: one profile and one threshold register for each population that is
        present, and one synapse format for each kind of rows."""
        sizing, board = self.sizing, self.sizing.board
        size, inh, inputs = self._own(number)
        listened = int(sizing.listened[inh].sum())
        count = inputs.stop - inputs.start
        relays = count if sizing.network.relayed else 0
        counters = sizing.counters * size
        axons_in = listened + relays + counters
        words, formats = listened + relays, int(listened > 0) + int(relays > 0) + int(counters > 0)
        if size:
            rows, reached = self.rows[number], self.reached[number]
            words += rows.words  # with those of the counters
            axons_in += int(reached.sum()) + sizing.inhibits
            formats += np.unique(rows.dense_inputs[reached]).size + sizing.inhibits
        axons_out = 2 * size + int(self._inh_axons(inh).sum() + self.input_axons[inputs].sum())
        populations = sum(present > 0 for present in (size, counters, inh.stop - inh.start, count))

        def if_public(limit: int | None, value: int) -> int | None:
            return value if limit is not None and public(limit) else None

        return Needs(
            compartments=size + counters + inh.stop - inh.start + count,
            axons_in=if_public(board.axons_in, axons_in),
            axons_out=if_public(board.axons_out, axons_out),
            synapse_words=if_public(board.memory.words, words),
            profiles=if_public(board.profiles, populations),
            thresholds=if_public(board.thresholds, populations),
            formats=if_public(board.formats, formats),
        )

    def core_plan(self, number: int, chip: int, core: int) -> CorePlan:
        """The plan of core ``number``, which becomes ``core`` of ``chip``."""
        placed, exc = self.placed, [0, 0]
        dense_inputs = np.zeros(self.sizing.network.inputs, np.bool_)
        if number < len(self.rows):
            exc = [int(placed.bounds[number]), int(self.sizes[number])]
            dense_inputs = self.rows[number].dense_inputs
        members: list[tuple[PopulationName, list[int]]] = [
            ("exc", exc),
            ("counters", exc if self.sizing.counters else [0, 0]),
            ("inh", placed.inh[number].tolist()),
            ("inputs", placed.inputs[number].tolist()),
        ]
        parts, compartment = [], 0
        for population, (first, size) in members:
            if size:
                parts.append(PopulationPart(population, first, size, compartment))
                compartment += size
        return CorePlan(chip, core, tuple(parts), dense_inputs, self.needs(number), self.loads[number])

    def traffic(self) -> Floats:
        """Expected messages in a step from core to core, float64 (cores, cores)."""
        sizing, network, total = self.sizing, self.sizing.network, self.placed.cores
        flow = np.zeros((total, total))
        inh_home = np.repeat(np.arange(total), self.placed.inh[:, 1])
        home = np.repeat(np.arange(total), self.sizes)
        partner = np.arange(network.neurons) // fixed.FAN_IN if network.leaves else np.zeros(network.neurons, np.int64)
        np.add.at(flow, (home, inh_home[partner]), sizing.spiking)
        np.add.at(flow, (inh_home[:-1], inh_home[-1]), sizing.inh_spikes[:-1])
        cores = len(self.rows)
        if sizing.inhibits:
            flow[inh_home[-1], :cores] += sizing.inh_spikes[-1]
        sent = self.reached * sizing.grains
        for number, (begin, inputs) in enumerate(self.placed.inputs):
            flow[number, :cores] += sent[:, begin : begin + inputs].sum(axis=1)
        return flow


def layout_of(sizing: Sizing, placed: Placed) -> CoreLayout | None:
    """The layout of ``placed``; None if a core cannot store its rows."""
    words = np.full(placed.cores, sizing.board.memory.capacity)
    for number, (first, inh) in enumerate(placed.inh):
        words[number] -= sizing.listened[first : first + inh].sum()
    if sizing.network.relayed:
        words -= placed.inputs[:, 1]
    stored = [
        choose_formats(sizing, first, end, int(free))
        for (first, end), free in zip(pairwise(placed.bounds.tolist()), words, strict=False)
    ]
    rows = tuple(core_rows for core_rows in stored if core_rows is not None)
    return CoreLayout(sizing, placed, rows) if len(rows) == len(stored) else None
