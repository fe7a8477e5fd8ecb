"""What bounds a network on a board of which little is public: synapses of a chip, bytes and neurons of a core.

A network beyond these bounds cannot fit. One within them may not fit, either: what axons, states and indices take is
not public, and is not counted.
"""

from __future__ import annotations

import numpy as np

from lava_vpr.deploy.boards.memory import ByteBudget
from lava_vpr.deploy.mapping.sizing import Integers, Sizing


def least_cores(sizing: Sizing) -> int:
    """Cores that neurons, and bits of weights, take at least."""
    network, board = sizing.network, sizing.board
    compartments = network.neurons + network.inhibitory + network.input_compartments
    return max(-(-int(_weight_bits(sizing).sum()) // sizing.words), -(-compartments // board.compartments))


def _drawn(sizing: Sizing) -> Integers:
    """Weights from inputs to each excitatory neuron that are not 0, int64 (neurons,)."""
    return np.asarray(sizing.pattern.members @ sizing.pattern.mask, np.int64)


def _weight_bits(sizing: Sizing) -> Integers:
    """Bits of the weights to each excitatory neuron, and of nothing else, int64 (neurons,)."""
    return _drawn(sizing) * sizing.weight_bits + sizing.inhibition_bits * sizing.inhibits


def exceeded(sizing: Sizing) -> str:
    """The public number that a network is beyond; empty if there is none, or if storing is public in full."""
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
