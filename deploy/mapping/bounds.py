"""What bounds a network on a board of which little is public: synapses of a chip, bytes and neurons of a core.

A network beyond these bounds cannot fit. One within them may not fit, either: what axons, states and indices take is
not public, and is not counted.
"""

from __future__ import annotations

from lava_vpr.deploy.mapping.sizing import Sizing


def least_cores(sizing: Sizing) -> int:
    """Cores that neurons, and bits of weights, take at least; of a board whose ``core_bytes`` are known."""
    network, board = sizing.network, sizing.board
    compartments = network.neurons + network.inhibitory + network.input_compartments
    return max(-(-int(sizing.stored.sum()) // sizing.words), -(-compartments // board.compartments))


def exceeded(sizing: Sizing) -> str:
    """The public number that a network is beyond; empty if there is none, or if the board is well known."""
    board, network = sizing.board, sizing.network
    if board.synapses is None or board.core_bytes is None:
        return ""
    if sizing.synapses > board.chips * board.synapses:
        return (
            f"{network.neurons:,} neurons have {sizing.synapses:,} synapses, but {board.title} has at most "
            f"{board.chips * board.synapses:,}"
        )
    cores, need = board.chips * board.cores, -(-int(sizing.stored.sum()) // 8)
    if need > cores * board.core_bytes:
        return (
            f"the weights of {network.neurons:,} neurons take {need:,} bytes, but the {cores} cores of {board.title} "
            f"have {cores * board.core_bytes:,} for all that they hold"
        )
    heaviest = -(-int(sizing.stored.max()) // 8)
    if heaviest > board.core_bytes:
        return (
            f"the weights of a neuron take {heaviest:,} bytes, but a core of {board.title} has {board.core_bytes:,} "
            "for all that it holds"
        )
    if least_cores(sizing) > cores:
        return f"{network.neurons:,} neurons need {least_cores(sizing)} cores, but {board.title} has {cores}"
    return ""
