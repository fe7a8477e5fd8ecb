"""Which neurons stand on which core: few cores, then few operations, then the least busy core.

The strategy, for k cores that hold excitatory neurons in consecutive ranges:

1. **The least k.** What a range takes (compartments, axons, words with each row in its smaller format) grows with the
   range, so if each core takes as many neurons as fit, k cores reach the farthest neuron that they can.
2. **Even ranges.** The k ranges are equal where that fits, else the longest is as short as it can be.
3. **Inhibitory neurons**, then **input compartments** (relays, or what integrates a bias) stand beside them as far as
   there is room, the others on cores of their own.

More than the least k are tried as long as that can need fewer cores together: more cores with excitatory neurons leave
more room beside them. Of the layouts on the fewest cores the one with the fewest operations is chosen, then the one
with the least busy core.
"""

from __future__ import annotations

from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.mapping.layout import layout_of
from lava_vpr.deploy.mapping.limits import check, host_spikes, refusal
from lava_vpr.deploy.mapping.mesh import assign_cores
from lava_vpr.deploy.mapping.placing import Placed, balanced, even, longest, place
from lava_vpr.deploy.mapping.sizing import EXC_SPIKES, Sizing
from lava_vpr.engine.inference.fixed import FixedNetwork

_EQUALLY_FEW = 4
"""Ways on equally few cores that are compared."""

_EVERY = 8
"""Numbers of cores with excitatory neurons that are all tried; beyond, ever fewer."""


def partition(
    network: FixedNetwork,
    board: Board,
    rates: NDArray[np.float64],
    *,
    exc_spikes: float = EXC_SPIKES,
    dense_rows: bool = False,
) -> Plan:
    """Put ``network`` on the cores of ``board``.

    Args:
        network: The network.
        board: The board.
        rates: Expected spikes of each input in a step, float64 (inputs,), at least 0.
        exc_spikes: Expected spikes of all excitatory neurons together in a step.
        dense_rows: Whether rows of inputs may be stored dense, without indices, which no public source shows.
    Raises:
        NetworkLimitError: it does not fit; the message names resource, need, limit and remedy.
        ValueError: ``rates`` are not those of the network's inputs.
    """
    if rates.shape != (network.inputs,) or not (rates >= 0).all():
        raise ValueError(f"rates of shape {rates.shape} for {network.inputs} inputs, or below 0")
    sizing = Sizing(network, board, rates, exc_spikes, dense_rows)
    check(sizing)
    found = [layout_of(sizing, balanced(sizing, placed)) for placed in ways(sizing)]
    layouts = [layout for layout in found if layout is not None]
    if not layouts:
        raise refusal(sizing, fewest_cores)
    layout = min(layouts, key=attrgetter("added", "busiest"))
    positions, hops = assign_cores(layout.traffic(), board)
    order = np.lexsort((positions[:, 1], positions[:, 0]))
    cores = tuple(layout.core_plan(int(number), *positions[number].tolist()) for number in order)
    spikes = host_spikes(network, rates)
    return Plan(network, board, cores, sizing.weight_bits, sizing.inhibition_bits, hops, spikes)


def ways(sizing: Sizing) -> list[Placed]:
    """Ways on the fewest cores that are found, by the number of cores with excitatory neurons."""
    found: list[Placed] = []
    most = sizing.board.chips * sizing.board.cores
    greedy = longest(sizing, most, sizing.largest)
    if greedy is None:
        return found
    least = cores = greedy.size - 1
    while cores <= min(most, sizing.network.neurons):
        for bounds in [even(sizing, cores, greedy)] + [greedy] * (cores == least):
            placed = place(sizing, bounds, most)
            if placed is not None and placed.cores < most:
                found, most = [], placed.cores
            if placed is not None and len(found) < _EQUALLY_FEW:
                found.append(placed)
        cores += 1 + max(0, cores - least - _EVERY) // 2
        if len(found) == _EQUALLY_FEW and cores >= most:
            break
    return found


def fewest_cores(sizing: Sizing) -> int | None:
    """Cores that a plan takes; None if the network does not fit."""
    found = ways(sizing)
    return found[0].cores if found else None
