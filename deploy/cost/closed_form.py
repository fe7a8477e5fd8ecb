"""Energy and time of every step from what was counted: the closed form that equals SANA-FE's.

    E_dyn  = e_syn O + e_acc N T + e_upd U + e_spk F + e_msg P + sum(e_hop H)
    t_step = max(max over cores of what arrives, max over cores of the neurons' part) + barrier

with O synaptic operations, N compartments in T steps, U updates, F spikes, P messages (one for each core that a spike
goes to, those with input spikes included), H tiles crossed. What arrives on a core takes 16 ns a message and 3.8 or 4.7
ns an operation; its neurons' part 6.0 ns an access, 3.7 an update, 30 a spike, 5.1 a message. Form and nominal figures
are SANA-FE's (``simple`` timing); `lava_vpr.deploy.boards.constants` has all of them with sources.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards import constants as c
from lava_vpr.deploy.boards.constants import Constant, Level, barrier
from lava_vpr.deploy.cost.events import EventCounts

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedForm:
    """SANA-FE's column only, without clearing, read-out and static energy: what SANA-FE itself computes.

    Attributes:
        microjoules: Of each query by SANA-FE's components ``synapse``, ``soma`` and ``network``, float64 (n,).
        milliseconds: Of all steps of each query, ``simple`` timing, float64 (n,).
    """

    microjoules: dict[str, Floats]
    milliseconds: Floats

    @property
    def total_microjoules(self) -> Floats:
        """Of each query, (n,)."""
        return np.asarray(sum(self.microjoules.values()))


def step_picojoules(events: EventCounts, level: Level, updates: str = "updates") -> dict[str, Floats]:
    """Dynamic energy of every step by component, pJ, float64 (n, steps).

    Args:
        events: What was counted.
        level: Of the constants.
        updates: Which count of updates: ``updates`` or ``touched`` (see `lava_vpr.deploy.cost.events`).
    """

    def cost(constant: Constant, *names: str) -> Floats:
        value = getattr(constant, level)
        return np.asarray(value * sum(getattr(events, name).sum(axis=2) for name in names), np.float64)

    from_inputs = cost(c.MESSAGE, "input_messages")
    messages = cost(c.MESSAGE, "messages_out")
    hops = cost(c.HOP_EAST_WEST, "hops_east_west") + cost(c.HOP_NORTH_SOUTH, "hops_north_south")
    if events.injected:
        hops = hops + cost(c.HOP_EAST_WEST, "input_hops_east_west")
        hops = hops + cost(c.HOP_NORTH_SOUTH, "input_hops_north_south")
    else:
        messages = messages - from_inputs
    return {
        "synaptic operations": cost(c.SYNAPSE_DENSE, "operations_dense") + cost(c.SYNAPSE_SPARSE, "operations_sparse"),
        "neuron accesses": cost(c.ACCESS, "accesses"),
        "neuron updates": cost(c.UPDATE, updates),
        "spikes": cost(c.SPIKE, "spikes"),
        "input messages": from_inputs,
        "other messages": messages,
        "read-out": cost(c.MESSAGE, "read_outs"),
        "hops": hops,
    }


def step_nanoseconds(
    events: EventCounts, level: Level, *, updates: str = "updates", read_out: bool = True, input_core: bool = False
) -> tuple[Floats, Floats]:
    """Time in ns of what arrives and of the neurons' part on the busiest core in every step, float64 (n, steps) each.

    Args:
        events, level, updates: As in `step_picojoules`.
        read_out: Spikes sent to the embedded processor count.
        input_core: One more core sends the injected spikes (as a simulator must that knows no host).
    """

    def cost(constant: Constant, *names: str) -> Floats:
        return np.asarray(getattr(constant, level) * sum(getattr(events, name) for name in names), np.float64)

    receive = (
        cost(c.MESSAGE_IN_TIME, "messages_in")
        + cost(c.SYNAPSE_DENSE_TIME, "operations_dense")
        + cost(c.SYNAPSE_SPARSE_TIME, "operations_sparse")
    )
    neurons = (
        cost(c.ACCESS_TIME, "accesses")
        + cost(c.UPDATE_TIME, updates)
        + cost(c.SPIKE_TIME, "spikes")
        + cost(c.MESSAGE_TIME, "messages_out", *["read_outs"] * read_out)
    )
    busiest = neurons.max(axis=2)
    if input_core and events.injected:
        busiest = np.maximum(busiest, cost(c.MESSAGE_TIME, "input_messages").sum(axis=2))
    return receive.max(axis=2), busiest


def step_microseconds(events: EventCounts, level: Level, tiles: int | None = None, **options: Any) -> Floats:
    """Time in us of every step, float64 (n, steps); ``options`` as in `step_nanoseconds`."""
    receive, neurons = step_nanoseconds(events, level, **options)
    used = events.tiles if tiles is None else tiles
    own = np.maximum(receive, neurons) / 1e3 + getattr(barrier(used or 1), level)
    return np.maximum(own, getattr(c.STEP, level))


def closed_form(
    events: EventCounts, *, tiles: int | None = None, updates: str = "touched", input_core: bool = True
) -> ClosedForm:
    """What SANA-FE computes for the same events.

    Args:
        events: What was counted, with injected spikes from ``entry`` (`lava_vpr.deploy.cost.events.count_events`).
        tiles: With a core mapped, one of inputs included; None: those of the plan.
        updates: ``touched`` as SANA-FE counts, or ``updates``.
        input_core: Injected spikes are sent by one core of their own, whose neurons cost nothing.
    """
    energy = {k: v.sum(axis=1) / 1e6 for k, v in step_picojoules(events, "nominal", updates).items()}
    time = step_microseconds(events, "nominal", tiles, updates=updates, read_out=False, input_core=input_core).sum(
        axis=1
    )
    return ClosedForm(
        {
            "synapse": energy["synaptic operations"],
            "soma": energy["neuron accesses"] + energy["neuron updates"] + energy["spikes"],
            "network": energy["input messages"] + energy["other messages"] + energy["hops"],
        },
        time / 1e3,
    )
