"""The host's traffic for a query, as the host program of a Kapoho Bay bundle sends it, and bounds around it.

Spikes or settings go to each chip's embedded processor in packets of `ROOM` words, and counts come back in such
packets (``programs/kapoho_bay/packets.py``). Nominal: those packets, one message over USB each. Low: the spikes of a
whole query packed one after another. High: every spike, setting and count a message of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lava_vpr.deploy.boards.constants import CostConstants
from lava_vpr.deploy.boards.estimate import Estimate
from lava_vpr.deploy.boards.plan import Plan, PopulationName
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.embedded import ROOM, SETTING_WORDS, chips_of, members
from lava_vpr.deploy.cost.events import EventCounts, routes
from lava_vpr.engine.inference import fixed

SETTING_WRITES = 3
"""Registers that are written for an input compartment: bias, membrane, and bias 0 at the end."""


def counts_on_chips(plan: Plan, population: PopulationName) -> dict[int, int]:
    """The number of neurons of ``population`` on each chip in use."""
    return {chip: members(plan, chip, population)[0] for chip in chips_of(plan)}


def entry_hops(plan: Plan, population: PopulationName = "exc") -> tuple[float, float]:
    """Tiles east-west and north-south from tile 0 of a chip to its compartments of ``population``, mean over these."""
    sizes = np.array([core.part(population).size for core in plan.cores])
    east_west, north_south = (sizes @ routes(plan).entry) / max(1, int(sizes.sum()))
    return float(east_west), float(north_south)


def _packets(values: float, room: int) -> int:
    """The number of packets that hold so many values, ``room`` in each."""
    return int(-(-values // room))


def host_milliseconds(plan: Plan, events: EventCounts, constants: CostConstants) -> dict[str, Estimate]:
    """Time of the host's traffic for a query by input mode, the one in use first."""
    inputs, steps, compartments = plan.network.inputs, plan.network.steps, counts_on_chips(plan, "inputs")
    exc = {chip: size for chip, size in counts_on_chips(plan, "exc").items() if size + compartments[chip]}
    if not plan.network.input_compartments:
        compartments = {chip: -(-inputs // len(exc)) for chip in exc}
    back = sum(max(1, _packets(size, ROOM)) for size in exc.values())
    counts = Estimate(back, back, max(back, sum(exc.values())))
    sent = _injected(plan, events, list(exc))
    low, packets = sum(max(1, _packets(spikes, ROOM)) for spikes in sent), steps * len(exc)
    injected = Estimate(min(low, packets), packets, max(packets, sum(sent)))
    few = sum(_packets(size, ROOM // SETTING_WORDS) for size in compartments.values())
    bias = Estimate(few, few, SETTING_WRITES * inputs)
    by_mode = {}
    for mode, messages in (("injected", injected), ("bias", bias)):
        usb = messages + counts
        time = Estimate(*(number * constants.host_message.nominal / 1e3 for number in (usb.low, usb.nominal, usb.high)))
        by_mode[mode] = time
    return by_mode if events.injected else dict(reversed(by_mode.items()))


def bias_milliseconds(plan: Plan, constants: CostConstants) -> Estimate:
    """Time of the biases of an adapted query: packets to each chip, a word a neuron, and what its processor does."""
    sizes = counts_on_chips(plan, "exc").values()
    packets = sum(_packets(size, ROOM) for size in sizes)
    messages = Estimate(packets, packets, sum(sizes))
    return messages * (constants.host_message.nominal / 1e3) + embedded.milliseconds(
        embedded.of_biases(plan), constants
    )


def _injected(plan: Plan, events: EventCounts, chips: Sequence[int]) -> list[float]:
    """Spikes of a query that the host sends each of ``chips``.

    The host sends a spike once to each chip, or to that of its relay; how many messages it becomes there is the
    embedded processor's work.
    """
    spikes = float(events.input_spikes.sum() / max(1, events.queries))
    if through_relays(plan):
        relays = counts_on_chips(plan, "inputs")
        return [spikes * relays[chip] / max(1, plan.network.inputs) for chip in chips]
    return [spikes] * len(chips)


def through_relays(plan: Plan) -> bool:
    """Whether injected spikes go through relays, or would if this plan's inputs did not integrate a bias."""
    return fixed.input_delay(plan.network.neurons, bias_input=False) == 2
