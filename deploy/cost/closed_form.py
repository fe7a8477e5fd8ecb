"""Energy and time of every step from what was counted: the closed form that equals SANA-FE's.

    E_dyn  = e_syn O + e_acc N T + e_upd U + e_spk F + e_msg P + sum(e_hop H)
    t_step = max(max over cores of what arrives, max over cores of the neurons' part) + barrier

with O synaptic operations, N compartments in T steps, U updates, F spikes, P messages (one for each core that a spike
goes to, those with input spikes included), H tiles crossed. What arrives on a core takes 16 ns a message and 3.8 or 4.7
ns an operation; its neurons' part 6.0 ns an access, 3.7 an update, 30 a spike, 5.1 a message
(`lava_vpr.deploy.boards.step_time`). Form and nominal figures are SANA-FE's (``simple`` timing);
`lava_vpr.deploy.boards.constants` has all of them with sources.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import Constant, CostConstants
from lava_vpr.deploy.boards.estimate import Level
from lava_vpr.deploy.boards.step_time import arrival_nanoseconds, neuron_nanoseconds
from lava_vpr.deploy.cost.events import EventCounts

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedForm:
    """SANA-FE's column only, without clearing and static energy: what SANA-FE itself computes.

    Attributes:
        microjoules: The energy of each query by SANA-FE's components ``synapse``, ``soma`` and ``network``, float64
            (n,).
        milliseconds: The time of all steps of each query, ``simple`` timing, float64 (n,).
    """

    microjoules: dict[str, Floats]
    milliseconds: Floats

    @property
    def total_microjoules(self) -> Floats:
        """The energy of each query, (n,)."""
        return np.asarray(sum(self.microjoules.values()))


def step_picojoules(
    events: EventCounts, constants: CostConstants, level: Level, updates: str = "updates"
) -> dict[str, Floats]:
    """Dynamic energy of every step by component, pJ, float64 (n, steps).

    Args:
        events: What was counted.
        constants: The energies of the board's operations.
        level: Which of their values.
        updates: Which count of updates: ``updates`` or ``touched`` (see `lava_vpr.deploy.cost.events`).
    """

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
        "neuron updates": energy(constants.update, updates),
        "spikes": energy(constants.spike, "spikes"),
        "input messages": from_inputs,
        "other messages": messages - from_inputs - counted,
        "read-out": counted,
        "hops": hops,
    }


def core_nanoseconds(
    events: EventCounts, constants: CostConstants, level: Level, *, updates: str = "updates"
) -> tuple[Floats, Floats]:
    """Time in ns of what arrives and of the neurons' part on every core in every step, float64 (n, steps, cores) each.

    Args:
        events, constants, level, updates: As in `step_picojoules`.
    """
    arrivals = arrival_nanoseconds(
        constants, level, events.messages_in, events.operations_dense, events.operations_sparse
    )
    neurons = neuron_nanoseconds(
        constants, level, events.accesses, getattr(events, updates), events.spikes, events.messages_out
    )
    return arrivals, neurons


def step_nanoseconds(
    events: EventCounts,
    constants: CostConstants,
    level: Level,
    *,
    updates: str = "updates",
    input_core: bool = False,
) -> tuple[Floats, Floats]:
    """Time in ns of what arrives and of the neurons' part on the busiest core in every step, float64 (n, steps) each.

    Args:
        events, constants, level, updates: As in `step_picojoules`.
        input_core: One more core sends the injected spikes (as a simulator must that knows no host).
    """
    arrivals, neurons = core_nanoseconds(events, constants, level, updates=updates)
    busiest = neurons.max(axis=2)
    if input_core:
        sending = constants.message_time.at(level) * events.injected_messages
        busiest = np.maximum(busiest, sending.sum(axis=2))
    return arrivals.max(axis=2), busiest


def step_microseconds(
    events: EventCounts,
    constants: CostConstants,
    level: Level,
    tiles: int | None = None,
    *,
    updates: str = "updates",
    input_core: bool = False,
) -> Floats:
    """Time in us of every step, float64 (n, steps).

    Args:
        events, constants, level, updates, input_core: As in `step_nanoseconds`.
        tiles: In use; None: those of the plan.
    """
    arrivals, neurons = step_nanoseconds(events, constants, level, updates=updates, input_core=input_core)
    used = events.tiles if tiles is None else tiles
    longest = np.maximum(arrivals, neurons) / 1e3 + constants.barrier(used or 1).at(level)
    return np.maximum(longest, constants.step.at(level))


def closed_form(
    events: EventCounts,
    constants: CostConstants,
    *,
    tiles: int | None = None,
    updates: str = "touched",
    input_core: bool = True,
) -> ClosedForm:
    """What SANA-FE computes for the same events.

    Args:
        events: What was counted, with injected spikes from ``entry`` (`lava_vpr.deploy.cost.events.count_events`).
        constants: The constants of Loihi 1.
        tiles: With a core mapped, one of inputs included; None: those of the plan.
        updates: ``touched`` as SANA-FE counts, or ``updates``.
        input_core: Injected spikes are sent by one core of their own, whose neurons cost nothing.
    """
    picojoules = step_picojoules(events, constants, "nominal", updates)
    energy = {name: values.sum(axis=1) / 1e6 for name, values in picojoules.items()}
    microseconds = step_microseconds(events, constants, "nominal", tiles, updates=updates, input_core=input_core)
    return ClosedForm(
        {
            "synapse": energy["synaptic operations"],
            "soma": energy["neuron accesses"] + energy["neuron updates"] + energy["spikes"],
            "network": energy["input messages"] + energy["other messages"] + energy["read-out"] + energy["hops"],
        },
        microseconds.sum(axis=1) / 1e3,
    )
