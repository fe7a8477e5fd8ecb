"""The resources that ranges of neurons need of a core, and the limits of a board that no placement can change.

`Sizing` answers for ranges of excitatory neurons. The counts are those of the core's content as
`deploy.registers.core_images` writes it.

Networks are refused that exceed limits of weights, sums, host traffic or registers. Where little of a board is public,
synapses of a chip and bytes and neurons of a core bound a network. A network beyond these bounds cannot fit; one within
them may not fit, either, since the needs of axons, states and indices are not public and not counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.memory import UNLIMITED, ByteBudget, PackedRows, row_words
from lava_vpr.deploy.registers.synapses import lateral_synapse
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import WEIGHT_BITS
from lava_vpr.neurons.models import NEURONS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

EXC_SPIKES = 0.2
"""Approximate number of spikes of all excitatory neurons together in one step with input."""

MIXED_FORMATS = 6
"""Rows of inputs dense and sparse, the root's row, rows to counters, to inhibitory neurons, and to relays. A core with
fewer formats stores no row dense."""

GRAIN = 1 << 20
"""Expected spikes are rounded to multiples of 1 / GRAIN: their sums are exact, so equal on every machine and in any
order."""


@dataclass(frozen=True)
class Pattern:
    """Which weights are not 0.

    Attributes:
        mask: Of each kind of inputs, bool (kinds, neurons); inputs of one kind reach the same neurons.
        kind: The kind of each input, int64 (inputs,).
    """

    mask: NDArray[np.bool_] = field(repr=False)
    kind: Integers = field(repr=False)

    @cached_property
    def members(self) -> Integers:
        """Inputs of each kind, int64 (kinds,)."""
        return np.bincount(self.kind, minlength=len(self.mask))


@dataclass(frozen=True)
class Sizing:
    """A network on a board, and the needs of ranges of its neurons.

    Attributes:
        network: The network.
        board: The board.
        rates: Expected spikes of each input in a step, float64 (inputs,).
        exc_spikes: Expected spikes of all excitatory neurons in a step.
        dense_rows: Whether rows of inputs may be stored dense, without indices, which no public source shows.
        given: The pattern of weights that are not 0, if it is not that of the network's own weights.
    """

    network: FixedNetwork = field(repr=False)
    board: Board
    rates: Floats = field(repr=False)
    exc_spikes: float = EXC_SPIKES
    dense_rows: bool = False
    given: Pattern | None = field(default=None, repr=False)

    @cached_property
    def pattern(self) -> Pattern:
        """Which weights are not 0: as given, or the network's own, with every input a kind of its own."""
        return self.given or Pattern(self.network.weights != 0, np.arange(self.network.inputs))

    @property
    def inhibits(self) -> bool:
        """Whether the inhibitory neuron subtracts anything."""
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
    def listened(self) -> Integers:
        """Neurons that each inhibitory one listens to, leaves then root, int64 (inhibitory,)."""
        network = self.network
        if network.leaves == 0:
            return np.array([network.neurons])
        last = network.neurons - (network.leaves - 1) * fixed.FAN_IN
        return np.array([fixed.FAN_IN] * (network.leaves - 1) + [last, network.leaves])

    @cached_property
    def inh_spikes(self) -> Floats:
        """Expected spikes of each inhibitory neuron in a step, at most 1, float64 (inhibitory,)."""
        leaves = np.minimum(1.0, self.listened[: self.network.leaves] * self.spiking)
        return np.append(leaves, min(1.0, self.network.neurons * self.spiking))

    @cached_property
    def weight_bits(self) -> int:
        """Bits of a stored weight.

        Raises:
            NetworkLimitError: the board stores none so wide.
        """
        need = self.board.stored_bits(self.network)
        wide = [bits for bits in self.board.weight_bits if bits >= need]
        if not wide:
            most, own = max(self.board.weight_bits), need - self.network.bits
            raise NetworkLimitError(
                f"{self.board.title} stores weights of at most {most} bits, but these need {need}"
                f"{' with their sign' * own}; use --weight-bits {most - own}"
            )
        return min(wide)

    @cached_property
    def inhibition_bits(self) -> int:
        """Fewest bits that hold a synapse of the root, with its sign where the board stores it; those of the weights
        where these take `WEIGHT_BITS`, so that a core has no narrower format.

        Raises:
            NetworkLimitError: the board stores none so wide.
        """
        widest = self.board.memory.public and self.weight_bits == WEIGHT_BITS
        for bits in (WEIGHT_BITS,) if widest else sorted(self.board.weight_bits):
            try:
                lateral_synapse(self.network, bits + self.board.memory.one_sign)
            except NetworkLimitError:
                continue
            return bits
        raise NetworkLimitError(
            f"{self.board.title} stores weights of at most {max(self.board.weight_bits)} bits, but inhibition "
            f"{self.network.lateral} needs more; change network.inhibition"
        )

    @property
    def counters(self) -> int:
        """Counters of an excitatory neuron: 1, or 0 if the vendor's library reads spikes out. One takes a compartment,
        an input axon and a word of synapse memory."""
        return int(self.board.counters)

    @cached_property
    def largest(self) -> int:
        """Most excitatory neurons considered for a core."""
        return min(self.network.neurons, self.board.compartments // (1 + self.counters))

    @property
    def may_be_dense(self) -> bool:
        """Whether an input's row may be stored dense: it is allowed, and there are enough formats."""
        return self.dense_rows and self.board.memory.public and self.board.formats >= MIXED_FORMATS

    @cached_property
    def row_tables(self) -> tuple[Integers, Integers]:
        """Memory of an input's row by neurons of the core and non-zero weights, int64 (largest + 1, largest + 1): in
        the format with the fewest operations, and in the one with the fewest words."""
        memory = self.board.memory
        operations = memory.sparse_rows(self.largest, self.weight_bits)
        if not (self.may_be_dense and isinstance(memory, PackedRows)):
            return operations, operations
        sizes = np.arange(self.largest + 1)
        dense = row_words(sizes, self.weight_bits)
        operations = np.where(operations < UNLIMITED, operations, dense[:, None])
        operations[sizes, sizes] = dense
        return operations, np.minimum(operations, dense[:, None])

    @cached_property
    def root_row(self) -> Integers:
        """Memory of the root's row by neurons of the core, int64 (largest + 1,)."""
        rows = self.board.memory.sparse_rows(self.largest, self.inhibition_bits)
        return np.asarray(rows.diagonal() * self.inhibits)

    def counts(self, first: int, end: int) -> Integers:
        """Non-zero weights of each input to neurons ``first`` .. ``end - 1``, int64 (inputs,)."""
        return np.count_nonzero(self.pattern.mask[:, first:end], axis=1)[self.pattern.kind]

    def growing(self, first: int, least: int, most: int) -> tuple[Integers, Integers]:
        """Needs of the ranges of ``least``, least + 1 .. ``most`` neurons from ``first`` on, int64 each.

        Returns:
            Inputs with a weight to them, and the fewest words of all their rows and of the counters'.
        """
        mask = self.pattern.mask[:, first : first + most]
        counts = np.cumsum(mask[:, least - 1 :], axis=1, dtype=np.int32)
        counts += np.count_nonzero(mask[:, : least - 1], axis=1)[:, None].astype(np.int32)
        return self.taken(np.arange(least, most + 1), counts)

    def taken(self, sizes: Integers, counts: NDArray[np.int32]) -> tuple[Integers, Integers]:
        """Needs of ranges of ``sizes`` neurons (ranges,) with ``counts`` weights of each kind of inputs (kinds,
        ranges)."""
        members, (_, words) = self.pattern.members, self.row_tables
        return members @ (counts > 0), members @ words[sizes, counts] + self.root_row[sizes] + self.counters * sizes


def least_cores(sizing: Sizing) -> int:
    """Lower bound of the cores, from neurons and bits of weights."""
    network, board = sizing.network, sizing.board
    compartments = network.neurons + network.inhibitory + network.input_compartments
    return max(-(-int(_weight_bits(sizing).sum()) // board.memory.capacity), -(-compartments // board.compartments))


def _drawn(sizing: Sizing) -> Integers:
    """Weights from inputs to each excitatory neuron that are not 0, int64 (neurons,)."""
    return np.asarray(sizing.pattern.members @ sizing.pattern.mask, np.int64)


def _weight_bits(sizing: Sizing) -> Integers:
    """Bits of the weights to each excitatory neuron only, int64 (neurons,)."""
    return _drawn(sizing) * sizing.weight_bits + sizing.inhibition_bits * sizing.inhibits


def exceeded(sizing: Sizing) -> str:
    """The public limit that a network exceeds; empty if there is none, or if the way of storing is fully public."""
    board, network, memory = sizing.board, sizing.network, sizing.board.memory
    if not isinstance(memory, ByteBudget):
        return ""
    to_relays, most = network.relayed * network.inputs, board.chips * memory.chip_synapses
    synapses = int(_drawn(sizing).sum()) + (1 + sizing.inhibits) * network.neurons + network.leaves + to_relays
    cores, bits, bytes_of = board.chips * board.cores, _weight_bits(sizing), memory.core_bytes
    need, heaviest, least = -(-int(bits.sum()) // 8), -(-int(bits.max()) // 8), least_cores(sizing)
    neurons, have = f"{network.neurons:,} neurons", cores * bytes_of
    told = (
        (synapses, most, f"{neurons} have {synapses:,} synapses, but {board.title} has at most {most:,}"),
        (
            need,
            have,
            f"the weights of {neurons} take {need:,} bytes, but the {cores} cores of {board.title} have {have:,} for "
            "all that they hold",
        ),
        (
            heaviest,
            bytes_of,
            f"the weights of a neuron take {heaviest:,} bytes, but a core of {board.title} has {bytes_of:,} for all "
            "that it holds",
        ),
        (least, cores, f"{neurons} need {least} cores, but {board.title} has {cores}"),
    )
    return next((said for amount, limit, said in told if amount > limit), "")


DEVIATIONS = 6
"""Standard deviations by which input spikes of a step may exceed their mean: with 20 spikes of 500 inputs, one query of
64 steps in a million has a step with more."""


def host_spikes(network: FixedNetwork, rates: NDArray[np.float64]) -> float:
    """Spikes that the host sends to a chip in one step, mean plus `DEVIATIONS` standard deviations; 0 if it sends none.

    Inputs spike in a given step independently of each other, by their own draws or by regular trains with drawn phases.
    So with spike probabilities p the variance is the sum of p (1 - p). A regular train makes the sum over many steps
    nearly constant, but not one step's sum over many inputs. p is the rate r of a draw; of a regular train it is
    r / (1 - r / 2) in all steps of an interval but the last, since start membranes, not phases, are uniform.
    """
    return 0.0 if network.bias_input else _most_spikes(network, rates, 1.0)


def _most_spikes(network: FixedNetwork, rates: NDArray[np.float64], scale: float) -> float:
    """Mean plus `DEVIATIONS` standard deviations of the spikes of inputs with ``scale`` times ``rates``."""
    p = np.minimum(rates * scale, 1.0)
    p = np.minimum(p / (1 - p / 2), 1.0) if network.regular else p
    return float(p.sum() + DEVIATIONS * (p * (1 - p)).sum() ** 0.5)


def _allowed_spikes(network: FixedNetwork, rates: NDArray[np.float64], limit: int) -> float:
    """The largest sum of rates in proportion to ``rates`` that stays within ``limit``, rounded down to tenths."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _most_spikes(network, rates, middle) <= limit else (low, middle)
    return int(10 * low * float(rates.sum())) / 10


def check(sizing: Sizing) -> None:
    """Refuse a network that fits on no choice of cores.

    Raises:
        ConfigError: the network's neurons are not LIF.
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    NEURONS[sizing.network.model].check(sizing.board.title)
    sizing.network.check(sizing.board.input_limit, sizing.board.title)
    check_without_weights(sizing)


def check_without_weights(sizing: Sizing) -> None:
    """Refuse what `check` refuses, except for the sums of weights.

    Raises:
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    network, board = sizing.network, sizing.board
    board.clearing.check(network)
    _ = sizing.weight_bits, sizing.inhibition_bits  # refuse what they cannot hold
    if board.memory.indexable == 0:
        raise NetworkLimitError(
            f"synapses to inhibitory neurons need index bits, but {board.title} has none; use another --target"
        )
    beyond = exceeded(sizing)
    if beyond:
        raise NetworkLimitError(f"{beyond}; use fewer --weight-bits, --prune, or fewer places")
    spikes = host_spikes(network, sizing.rates)
    if spikes > board.host_spikes:
        most = _allowed_spikes(network, sizing.rates, board.host_spikes)
        raise NetworkLimitError(
            f"the host would have to send up to {spikes:.1f} input spikes a step, but {board.title} takes "
            f"{board.host_spikes} a chip; lower encoder.query_spikes to {most:g}, or use --input-mode bias"
        )
    populations = 2 + sizing.counters + bool(network.input_compartments)
    kinds = 2 + sizing.counters + sizing.inhibits + network.relayed
    for name, need in (("profiles", populations), ("thresholds", populations), ("formats", kinds)):
        limit = getattr(board, name)
        if need > limit:
            injected_helps = (
                network.bias_input
                and network.neurons <= fixed.DIRECT
                and name != "formats"
                and limit >= 2 + sizing.counters
            )
            remedy = "--input-mode injected" if injected_helps else "another --target"
            raise NetworkLimitError(f"a core needs {need} {name}, but {board.title} has {limit}; use {remedy}")
