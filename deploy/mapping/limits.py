"""What a board refuses whatever stands on which core: limits of weights, sums, host traffic and registers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.mapping.sizing import Sizing, limit_of
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError

DEVIATIONS = 6
"""Standard deviations by which input spikes of a step may exceed their mean."""


def host_spikes(network: FixedNetwork, rates: NDArray[np.float64]) -> float:
    """Spikes that the host sends to a chip in one step, mean plus `DEVIATIONS` standard deviations."""
    total = 0.0 if network.bias_input else float(rates.sum())
    return total + DEVIATIONS * total**0.5


def check(sizing: Sizing) -> None:
    """Refuse what no choice of cores could help.

    Raises:
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    network, board = sizing.network, sizing.board
    if network.shift > 0 and not board.shifts_sum:
        bits = network.bits - network.shift
        fewer = f" or use --weight-bits {bits}" if bits > 0 else ""
        raise NetworkLimitError(
            f"weights of {network.bits} bits need their sum shifted right by {network.shift}, but {board.title} shifts "
            f"each weight; quantise the model anew with `lava-vpr deploy`{fewer}"
        )
    network.check(board.input_limit, board.title)
    _ = sizing.weight_bits, sizing.lateral_bits  # refuse what they cannot hold
    if sizing.indexable == 0:
        raise NetworkLimitError(f"synapses to relays need index bits, but {board.title} has none; use another --target")
    spikes = host_spikes(network, sizing.rates)
    if spikes > limit_of(board.host_spikes):
        # Rounded down: the mean m with m + 6 sqrt(m) at the limit.
        most = int(10 * ((DEVIATIONS**2 / 4 + limit_of(board.host_spikes)) ** 0.5 - DEVIATIONS / 2) ** 2) / 10
        raise NetworkLimitError(
            f"the host would have to send up to {spikes:.1f} input spikes a step, but {board.title} takes "
            f"{board.host_spikes} a chip; lower encoder.query_spikes to {most:g}, or use --input-mode bias"
        )
    populations = 3 if network.bias_input else 2
    kinds = 3 if sizing.inhibits else 2
    for name, need in (("profiles", populations), ("thresholds", populations), ("formats", kinds)):
        limit = limit_of(getattr(board, name))
        if need > limit:
            injected_helps = network.bias_input and name != "formats" and limit >= 2
            remedy = "--input-mode injected" if injected_helps else "another --target"
            raise NetworkLimitError(f"a core needs {need} {name}, but {board.title} has {limit}; use {remedy}")
