"""Energy and time of a query besides its steps: counts read, states cleared, inputs set, and biases adapted.

The embedded processors of the chips do all of it, register by register, before the first step and after the last.
"""

from __future__ import annotations

from typing import Any

from lava_vpr.deploy.boards.board import rest_steps
from lava_vpr.deploy.boards.constants import CostConstants, Estimate, Level, total
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.embedded import SETTING_WRITES, counts_on_chips, entry_hops
from lava_vpr.deploy.cost.events import EventCounts

CLEARED = 2
"""Membranes that are cleared for each excitatory neuron: its own, and its counter's."""


def microjoules_by_component(plan: Plan, constants: CostConstants) -> dict[str, Estimate]:
    """Energy of the registers read and written for a query between presentations, by component, without adaptation."""
    write = _write_picojoules(plan, constants)
    components = {
        "clearing of states": write * (CLEARED * plan.network.neurons / 1e6),
        "reading of counts": write * (plan.network.neurons / 1e6),
    }
    if plan.network.bias_input:
        components["settings of the inputs"] = settings_microjoules(plan, constants)
    return components


def adaptation_microjoules(plan: Plan, constants: CostConstants) -> Estimate:
    """Energy of the biases that are written for an adapted query, one register of every excitatory neuron."""
    return _write_picojoules(plan, constants) * (plan.network.neurons / 1e6)


def _write_picojoules(plan: Plan, constants: CostConstants) -> Estimate:
    """Energy of a register read or written by an embedded processor: a message, its hops, an access and an update."""
    east_west, north_south = entry_hops(plan)
    return total(
        (
            constants.message,
            constants.hop_east_west * east_west,
            constants.hop_north_south * north_south,
            constants.access,
            constants.update,
        )
    )


def settings_microjoules(plan: Plan, constants: CostConstants) -> Estimate:
    """Energy of the writes that set all input compartments."""
    return _write_picojoules(plan, constants) * (SETTING_WRITES * plan.network.inputs / 1e6)


def outside_steps(plan: Plan, constants: CostConstants) -> tuple[Estimate, Estimate]:
    """Microjoules and milliseconds of a query besides its steps: reading and sending counts, clearing states, and
    setting inputs that are compartments."""
    between = embedded.milliseconds(embedded.between_queries(plan), constants)
    return total(microjoules_by_component(plan, constants).values()), between


def clearing(plan: Plan, events: EventCounts, constants: CostConstants) -> dict[str, Any]:
    """The board's `Clearing` with its costs, and the costs of steps of rest instead."""
    microjoules = microjoules_by_component(plan, constants)["clearing of states"]
    most = max(counts_on_chips(plan, "exc").values(), default=0)  # each chip's processor writes its own
    told = {
        **plan.board.clearing.of(plan.network),
        "microjoules": microjoules,
        "milliseconds": constants.register_time * (CLEARED * most / 1e6),
    }
    steps = rest_steps(plan.network)
    if steps is None:
        return told | {"rest_microjoules": None, "rest_milliseconds": None, "cheaper": "embedded writes"}
    barrier = constants.barrier(events.tiles or 1)

    def rest_step(level: Level) -> float:
        """Microseconds of a step in which no spike is anywhere, while the membranes of exc decay."""
        sizes = [(sum(part.size for part in core.parts), core.part("exc").size) for core in plan.cores]
        busiest = max(float(constants.neuron_nanoseconds(level, mapped, exc, 0, 0)) for mapped, exc in sizes)
        return max(busiest / 1e3 + barrier.at(level), constants.step.at(level))

    mapped = int(events.accesses[0, 0].sum()) if events.queries else 0
    rest = (constants.access * mapped + constants.update * plan.network.neurons) * (steps / 1e6)
    return told | {
        "rest_microjoules": rest,
        "rest_milliseconds": Estimate.of(rest_step) * (steps / 1e3),
        "cheaper": "rest steps" if rest.nominal < microjoules.nominal else "embedded writes",
    }
