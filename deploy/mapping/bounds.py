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
    if synapses > most:
        return f"{network.neurons:,} neurons have {synapses:,} synapses, but {board.title} has at most {most:,}"
    cores, bits = board.chips * board.cores, _weight_bits(sizing)
    need, heaviest = -(-int(bits.sum()) // 8), -(-int(bits.max()) // 8)
    if need > cores * memory.core_bytes:
        return (
            f"the weights of {network.neurons:,} neurons take {need:,} bytes, but the {cores} cores of {board.title} "
            f"have {cores * memory.core_bytes:,} for all that they hold"
        )
    if heaviest > memory.core_bytes:
        return (
            f"the weights of a neuron take {heaviest:,} bytes, but a core of {board.title} has {memory.core_bytes:,} "
            "for all that it holds"
        )
    if least_cores(sizing) > cores:
        return f"{network.neurons:,} neurons need {least_cores(sizing)} cores, but {board.title} has {cores}"
    return ""
