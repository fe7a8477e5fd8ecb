"""What neurons take of a core's limits, and how long a step keeps it busy.

`Sizing` answers for ranges of excitatory neurons, many at once; `formats` chooses how one core stores its rows. The
counts are those of the core's content as `deploy.registers.core_images` writes it: one profile and one threshold
register for each population that is present, and one synapse format for each kind of rows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import Load
from lava_vpr.deploy.mapping.placement import cheapest_choice
from lava_vpr.deploy.registers.synapses import lateral_synapse, row_words
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import (
    ACCESS_NS,
    AXON_IN_NS,
    MESSAGE_NS,
    SPIKE_NS,
    SYNAPSE_DENSE_NS,
    SYNAPSE_SPARSE_NS,
    UPDATE_NS,
)

EXC_SPIKES = 0.2
"""Spikes of all excitatory neurons together in one step with input, about: with the default preset 0.13 on 100 real
queries among 100 places, 0.29 among 500, and 0.2 on the references themselves."""

UNLIMITED = 1 << 40
MIXED_FORMATS = 5
"""Inputs' rows dense and sparse, relays' rows dense and sparse, and the rows to relays. A core with fewer formats
stores all rows dense."""

_GRAIN = 1 << 20
_MANY = 512


def limit_of(value: int | None) -> int:
    """A limit as a number."""
    return UNLIMITED if value is None else value


def nanoseconds(
    messages_in: NDArray[np.float64] | float,
    dense: NDArray[np.float64] | float,
    sparse: NDArray[np.float64] | float,
    updates: NDArray[np.float64] | float,
    spikes: NDArray[np.float64] | float,
    messages_out: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """Time on a Loihi 1 core of what `Load` counts, in ns; for other boards it only compares cores."""
    return np.asarray(
        AXON_IN_NS * messages_in
        + SYNAPSE_DENSE_NS * dense
        + SYNAPSE_SPARSE_NS * sparse
        + (ACCESS_NS + UPDATE_NS) * updates
        + SPIKE_NS * spikes
        + MESSAGE_NS * messages_out
    )


@dataclass(frozen=True)
class Ranges:
    """Ranges of excitatory neurons, each on a core of its own; arrays (ranges,).

    Attributes:
        size: Neurons.
        active: Inputs with a weight to them.
        messages: Input spikes that arrive in a step.
        dense, sparse: Synaptic operations of the inputs in a step, by format, with every row stored sparse unless it
            has no zero (then dense costs nothing more).
        sparse_words, mixed_words, least_words: Synapse memory without relays' own input: rows as above with the own
            relays' rows sparse; the same with those dense; the least of all ways to store each row.
    """

    size: NDArray[np.int64]
    active: NDArray[np.int64]
    messages: NDArray[np.float64]
    dense: NDArray[np.float64]
    sparse: NDArray[np.float64]
    sparse_words: NDArray[np.int64]
    mixed_words: NDArray[np.int64]
    least_words: NDArray[np.int64]

    @property
    def easy_words(self) -> NDArray[np.int64]:
        """The lesser of ``sparse_words`` and ``mixed_words``."""
        return np.minimum(self.sparse_words, self.mixed_words)


@dataclass(frozen=True)
class Stored:
    """How a core stores its rows.

    Attributes:
        inputs: Rows of the inputs that are dense, bool (inputs,).
        lateral: Own relays' rows are dense.
        words: Of all rows but those to relays.
        added: Synaptic operations in a step that a dense row costs more than a sparse one, summed.
        dense, sparse: Synaptic operations in a step of all rows but those to relays.
    """

    inputs: NDArray[np.bool_] = field(repr=False)
    lateral: bool
    words: int
    added: float
    dense: float
    sparse: float


@dataclass(frozen=True)
class Sizing:
    """A network on a board: what ranges of its neurons take.

    Attributes:
        network: The network.
        board: Where.
        rates: Expected spikes of each input in a step, float64 (inputs,).
        exc_spikes: Expected spikes of all excitatory neurons in a step.
    """

    network: FixedNetwork = field(repr=False)
    board: Board
    rates: NDArray[np.float64] = field(repr=False)
    exc_spikes: float = EXC_SPIKES

    @cached_property
    def grains(self) -> NDArray[np.float64]:
        """``rates`` as multiples of 2^-20: their sums are exact, so equal on every machine and in any order."""
        return np.asarray(np.round(self.rates * _GRAIN) / _GRAIN)

    @cached_property
    def spiking(self) -> float:
        """Spikes of one excitatory neuron in a step."""
        return round(self.exc_spikes / self.network.neurons * _GRAIN) / _GRAIN

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
        return self.network.neurons if self.network.inhibition else 0

    def relay_axons_of(self, neurons: int) -> int:
        """Input axons of relays on a core with ``neurons`` excitatory ones: a single one's own relay has none there."""
        return self.relay_axons - (neurons == 1) * (self.relay_axons > 0)

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
    def _patterns(self) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.int64]]:
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

    def counts(self, first: int, end: int) -> NDArray[np.int64]:
        """Non-zero weights of each input to neurons ``first`` .. ``end - 1``, int64 (inputs,)."""
        cumulated, _, kind = self._patterns
        return np.asarray((cumulated[end] - cumulated[first])[kind].astype(np.int64))

    @cached_property
    def _row_tables(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Words of a row by neurons of the core and non-zero weights, float64 (largest + 1, largest + 1): with the
        fewest operations, and the least."""
        sizes = np.arange(self.largest + 1)
        dense = row_words(sizes, self.weight_bits)
        fewest = np.repeat(dense[:, None], sizes.size, axis=1)
        for bits in self.board.index_bits:
            own = np.array([self.sparse_bits(int(n)) == bits for n in sizes])
            fewest[own] = row_words(sizes, self.weight_bits + bits)[None, :]
        fewest[sizes, sizes] = dense
        least = np.minimum(fewest, dense[:, None])
        fewest[:, 0] = least[:, 0] = 0
        return fewest.astype(np.float64), least.astype(np.float64)

    @cached_property
    def lateral_words(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Words of relays' rows by neurons of the core, int64 (largest + 1,): with own ones sparse, and dense."""
        sizes, bits = np.arange(self.largest + 1), self.lateral_bits
        if not self.network.inhibition:
            return np.zeros_like(sizes), np.zeros_like(sizes)
        several = sizes > 1
        elsewhere = np.where(sizes < self.network.neurons, row_words(sizes, bits), 0)
        dense = np.where(several, sizes * row_words(sizes, bits), 0)
        sparse = np.where(several, UNLIMITED, 0)
        for index in self.board.index_bits:
            own = several & np.array([self.sparse_bits(int(n)) == index for n in sizes])
            sparse = np.where(own, sizes * row_words(np.maximum(sizes - 1, 0), bits + index), sparse)
        return elsewhere + sparse, elsewhere + dense

    @cached_property
    def least_range(self) -> tuple[Ranges, NDArray[np.int64]]:
        """A range of one neuron that takes no more than any, and words that it takes at least."""
        active = np.array([np.count_nonzero(self.network.weights, axis=0).min()])
        one, silent = np.ones(1, np.int64), np.zeros(1)
        words = active if self.board.synapse_words is not None else 0 * active
        return Ranges(one, active, silent, silent, silent, words, words, words), words

    def ranges(self, first: int, ends: NDArray[np.int64]) -> Ranges:
        """Neurons ``first`` .. ``end - 1`` for each of ``ends``, ascending."""
        parts = [self._ranges(first, ends[i : i + _MANY]) for i in range(0, ends.size, _MANY)]
        if len(parts) == 1:
            return parts[0]
        return Ranges(*(np.concatenate([getattr(part, name) for part in parts]) for name in Ranges.__annotations__))

    def _ranges(self, first: int, ends: NDArray[np.int64]) -> Ranges:
        cumulated, members, _ = self._patterns
        size = ends - first
        counts = cumulated[ends] - cumulated[first]
        hit = (counts > 0).astype(np.float64)
        active, messages = (hit @ members).T
        if self.all_dense:
            dense, sparse = size * messages, np.zeros(size.size)
        else:
            dense = size * ((counts == size[:, None]).astype(np.float64) @ members[:, 1])
            sparse = counts.astype(np.float64) @ members[:, 1] - dense
        words, least = (np.full(size.size, UNLIMITED * (self.board.synapse_words is not None)) for _ in range(2))
        lateral = np.zeros((2, size.size), np.int64)
        if self.board.synapse_words is not None:
            fits = np.flatnonzero(size <= self.largest)
            places = counts[fits] + size[fits, None] * (self.largest + 1)
            words[fits], least[fits] = (table.ravel()[places] @ members[:, 0] for table in self._row_tables)
            lateral[:, fits] = [table[size[fits]] for table in self.lateral_words]
        return Ranges(
            size,
            active.astype(np.int64),
            messages,
            dense,
            sparse,
            words + lateral[0],
            words + lateral[1],
            least + lateral.min(axis=0),
        )

    def relay_room(self, ranges: Ranges, words: NDArray[np.int64], cores: int) -> NDArray[np.int64]:
        """Relays that fit beside ``ranges`` stored in ``words`` if ``cores`` cores hold excitatory neurons, int64
        (ranges,); negative: not even the neurons fit.

        Own relays are counted first: that of a neuron alone on its core does not inhibit there, which spares an axon.
        """
        board, size = self.board, ranges.size
        alone = (size == 1) & (self.network.inhibition > 0)
        room = limit_of(board.compartments) - size
        room = np.minimum(
            room, limit_of(board.axons_in) - ranges.active - np.where(size > 0, self.relay_axons, 0) + alone
        )
        room = np.minimum(room, limit_of(board.synapse_words) - words)
        out = limit_of(board.axons_out) - 2 * size
        relays = (out + alone) // cores if self.network.inhibition else UNLIMITED
        room = np.minimum(room, np.where(out >= 0, relays, -1))
        # An excitatory neuron needs no index if all rows are dense; a relay always does.
        return np.where(room > 0, np.clip(self.indexable - size, 0, room), room)

    def time(self, ranges: Ranges, cores: int, lateral_dense: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Time in ns of a step on cores that hold ``ranges`` and their relays, float64 (ranges,)."""
        more_dense, more_sparse = self.lateral_operations(ranges.size, lateral_dense)
        return self._time(ranges, ranges.dense + more_dense, ranges.sparse + more_sparse, cores)

    def time_of(self, ranges: Ranges, number: int, stored: Stored, cores: int) -> float:
        """The same of one of ``ranges``, stored as said."""
        return float(self._time(ranges, stored.dense, stored.sparse, cores)[number])

    def _time(
        self, ranges: Ranges, dense: NDArray[np.float64] | float, sparse: NDArray[np.float64] | float, cores: int
    ) -> NDArray[np.float64]:
        own = ranges.size * self.spiking
        out = 2 * own + own * cores * (self.network.inhibition > 0)
        arriving = ranges.messages + self.relay_axons * self.spiking + own
        return nanoseconds(arriving, dense, sparse + own, ranges.size + own, 2 * own, out)

    def lateral_operations(
        self, size: NDArray[np.int64], dense: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Operations in a step of the relays' rows on cores of ``size`` neurons, dense and sparse."""
        rate = self.spiking * (self.network.inhibition > 0)
        elsewhere = (self.network.neurons - size) * size * rate
        several = size * (size > 1) * rate
        return elsewhere + np.where(dense, several * size, 0.0), np.where(dense, 0.0, several * (size - 1))

    def formats(self, first: int, end: int, words: int) -> Stored | None:
        """How a core stores the rows of neurons ``first`` .. ``end - 1`` in at most ``words``; None: it cannot.

        All rows are sparse but those without a zero. Where that is too much, rows turn dense in the order of words
        saved per operation added; what that saves beyond need is given back, the last to turn first.
        """
        size, counts = end - first, self.counts(first, end)
        lateral = self.sparse_bits(size) is None
        dense = (counts > 0) & ((counts == size) | lateral)
        used = 0
        if self.board.synapse_words is not None:
            fewest, _ = self._row_tables
            own, one = fewest[size, counts], fewest[size, size]
            used = int(own.sum()) + int(self.lateral_words[int(lateral)][size])
        if used > words:
            saved = np.append(np.where(dense | (counts == 0), 0.0, own - one), 0.0)
            saved[-1] = 0 if lateral else self.lateral_words[0][size] - self.lateral_words[1][size]
            added = np.append(self.grains * (size - counts), size * self.spiking)
            turned = cheapest_choice(saved, np.maximum(added, 0.5 / _GRAIN), used - words)
            if turned is None:
                return None
            used -= int(saved[turned].sum())
            chosen = np.append(dense, lateral)
            chosen[turned] = True
            dense, lateral = chosen[:-1], bool(chosen[-1])
        more_dense, more_sparse = self.lateral_operations(np.array(size), np.array(lateral))
        rows = self.grains * dense
        extra = 0.0
        if not self.all_dense:
            several = size * (size > 1) * (self.network.inhibition > 0)
            extra = float(rows @ (size - counts)) + lateral * several * self.spiking
        return Stored(
            dense,
            lateral,
            used,
            extra,
            float(rows.sum()) * size + float(more_dense),
            float((self.grains - rows) @ counts) + float(more_sparse),
        )


def load(messages_in: float, dense: float, sparse: float, updates: float, spikes: float, messages_out: float) -> Load:
    """A `Load` with its time."""
    time = float(nanoseconds(messages_in, dense, sparse, updates, spikes, messages_out))
    return Load(messages_in, dense, sparse, updates, spikes, messages_out, time)
