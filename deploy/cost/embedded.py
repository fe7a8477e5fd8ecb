"""Time of the program on a chip's embedded processor, as counted accesses times assumed cycles, and of the host's
traffic with it.

The accesses are those in ``programs/kapoho_bay/embedded.c``: registers of cores over the mesh (a state or setting read
or written, a spike sent to a core, a core flushed), and words of the processor's own memory (packets copied, summed and
filled, tables looked up). It runs after the neurons of every step, while the cores wait: its time adds to theirs, and
chips, which step together, wait for the busiest. The time of an access is not public (`loihi.REGISTER_CYCLES`).

The host's traffic for a query is that of a Kapoho Bay bundle's host program, with bounds. Spikes or settings go to each
chip's embedded processor in packets of `ROOM` words, and counts come back in such packets
(``programs/kapoho_bay/packets.py``). Nominal: those packets, one message over USB each. Low: the spikes of a whole
query packed one after another. High: every spike, setting and count a message of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import CostConstants, Estimate, Level
from lava_vpr.deploy.boards.plan import Plan, PopulationName
from lava_vpr.deploy.cost.events import EventCounts, routes
from lava_vpr.engine.inference import fixed
from lava_vpr.loihi import PACKET_HEADER_WORDS, PACKET_WORDS

Floats = NDArray[np.float64]

CALL_WORDS = 8
"""Words accessed by every call of the program: guard, state, and the step of the query."""

ROOM = PACKET_WORDS - PACKET_HEADER_WORDS
"""Payload of a packet, in words."""

SETTING_WORDS, SETTING_ACCESSES, SILENCING_ACCESSES, BIAS_ACCESSES, NEURON_ACCESSES = 2, 3, 2, 2, 3
"""Words that set an input compartment; accesses to set it (bias read and written, membrane written), to take its bias
away, to set a neuron's bias (read and written), and of a neuron between queries (counter read; counter and membrane
cleared)."""


@dataclass(frozen=True)
class Accesses:
    """Accesses of one chip's processor: ``registers`` of cores, and ``words`` of its own memory."""

    registers: float
    words: float

    def __add__(self, other: Accesses) -> Accesses:
        return Accesses(self.registers + other.registers, self.words + other.words)

    def nanoseconds(self, constants: CostConstants) -> Estimate:
        """Time of these accesses."""
        return constants.register_time * self.registers + constants.word_time * self.words


def received(words: float) -> float:
    """Words of memory accessed for received packets with so many words of payload: copied whole, summed and used."""
    return -(-words // ROOM) * (PACKET_WORDS + PACKET_HEADER_WORDS) + 2 * words


def sent(words: float) -> float:
    """Words of memory accessed for packets of counts, at least one: emptied and copied whole, filled and summed."""
    return max(1, -(-words // ROOM)) * (2 * PACKET_WORDS + PACKET_HEADER_WORDS) + 2 * words


def chips_of(plan: Plan) -> list[int]:
    """The chips in use."""
    return sorted({core.chip for core in plan.cores})


def members(plan: Plan, chip: int, population: PopulationName) -> tuple[int, int]:
    """Number of neurons of ``population`` on a chip, and of the cores with any of them."""
    sizes = [core.part(population).size for core in plan.cores if core.chip == chip]
    return sum(sizes), sum(size > 0 for size in sizes)


def between_queries(plan: Plan) -> dict[int, Accesses]:
    """Accesses of each chip's processor between two queries: reading and sending counts, clearing states, setting
    inputs and, at the end, silencing them."""
    found = {}
    for chip in chips_of(plan):
        exc, exc_cores = members(plan, chip, "exc")
        accesses = Accesses(NEURON_ACCESSES * exc + exc_cores, sent(exc) + 2 * exc)
        if plan.network.bias_input:
            inputs, cores = members(plan, chip, "inputs")
            set_up = (SETTING_ACCESSES + SILENCING_ACCESSES) * inputs + 2 * cores
            accesses += Accesses(set_up, received(SETTING_WORDS * inputs) + inputs)
        found[chip] = accesses
    return found


def milliseconds(accesses: dict[int, Accesses], constants: CostConstants) -> Estimate:
    """Time of the busiest of the chips' processors, which work in parallel."""
    times = [own.nanoseconds(constants) for own in accesses.values()]
    return Estimate.of(lambda level: max((time.at(level) for time in times), default=0.0) / 1e6)


def _in_steps(plan: Plan, events: EventCounts) -> list[tuple[Floats, Floats]]:
    """Accesses to registers and words of each chip's processor in every step, float64 (n, steps) each."""
    where = np.array([core.chip for core in plan.cores])
    with_input = np.arange(events.steps) < plan.network.steps
    found = []
    for chip in chips_of(plan):
        registers = events.injected_messages[:, :, where == chip].sum(axis=2).astype(np.float64)
        words = np.full(registers.shape, float(CALL_WORDS))
        if events.injected:
            spikes = registers if plan.network.relayed else events.input_spikes.astype(np.float64)
            targets = sum(members(plan, chip, "inputs" if plan.network.relayed else "exc")[1:])
            packet = PACKET_WORDS + PACKET_HEADER_WORDS
            words = words + np.where(with_input, packet + (2 + targets) * spikes, 0.0)
        found.append((registers, words))
    return found


def step_microseconds(plan: Plan, events: EventCounts, constants: CostConstants, level: Level) -> Floats:
    """Time of the program in every step, us, float64 (n, steps): that of the busiest chip."""
    register, word = constants.register_time.at(level), constants.word_time.at(level)
    times = [register * registers + word * words for registers, words in _in_steps(plan, events)]
    return np.asarray(np.max(times, axis=0) / 1e3)


def as_json(plan: Plan, events: EventCounts, constants: CostConstants) -> dict[str, object]:
    """The program's work by name: accesses of the busiest chip in a step (mean) and between queries; their times."""
    steps, queries = _in_steps(plan, events), between_queries(plan)

    def most(values: Callable[[tuple[Floats, Floats]], Floats]) -> float:
        return max(float(values(own).mean()) for own in steps)

    return {
        "registers_per_step": most(lambda own: own[0]),
        "words_per_step": most(lambda own: own[1]),
        "registers_per_query": max(own.registers for own in queries.values()),
        "words_per_query": max(own.words for own in queries.values()),
        "step_microseconds": Estimate.of(lambda level: float(step_microseconds(plan, events, constants, level).mean())),
        "query_milliseconds": milliseconds(queries, constants),
    }


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


def host_milliseconds(
    plan: Plan, events: EventCounts, constants: CostConstants
) -> tuple[dict[str, Estimate], Estimate]:
    """Time of the host's packets for a query by input mode, the one in use first, and of the counts that come back."""
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
    each = constants.host_message.nominal / 1e3
    by_mode = {"injected": injected * each, "bias": bias * each}
    return by_mode if events.injected else dict(reversed(by_mode.items())), counts * each


def bias_milliseconds(plan: Plan, constants: CostConstants) -> Estimate:
    """Time of the biases of an adapted query: packets to each chip, a word per neuron, and the work of its
    processor."""
    chips = {chip: members(plan, chip, "exc") for chip in chips_of(plan)}
    packets = sum(_packets(exc, ROOM) for exc, _ in chips.values())
    messages = Estimate(packets, packets, sum(exc for exc, _ in chips.values()))
    written = {chip: Accesses(BIAS_ACCESSES * exc + cores, received(exc)) for chip, (exc, cores) in chips.items()}
    return messages * (constants.host_message.nominal / 1e3) + milliseconds(written, constants)


def _injected(plan: Plan, events: EventCounts, chips: Sequence[int]) -> list[float]:
    """Spikes of a query that the host sends to each of ``chips``.

    The host sends a spike once to each chip, or only to the chip of its relay; the embedded processor sends the
    messages on the chip.
    """
    spikes = float(events.input_spikes.sum() / max(1, events.queries))
    if through_relays(plan):
        relays = counts_on_chips(plan, "inputs")
        return [spikes * relays[chip] / max(1, plan.network.inputs) for chip in chips]
    return [spikes] * len(chips)


def through_relays(plan: Plan) -> bool:
    """Whether injected spikes go through relays, or would if this plan's inputs did not integrate a bias."""
    return fixed.input_delay(plan.network.neurons, bias_input=False) == 2
