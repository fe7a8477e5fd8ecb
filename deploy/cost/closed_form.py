"""Energy and time of every step from counted events, by the closed form that equals SANA-FE's.

    E_dyn  = e_syn O + e_acc N T + e_upd U + e_spk F + e_msg P + sum(e_hop H)
    t_step = max(max over cores of what arrives, max over cores of the neurons' part) + barrier

with O synaptic operations, N compartments in T steps, U updates, F spikes, P messages (one for each core that a spike
goes to, those with input spikes included), H tiles crossed. What arrives on a core takes 16 ns a message and 3.8 or 4.7
ns an operation; its neurons' part 6.0 ns an access, 3.7 an update, 30 a spike, 5.1 a message
(`lava_vpr.deploy.boards.constants.CostConstants`). Form and nominal figures are SANA-FE's (``simple`` timing);
`lava_vpr.deploy.boards.constants` lists all of them with sources.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import Constant, CostConstants, Level
from lava_vpr.deploy.cost.events import EventCounts

Floats = NDArray[np.float64]


def step_picojoules(events: EventCounts, constants: CostConstants, level: Level) -> dict[str, Floats]:
    """Dynamic energy of every step by component, pJ, float64 (n, steps)."""

    def energy(constant: Constant, name: str) -> Floats:
        return np.asarray(constant.at(level) * getattr(events, name).sum(axis=2), np.float64)

    from_inputs = energy(constants.message, "input_messages")
    messages = energy(constants.message, "messages_out") + energy(constants.message, "injected_messages")
    counted = energy(constants.message, "read_outs")
    hops = energy(constants.hop_east_west, "hops_east_west") + energy(constants.hop_north_south, "hops_north_south")
    hops = hops + energy(constants.hop_east_west, "injected_hops_east_west")
    hops = hops + energy(constants.hop_north_south, "injected_hops_north_south")
    dense, sparse = "operations_dense", "operations_sparse"
    return {
        "synaptic operations": energy(constants.synapse_dense, dense) + energy(constants.synapse_sparse, sparse),
        "neuron accesses": energy(constants.access, "accesses"),
        "neuron updates": energy(constants.update, "updates"),
        "spikes": energy(constants.spike, "spikes"),
        "input messages": from_inputs,
        "other messages": messages - from_inputs - counted,
        "read-out": counted,
        "hops": hops,
    }


def core_nanoseconds(events: EventCounts, constants: CostConstants, level: Level) -> tuple[Floats, Floats]:
    """Times of arriving spikes and of neurons on every core in every step, ns, float64 (n, steps, cores) each."""
    arrivals = constants.arrival_nanoseconds(
        level, events.messages_in, events.operations_dense, events.operations_sparse
    )
    neurons = constants.neuron_nanoseconds(level, events.accesses, events.updates, events.spikes, events.messages_out)
    return arrivals, neurons


def step_nanoseconds(events: EventCounts, constants: CostConstants, level: Level) -> tuple[Floats, Floats]:
    """Times of arriving spikes and of neurons on the busiest core in every step, ns, float64 (n, steps) each."""
    arrivals, neurons = core_nanoseconds(events, constants, level)
    return arrivals.max(axis=2), neurons.max(axis=2)


def step_microseconds(events: EventCounts, constants: CostConstants, level: Level) -> Floats:
    """Time in us of every step, float64 (n, steps)."""
    longest = np.maximum(*step_nanoseconds(events, constants, level)) / 1e3
    return np.maximum(longest + constants.barrier(events.tiles or 1).at(level), constants.step.at(level))
