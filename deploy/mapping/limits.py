"""What a board refuses whatever stands on which core: limits of weights, sums, host traffic and registers.

Of a board of which little is public, synapses of a chip, bytes and neurons of a core bound a network. One beyond these
bounds cannot fit. One within them may not fit, either: what axons, states and indices take is not public, and is not
counted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.memory import ByteBudget
from lava_vpr.deploy.mapping.sizing import Integers, Sizing
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError


def least_cores(sizing: Sizing) -> int:
    """Cores that neurons, and bits of weights, take at least."""
    network, board = sizing.network, sizing.board
    compartments = network.neurons + network.inhibitory + network.input_compartments
    return max(-(-int(_weight_bits(sizing).sum()) // board.memory.capacity), -(-compartments // board.compartments))


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


DEVIATIONS = 6
"""Standard deviations by which input spikes of a step may exceed their mean: with 20 spikes of 500 inputs, one query of
64 steps in a million has a step with more."""


def host_spikes(network: FixedNetwork, rates: NDArray[np.float64]) -> float:
    """Spikes that the host sends to a chip in one step, mean plus `DEVIATIONS` standard deviations; 0 if it sends none.

    Whatever the trains, inputs spike in a given step independently of each other: by draws of their own, or by regular
    trains whose phases are drawn. So where an input spikes with probability p, the variance is the sum of p (1 - p).
    That a train is regular makes its sum over many steps nearly constant, not one step's sum over many inputs. p is the
    rate r of a draw; of a regular train it is r / (1 - r / 2) in all steps of an interval but the last, since start
    membranes, not phases, are uniform.
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
    """Refuse what no choice of cores could help.

    Raises:
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    sizing.network.check(sizing.board.input_limit, sizing.board.title)
    check_without_weights(sizing)


def check_without_weights(sizing: Sizing) -> None:
    """What `check` refuses, but for the sums of weights.

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
