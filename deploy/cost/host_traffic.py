"""The host's traffic for a query, as the host program of a Kapoho Bay bundle sends it, and bounds around it.

Spikes or settings go to each chip's embedded processor in packets of `PACKET_WORDS` words, and counts come back in such
packets (``programs/kapoho_bay/packets.py``). Nominal: those packets, one message over USB each. Low: the spikes of a
whole query packed one after another. High: every spike, setting and count a message of its own.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from lava_vpr.deploy.boards.constants import CostConstants
from lava_vpr.deploy.boards.estimate import Estimate
from lava_vpr.deploy.boards.plan import Plan, PopulationName
from lava_vpr.deploy.cost.events import EventCounts, routes

PACKET_WORDS = 56
"""Payload of a packet, in words."""

SETTING_WORDS, SETTING_WRITES = 2, 3
"""Words that set an input compartment, and registers that are written for it: bias, membrane, and bias 0 at the end."""


def counts_on_chips(plan: Plan, population: PopulationName) -> dict[int, int]:
    """The number of neurons of ``population`` on each chip in use."""
    neurons: Counter[int] = Counter({core.chip: 0 for core in plan.cores})
    for core in plan.cores:
        neurons[core.chip] += sum(part.size for part in core.parts if part.population == population)
    return dict(neurons)


def entry_hops(plan: Plan) -> tuple[float, float]:
    """Tiles east-west and north-south from tile 0 of a chip to its exc compartments, mean over these."""
    ways = routes(plan)
    east_west, north_south = (ways.size @ ways.entry) / max(1, int(ways.size.sum()))
    return float(east_west), float(north_south)


def _packets(values: float, room: int) -> int:
    """The number of packets that hold so many values, ``room`` in each."""
    return int(-(-values // room))


def host_milliseconds(plan: Plan, events: EventCounts, constants: CostConstants) -> dict[str, Estimate]:
    """Time of the host's traffic for a query by input mode, the one in use first."""
    inputs, steps, queries = plan.network.inputs, plan.network.steps, max(1, events.queries)
    settings = counts_on_chips(plan, "inputs")
    exc = {chip: size for chip, size in counts_on_chips(plan, "exc").items() if size + settings[chip]}
    chips = np.array([core.chip for core in plan.cores])
    back = sum(max(1, _packets(size, PACKET_WORDS)) for size in exc.values())
    counts = Estimate(back, back, max(back, sum(exc.values())))
    arrivals = events.input_messages.sum(axis=(0, 1)) / queries
    on_chip = {chip: float(arrivals[chips == chip].sum()) for chip in exc}
    # The host sends a spike once to each chip; how many messages it becomes there is the embedded processor's work.
    spikes = float(events.input_spikes.sum() / queries)
    low = sum(max(1, _packets(spikes, PACKET_WORDS)) for _ in exc)
    packets = steps * len(exc)
    injected = Estimate(min(low, packets), packets, max(packets, spikes * len(exc)))
    if events.injected:
        settings = {chip: -(-inputs // len(exc)) for chip in exc}
    few = sum(_packets(size, PACKET_WORDS // SETTING_WORDS) for size in settings.values())
    bias = Estimate(few, few, SETTING_WRITES * inputs)
    work = {
        "injected": max(on_chip.values(), default=0.0),
        "bias": SETTING_WRITES * max(settings.values(), default=0),
    }
    by_mode = {}
    for mode, messages in (("injected", injected), ("bias", bias)):
        usb = messages + counts
        sent = Estimate(*(number * constants.host_message.nominal / 1e3 for number in (usb.low, usb.nominal, usb.high)))
        by_mode[mode] = sent + constants.write_time.estimate * (work[mode] / 1e6)
    return by_mode if events.injected else dict(reversed(by_mode.items()))
