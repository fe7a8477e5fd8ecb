"""Layout of synapses in a Loihi 1 core's memory, in words of 64 bits.

A row, the synapses of one input axon, is a sequence of blocks of at most 64 synapses, each block rounded up to whole
words. Fields are stored from the least significant bit on:

- 4 bits for the synapse format, 6 bits for the number of synapses in this block minus 1; then for each synapse
- as many bits as the format has for indices: compartment; a dense format has none, and goes 0, 1, 2 .. through the row
- as many bits as the format has for weights: weight and sign, in two's complement.

Every weight has its own sign (fanoutType 1), as in everything that nengo-loihi writes. Formats with one sign for all
weights exist, but no public source shows them.

docs/hardware.md gives the sources of sizes, limits and registers' names. The order of the fields within a block is not
public; this one is ours, and programs that write a board set synapse by synapse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.hardware.nxsdk_registers import UNUSED_FIELDS
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ModelFileError, NetworkLimitError
from lava_vpr.loihi import (
    BLOCK_HEADER_BITS,
    BLOCK_SYNAPSES,
    COMPRESSION_DENSE,
    COMPRESSION_SPARSE,
    FANOUT_MIXED,
    INPUT_SHIFT,
    LOIHI_1_INDEX_BITS,
    LOIHI_1_WEIGHT_BITS,
    WEIGHT_BITS,
    WEIGHT_EXPONENT_LIMIT,
)

REGISTER_BITS = WEIGHT_BITS + 1
"""Bits of a weight's register: 8 and a sign."""

COUNT_BITS = (BLOCK_SYNAPSES - 1).bit_length()
ID_BITS = BLOCK_HEADER_BITS - COUNT_BITS
WEIGHT_CODES, INDEX_CODES = (0, *LOIHI_1_WEIGHT_BITS), (0, *LOIHI_1_INDEX_BITS)
"""Widths by the value of registers wgtBits and idxBits; 0: none."""


@dataclass(frozen=True)
class SynapseFormat:
    """A synapse format: widths of weight and index, and the scale of a weight.

    Attributes:
        weight_bits: Bits of a stored weight, one of which is its sign. They are the upper ones of the register's 9.
        index_bits: Bits of a compartment's number; 0: dense.
        exponent: A register weight, 8 bits and a sign, adds itself times 2^(6 + exponent) in units of u.
    """

    weight_bits: int
    index_bits: int
    exponent: int

    @staticmethod
    def of_whole_numbers(weight_bits: int, index_bits: int) -> SynapseFormat:
        """The format whose ``weight_bits`` bits store whole numbers as they are."""
        return SynapseFormat(weight_bits, index_bits, weight_bits - REGISTER_BITS)

    @property
    def bits(self) -> int:
        """The bits that one synapse of this format takes."""
        return self.weight_bits + self.index_bits

    @property
    def registers(self) -> dict[str, int]:
        """The registers of the format, as NxSDK's ``synapseFmt`` takes them."""
        return dict.fromkeys(UNUSED_FIELDS, 0) | {
            "wgtExp": self.exponent,
            "wgtBits": WEIGHT_CODES.index(self.weight_bits),
            "idxBits": INDEX_CODES.index(self.index_bits),
            "numSynapses": BLOCK_SYNAPSES - 1,
            "fanoutType": FANOUT_MIXED,
            "compression": COMPRESSION_SPARSE if self.index_bits else COMPRESSION_DENSE,
        }

    @staticmethod
    def of(registers: Mapping[str, Any], where: str) -> SynapseFormat:
        """The format that ``registers`` describe.

        Raises:
            ModelFileError: they are not those of a format that this project writes.
        """
        try:
            form = SynapseFormat(
                WEIGHT_CODES[registers["wgtBits"]],
                INDEX_CODES[registers["idxBits"]],
                int(registers["wgtExp"]),
            )
            sound = form.registers == dict(registers) and form.weight_bits > 0
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            sound = False
        if not sound or abs(form.exponent) > WEIGHT_EXPONENT_LIMIT:
            raise ModelFileError(f"{where}: its registers describe no synapse format of ours; deploy the model again")
        return form

    def currents(self, weights: NDArray[np.int32]) -> NDArray[np.int32]:
        """What stored ``weights`` add to their compartments, in units of u."""
        shift = REGISTER_BITS - self.weight_bits + INPUT_SHIFT + self.exponent
        return weights << shift if shift >= 0 else weights >> -shift


@dataclass(frozen=True)
class SynapseRows:
    """Synapses as they are stored, row after row.

    Attributes:
        starts: Row r holds synapses ``starts[r]`` to ``starts[r + 1] - 1``, int64 (rows + 1,).
        compartments: The compartment that each synapse reaches, int32 (synapses,).
        weights: Stored weights with their sign, int32 (synapses,).
        formats: Format of each row, uint8 (rows,).
    """

    starts: NDArray[np.int64]
    compartments: NDArray[np.int32]
    weights: NDArray[np.int32]
    formats: NDArray[np.uint8]

    def currents(self, formats: Sequence[SynapseFormat | None]) -> NDArray[np.int32]:
        """What each synapse adds to its compartment, in units of u, int32 (synapses,)."""
        values = np.zeros(len(self.weights), np.int32)
        of_synapse = np.repeat(self.formats, np.diff(self.starts))
        for number in np.unique(self.formats):
            form, synapses = formats[number], of_synapse == number
            if form is not None:
                values[synapses] = form.currents(self.weights[synapses])
        return values


def joined(parts: Sequence[SynapseRows]) -> SynapseRows:
    """The rows of ``parts``, one after another."""
    sizes = np.concatenate([np.zeros(1, np.int64), *(np.diff(part.starts) for part in parts)])
    empty = np.zeros(0, np.int32)
    return SynapseRows(
        np.cumsum(sizes),
        np.concatenate([empty, *(part.compartments for part in parts)]),
        np.concatenate([empty, *(part.weights for part in parts)]),
        np.concatenate([np.zeros(0, np.uint8), *(part.formats for part in parts)]),
    )


def index_bits(compartments: NDArray[np.int64]) -> int:
    """Fewest index bits that can name each of ``compartments``."""
    need = int(compartments.max(initial=0)).bit_length()
    return next(bits for bits in LOIHI_1_INDEX_BITS if bits >= need)


def lateral_synapse(network: FixedNetwork, bits: int) -> tuple[int, int]:
    """Stored weight, at most 0, in ``bits`` bits with its sign, and exponent of a synapse that subtracts
    ``network.lateral``.

    Raises:
        NetworkLimitError: no weight and exponent give it.
    """
    magnitude, exponent = network.inhibition, network.inhibition_exponent
    while magnitude >> bits - 1 and magnitude % 2 == 0:
        magnitude, exponent = magnitude >> 1, exponent + 1
    exponent -= REGISTER_BITS - bits
    if magnitude >> bits - 1 or abs(exponent) > WEIGHT_EXPONENT_LIMIT:
        raise NetworkLimitError(
            f"inhibition {network.lateral} does not fit a synapse of {bits} bits, sign included, with an exponent of "
            f"at most {WEIGHT_EXPONENT_LIMIT}; choose another network.inhibition"
        )
    return -magnitude, exponent


class Formats(list[SynapseFormat | None]):
    """The formats of a core in the order of their first use; number 0 stays unused, as in nengo-loihi."""

    def __init__(self) -> None:
        super().__init__([None])

    def number(self, form: SynapseFormat) -> int:
        """The number of ``form``, assigned at its first use."""
        if form not in self:
            self.append(form)
        return self.index(form)

    def rows(
        self, weights: NDArray[Any], compartments: NDArray[np.int64], dense: NDArray[np.bool_], form: SynapseFormat
    ) -> SynapseRows:
        """The rows of ``weights`` (rows, compartments): of dense rows all weights, of others those that are not 0.

        Args:
            weights: Stored weights.
            compartments: The compartment of each column.
            dense: Which rows are stored dense.
            form: Format of the sparse rows; without its index, that of the dense ones.
        """
        numbers = np.zeros(len(dense), np.uint8)
        for is_dense, own_form in ((True, replace(form, index_bits=0)), (False, form)):
            if (dense == is_dense).any():
                numbers[dense == is_dense] = len(self)
                self.append(own_form)
        mask = dense[:, None] | (weights != 0)
        starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(mask.sum(axis=1))])
        reached = np.broadcast_to(compartments, mask.shape)[mask]
        return SynapseRows(starts, reached.astype(np.int32), weights[mask].astype(np.int32), numbers)
