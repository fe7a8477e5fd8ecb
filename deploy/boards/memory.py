"""Storage of synapses on the cores of a board: the memory that rows need, and which parts of that are public."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr import loihi

Integers = NDArray[np.int64]

UNLIMITED = 1 << 40
"""A limit that is never reached, for resources whose limit is not public or does not matter."""


def row_words(synapses: Integers, bits: int | Integers) -> Integers:
    """Words of synapse memory that rows need; a row holds the synapses of one input axon.

    Args:
        synapses: Number of synapses of each row, int64, any shape.
        bits: Bits of one synapse: weight, and index if the row is sparse.
    """
    whole, rest = np.divmod(np.asarray(synapses, np.int64), loihi.BLOCK_SYNAPSES)
    full = -(-(loihi.BLOCK_SYNAPSES * bits + loihi.BLOCK_HEADER_BITS) // loihi.WORD_BITS)
    last = -(-(rest * bits + loihi.BLOCK_HEADER_BITS) // loihi.WORD_BITS)
    return whole * full + np.where(rest > 0, last, 0)


@dataclass(frozen=True)
class PackedRows:
    """Rows packed into 64-bit words, each weight with its sign, as public sources show for Loihi 1.

    A sparse row has an index beside each weight; a dense one, which no public source shows on a board, has none and
    stores a weight for every neuron of the core.

    Attributes:
        words: Words of a core.
        index_bits: Widths of index that a stored synapse can have.
    """

    words: int
    index_bits: tuple[int, ...] = loihi.LOIHI_1_INDEX_BITS

    public = True
    """Whether the storage of rows is public: then the needs of a plan are exact, else lower bounds."""
    one_sign = False
    """Whether weights that all have the same sign are stored without a bit for it."""

    @property
    def capacity(self) -> int:
        """Words of a core that a plan may fill (`loihi.SYNAPSE_SLACK`)."""
        return int(self.words * (1 - loihi.SYNAPSE_SLACK))

    @property
    def indexable(self) -> int:
        """Compartments of a core that a sparse synapse can name."""
        return 1 << max(self.index_bits) if self.index_bits else 0

    def sparse_bits(self, neurons: int) -> int | None:
        """Index bits of a sparse row over so many neurons; None: it cannot be stored sparse."""
        need = max(0, neurons - 1).bit_length()
        return min((bits for bits in self.index_bits if bits >= need), default=None)

    def sparse_rows(self, largest: int, bits: int) -> Integers:
        """Words of sparse rows of weights of so many ``bits``, int64 (neurons of the core + 1, synapses + 1)."""
        sizes = np.arange(largest + 1)
        words = np.full((sizes.size, sizes.size), UNLIMITED)
        own = np.array([self.sparse_bits(size) or 0 for size in sizes.tolist()])
        for index in self.index_bits:
            words[own == index] = row_words(sizes, bits + index)
        words[:, 0] = 0
        return words

    def described(self, cores: int, compartments: int) -> str:
        """Empty: everything needed is public."""
        return ""


@dataclass(frozen=True)
class ByteBudget:
    """The bytes of a core for all its content, where the storage of synapses is not public: only weights are counted.

    Axons, indices and states are left out, so that a plan is a lower bound of a network's needs.

    Attributes:
        core_bytes: Bytes of a core.
        chip_synapses: Synapses of a chip.
    """

    core_bytes: int
    chip_synapses: int

    words = None
    index_bits = ()
    public = False
    one_sign = True
    indexable = UNLIMITED

    @property
    def capacity(self) -> int:
        """Bits of a core."""
        return 8 * self.core_bytes

    def sparse_bits(self, neurons: int) -> None:
        """None: no index is counted, so that all rows count as dense."""

    def sparse_rows(self, largest: int, bits: int) -> Integers:
        """Bits of the weights of rows, int64 (neurons of the core + 1, synapses + 1)."""
        return np.broadcast_to(bits * np.arange(largest + 1), (largest + 1, largest + 1))

    def described(self, cores: int, compartments: int) -> str:
        """Public and non-public facts of a board with so many cores."""
        return (
            f"Public: {cores} cores, {compartments:,} neurons and {self.core_bytes:,} bytes a core, "
            f"{self.chip_synapses:,} synapses a chip. Unknown: what axons, indices and states take of these bytes."
        )


Memory = PackedRows | ByteBudget
