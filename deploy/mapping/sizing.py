"""What neurons take of a core's limits, and how long a step keeps it busy.

`Sizing` answers for ranges of excitatory neurons, many at once. The counts are those of the core's content as
`deploy.registers.core_images` writes it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.boards.plan import Load
from lava_vpr.deploy.boards.step_time import arrival_nanoseconds, neuron_nanoseconds
from lava_vpr.deploy.mapping.boundaries import Integers
from lava_vpr.deploy.registers.synapses import lateral_synapse, row_words
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError

Floats = NDArray[np.float64]

EXC_SPIKES = 0.2
"""Spikes of all excitatory neurons together in one step with input, about: with the default preset 0.13 on 100 real
queries among 100 places, 0.29 among 500, and 0.2 on the references themselves."""

UNLIMITED = 1 << 40
"""A limit that nothing reaches, for what is not public or does not count."""

MIXED_FORMATS = 5
"""Inputs' rows dense and sparse, relays' rows dense and sparse, and the rows to relays. A core with fewer formats
stores all rows dense."""

GRAIN = 1 << 20
"""Expected spikes are rounded to multiples of 1 / GRAIN: their sums are exact, so equal on every machine and in any
order."""

_MANY = 512
"""Ranges that are counted at once: more would take much memory."""


def limit_of(value: int | None) -> int:
    """A limit as a number: `UNLIMITED` where it is not public."""
    return UNLIMITED if value is None else value


def nanoseconds(
    messages_in: Floats | float,
    dense: Floats | float,
    sparse: Floats | float,
    updates: Floats | float,
    spikes: Floats | float,
    messages_out: Floats | float,
) -> Floats:
    """Time on a Loihi 1 core of what `Load` counts, in ns, one after the other; for other boards it only compares
    cores."""
    arrivals = arrival_nanoseconds(LOIHI_1, "nominal", messages_in, dense, sparse)
    return np.asarray(arrivals + neuron_nanoseconds(LOIHI_1, "nominal", updates, updates, spikes, messages_out))


@dataclass(frozen=True)
class NeuronRanges:
    """Ranges of excitatory neurons, each on a core of its own; arrays (ranges,).

    Attributes:
        size: Neurons.
        active: Inputs with a weight to them.
        messages: Input spikes that arrive in a step.
        dense, sparse: Synaptic operations of the inputs in a step, by format, with every row stored sparse unless it
            has no zero (then dense costs nothing more).
        words_lateral_sparse, words_lateral_dense: Synapse memory without the rows to relays: rows of the inputs as
            above, those of the neurons' own relays sparse or dense.
        words_least: Synapse memory with each row in the format that takes least.
    """

    size: Integers
    active: Integers
    messages: Floats
    dense: Floats
    sparse: Floats
    words_lateral_sparse: Integers
    words_lateral_dense: Integers
    words_least: Integers


_NONE, _SILENT = np.zeros(1, np.int64), np.zeros(1)
NO_NEURONS = NeuronRanges(_NONE, _NONE, _SILENT, _SILENT, _SILENT, _NONE, _NONE, _NONE)
"""The range of a core without excitatory neurons."""


@dataclass(frozen=True)
class Sizing:
    """A network on a board: what ranges of its neurons take.

    Attributes:
        network: The network.
        board: The board.
        rates: Expected spikes of each input in a step, float64 (inputs,).
        exc_spikes: Expected spikes of all excitatory neurons in a step.
    """

    network: FixedNetwork = field(repr=False)
    board: Board
    rates: Floats = field(repr=False)
    exc_spikes: float = EXC_SPIKES

    @property
    def inhibits(self) -> bool:
        """Whether relays inhibit at all."""
        return self.network.inhibition > 0

    @cached_property
    def grains(self) -> Floats:
        """``rates`` as multiples of 1 / `GRAIN`."""
        return np.asarray(np.round(self.rates * GRAIN) / GRAIN)

    @cached_property
    def spiking(self) -> float:
        """Spikes of one excitatory neuron in a step, a multiple of 1 / `GRAIN`."""
        return round(self.exc_spikes / self.network.neurons * GRAIN) / GRAIN

    @cached_property
    def weight_bits(self) -> int:
        """Bits of a stored weight.

        Raises:
            NetworkLimitError: the board stores none so wide.
        """
        wide = [bits for bits in self.board.weight_bits if bits >= self.network.bits]
        if not wide:
            most = max(self.board.weight_bits)
            raise NetworkLimitError(
                f"{self.board.title} stores weights of at most {most} bits, but these need {self.network.bits}; use "
                f"--weight-bits {most}"
            )
        return min(wide)

    @cached_property
    def lateral_bits(self) -> int:
        """Fewest bits that hold a lateral weight.

        Raises:
            NetworkLimitError: the board stores none so wide.
        """
        for bits in sorted(self.board.weight_bits):
            try:
                lateral_synapse(self.network, bits)
            except NetworkLimitError:
                continue
            return bits
        raise NetworkLimitError(
            f"{self.board.title} stores weights of at most {max(self.board.weight_bits)} bits, but lateral inhibition "
            f"{self.network.lateral} needs more; change network.inhibition (or joined_inhibition)"
        )

    @cached_property
    def relay_axons(self) -> int:
        """Input axons of relays on a core with several excitatory neurons."""
        return self.network.neurons if self.inhibits else 0

    def relay_axons_of(self, neurons: int) -> int:
        """Input axons of relays on a core with ``neurons`` excitatory ones: a single one's own relay has none there."""
        return self.relay_axons - 1 if self.inhibits and neurons == 1 else self.relay_axons

    @cached_property
    def largest(self) -> int:
        """Most excitatory neurons that a core is ever asked about."""
        return min(self.network.neurons, limit_of(self.board.compartments))

    @cached_property
    def indexable(self) -> int:
        """Compartments of a core that a sparse synapse can name."""
        if self.board.synapse_words is None:
            return UNLIMITED
        return 1 << max(self.board.index_bits) if self.board.index_bits else 0

    @cached_property
    def all_dense(self) -> bool:
        """Whether no row may be sparse: formats are few, or how rows are stored is not public."""
        return self.board.synapse_words is None or limit_of(self.board.formats) < MIXED_FORMATS

    def sparse_bits(self, neurons: int) -> int | None:
        """Index bits of a sparse row over so many neurons; None: it cannot be stored."""
        need = max(0, neurons - 1).bit_length()
        wide = [] if self.all_dense else [bits for bits in self.board.index_bits if bits >= need]
        return min(wide) if wide else None

    @cached_property
    def _patterns(self) -> tuple[NDArray[np.int32], Floats, Integers]:
        """Non-zero weights of each kind of inputs to neurons 0 .. b - 1, int32 (neurons + 1, kinds); how many inputs
        are of each kind and their spikes, float64 (kinds, 2); and the kind of each input. Inputs that reach the same
        neurons are of one kind."""
        mask = self.network.weights > 0
        _, first, kind = np.unique(np.packbits(mask, axis=1), axis=0, return_index=True, return_inverse=True)
        kind = kind.reshape(-1).astype(np.int64)
        counts = np.zeros((self.network.neurons + 1, first.size), np.int32)
        np.cumsum(mask[first].T, axis=0, dtype=np.int32, out=counts[1:])
        members = np.stack([np.bincount(kind), np.bincount(kind, weights=self.grains)], axis=1)
        return counts, members.astype(np.float64), kind

    def counts(self, first: int, end: int) -> Integers:
        """Non-zero weights of each input to neurons ``first`` .. ``end - 1``, int64 (inputs,)."""
        cumulated, _, kind = self._patterns
        return np.asarray((cumulated[end] - cumulated[first])[kind].astype(np.int64))

    @cached_property
    def row_tables(self) -> tuple[Floats, Floats]:
        """Words of a row by neurons of the core and non-zero weights, float64 (largest + 1, largest + 1): in the format
        with the fewest operations, and in the one with the fewest words."""
        sizes = np.arange(self.largest + 1)
        dense = row_words(sizes, self.weight_bits)
        fewest_operations = np.repeat(dense[:, None], sizes.size, axis=1)
        for bits in self.board.index_bits:
            indexed = np.array([self.sparse_bits(int(size)) == bits for size in sizes])
            fewest_operations[indexed] = row_words(sizes, self.weight_bits + bits)[None, :]
        fewest_operations[sizes, sizes] = dense
        fewest_words = np.minimum(fewest_operations, dense[:, None])
        fewest_operations[:, 0] = fewest_words[:, 0] = 0
        return fewest_operations.astype(np.float64), fewest_words.astype(np.float64)

    @cached_property
    def lateral_words(self) -> tuple[Integers, Integers]:
        """Words of relays' rows by neurons of the core, int64 (largest + 1,): with own ones sparse, and dense."""
        sizes, bits = np.arange(self.largest + 1), self.lateral_bits
        if not self.inhibits:
            return np.zeros_like(sizes), np.zeros_like(sizes)
        several = sizes > 1
        elsewhere = np.where(sizes < self.network.neurons, row_words(sizes, bits), 0)
        dense = np.where(several, sizes * row_words(sizes, bits), 0)
        sparse = np.where(several, UNLIMITED, 0)
        for index in self.board.index_bits:
            indexed = several & np.array([self.sparse_bits(int(size)) == index for size in sizes])
            sparse = np.where(indexed, sizes * row_words(np.maximum(sizes - 1, 0), bits + index), sparse)
        return elsewhere + sparse, elsewhere + dense

    @cached_property
    def least_range(self) -> NeuronRanges:
        """A range of one neuron that takes no more of any limit than a range of the network does."""
        active = np.array([np.count_nonzero(self.network.weights, axis=0).min()])
        words = active if self.board.synapse_words is not None else np.zeros(1, np.int64)
        return NeuronRanges(np.ones(1, np.int64), active, _SILENT, _SILENT, _SILENT, words, words, words)

    def ranges(self, first: int, ends: Integers) -> NeuronRanges:
        """The ranges of neurons ``first`` .. ``end - 1`` for each of ``ends``, ascending."""
        parts = [self._ranges(first, ends[i : i + _MANY]) for i in range(0, ends.size, _MANY)]
        if len(parts) == 1:
            return parts[0]
        names = NeuronRanges.__annotations__
        return NeuronRanges(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def range_of(self, first: int, end: int) -> NeuronRanges:
        """The one range of neurons ``first`` .. ``end - 1``."""
        return self.ranges(first, np.array([end]))

    def _ranges(self, first: int, ends: Integers) -> NeuronRanges:
        """What `ranges` returns, for only so many ``ends`` as arrays of all kinds of inputs can be made for."""
        cumulated, members, _ = self._patterns
        size = ends - first
        counts = cumulated[ends] - cumulated[first]
        reached = (counts > 0).astype(np.float64)
        active, messages = (reached @ members).T
        if self.all_dense:
            dense, sparse = size * messages, np.zeros(size.size)
        else:
            dense = size * ((counts == size[:, None]).astype(np.float64) @ members[:, 1])
            sparse = counts.astype(np.float64) @ members[:, 1] - dense
        words_sparse, words_dense, words_least = np.zeros((3, size.size), np.int64)
        if self.board.synapse_words is not None:
            # What no core is ever asked about takes more words than any core has.
            asked = np.flatnonzero(size <= self.largest)
            for words in (words_sparse, words_dense, words_least):
                words[:] = UNLIMITED
            entries = counts[asked] + size[asked, None] * (self.largest + 1)
            fewest_operations, fewest_words = (table.ravel()[entries] @ members[:, 0] for table in self.row_tables)
            lateral_sparse, lateral_dense = (table[size[asked]] for table in self.lateral_words)
            words_sparse[asked] = fewest_operations + lateral_sparse
            words_dense[asked] = fewest_operations + lateral_dense
            words_least[asked] = fewest_words + np.minimum(lateral_sparse, lateral_dense)
        return NeuronRanges(
            size, active.astype(np.int64), messages, dense, sparse, words_sparse, words_dense, words_least
        )

    def relay_room(self, ranges: NeuronRanges, words: Integers, cores: int) -> Integers:
        """Relays that fit beside ``ranges`` stored in ``words`` if ``cores`` cores hold excitatory neurons, int64
        (ranges,); negative: not even the neurons fit.

        Own relays are counted first: that of a neuron alone on its core does not inhibit there, which spares an axon.
        """
        board, size = self.board, ranges.size
        spared = np.where(size == 1, 1, 0) if self.inhibits else np.zeros_like(size)
        relay_axons_in = np.where(size > 0, self.relay_axons, 0) - spared
        axons_out = limit_of(board.axons_out) - 2 * size
        relays_sending = (axons_out + spared) // cores if self.inhibits else np.full_like(size, UNLIMITED)
        room = np.minimum.reduce(
            [
                limit_of(board.compartments) - size,
                limit_of(board.axons_in) - ranges.active - relay_axons_in,
                limit_of(board.synapse_words) - words,
                np.where(axons_out >= 0, relays_sending, -1),
            ]
        )
        # An excitatory neuron needs no index if all rows are dense; a relay always does.
        return np.where(room > 0, np.clip(self.indexable - size, 0, room), room)

    def holds(self, first: int, end: int) -> bool:
        """Whether a core holds neurons ``first`` .. ``end - 1`` without any relay, however their rows are stored."""
        neurons = self.range_of(first, end)
        return bool(self.relay_room(neurons, neurons.words_least, 1)[0] >= 0)

    def time(self, ranges: NeuronRanges, cores: int, lateral_dense: NDArray[np.bool_]) -> Floats:
        """Time in ns of a step on cores that hold ``ranges`` and their relays, float64 (ranges,).

        Args:
            ranges: The ranges, with rows of the inputs stored sparse.
            cores: Cores that hold excitatory neurons.
            lateral_dense: Whether the rows of each range's own relays are dense, bool (ranges,).
        """
        more_dense, more_sparse = self.lateral_operations(ranges.size, lateral_dense)
        return self.time_of(ranges, ranges.dense + more_dense, ranges.sparse + more_sparse, cores)

    def time_of(self, ranges: NeuronRanges, dense: Floats | float, sparse: Floats | float, cores: int) -> Floats:
        """Time in ns of a step with ``dense`` and ``sparse`` synaptic operations on each core, float64 (ranges,)."""
        spikes = ranges.size * self.spiking
        messages_out = 2 * spikes + (spikes * cores if self.inhibits else 0.0)
        messages_in = ranges.messages + self.relay_axons * self.spiking + spikes
        return nanoseconds(messages_in, dense, sparse + spikes, ranges.size + spikes, 2 * spikes, messages_out)

    def lateral_operations(self, size: Integers, dense: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Operations in a step of the relays' rows on cores of ``size`` neurons, dense and sparse."""
        rate = self.spiking if self.inhibits else 0.0
        elsewhere = (self.network.neurons - size) * size * rate
        relay_spikes = np.where(size > 1, size, 0) * rate
        dense_operations = elsewhere + np.where(dense, relay_spikes * size, 0.0)
        return dense_operations, np.where(dense, 0.0, relay_spikes * (size - 1))


def load(messages_in: float, dense: float, sparse: float, updates: float, spikes: float, messages_out: float) -> Load:
    """The `Load` of a core in a step, with its time."""
    time = float(nanoseconds(messages_in, dense, sparse, updates, spikes, messages_out))
    return Load(messages_in, dense, sparse, updates, spikes, messages_out, time)
