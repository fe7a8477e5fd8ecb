"""Every constant of the cost model, by chip: low, nominal and high, with its source.

Two columns are public for Loihi 1: SANA-FE's, fitted to silicon, and Intel's own of 2018. Where both give the same
quantity, low is the lower of the two, nominal is SANA-FE's, and high the higher. A quantity that only one column gives
has the same value at all three levels, which then give no bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lava_vpr import loihi

Level = Literal["low", "nominal", "high"]
LEVELS: tuple[Level, ...] = ("low", "nominal", "high")


@dataclass(frozen=True)
class Estimate:
    """The low, nominal and high value of a modelled figure, in the unit that its field names."""

    low: float
    nominal: float
    high: float

    @staticmethod
    def of(value: Callable[[Level], float]) -> Estimate:
        """The estimate whose figure at each level is ``value`` of that level."""
        return Estimate(*(value(level) for level in LEVELS))

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.low + other.low, self.nominal + other.nominal, self.high + other.high)

    def __mul__(self, factor: float) -> Estimate:
        return Estimate(self.low * factor, self.nominal * factor, self.high * factor)

    def at(self, level: Level) -> float:
        """The estimate's figure at ``level``: low, nominal or high."""
        return float(getattr(self, level))

    def as_json(self) -> dict[str, float]:
        """The estimate as scripts read it."""
        return {"low": self.low, "nominal": self.nominal, "high": self.high}


def total(parts: Iterable[Estimate]) -> Estimate:
    """The sum of ``parts``; of none: 0."""
    return sum(parts, Estimate(0.0, 0.0, 0.0))


Number = float | NDArray[Any]
"""A count, or the counts of many steps and cores."""

SANA_FE = (
    "SANA-FE 2.2.9, arch/loihi.yaml, fitted to silicon (Boyle et al., IEEE TCAD 2025, doi 10.1109/TCAD.2025.3537971: "
    "12 % error in energy, 25 % in latency)"
)
DAVIES = "Davies et al., IEEE Micro 38(1), 2018, table 2, doi 10.1109/MM.2018.112130359"
FRADY = "Frady et al., NICE 2020, doi 10.1145/3381755.3398695"
BLOUW = "Blouw et al., NICE 2019, arXiv 1812.01739"


@dataclass(frozen=True)
class Constant(Estimate):
    """A constant of the cost model with its low, nominal and high value.

    Attributes:
        name: A short name, unique among the constants.
        what: The constant in words, for people.
        unit: pJ, ns, us or mW.
        source: The source in words, with DOI; it names the source of each bound, and assumptions.
    """

    name: str
    what: str
    unit: str
    source: str


def _both(name: str, what: str, unit: str, sana_fe: float, davies: float, note: str = "") -> Constant:
    """A constant that both columns give."""
    source = f"nominal: {SANA_FE}; the other: {DAVIES}{note}"
    return Constant(min(sana_fe, davies), sana_fe, max(sana_fe, davies), name, what, unit, source)


def _one(name: str, what: str, unit: str, value: float, source: str = SANA_FE) -> Constant:
    """A constant that only ``source`` gives."""
    return Constant(value, value, value, name, what, unit, source)


_ACCESS = " (there an inactive neuron's update)"
_UPDATE = " (there what an active neuron's update takes more than an inactive one's)"
_MORE_PJ = loihi.DAVIES_ACTIVE_PJ - loihi.DAVIES_INACTIVE_PJ
_MORE_NS = round(loihi.DAVIES_ACTIVE_NS - loihi.DAVIES_INACTIVE_NS, 1)


@dataclass(frozen=True)
class CostConstants:
    """Energy and time of every operation of a board, and the power and traffic around it.

    Times of a core in a step follow SANA-FE's ``simple`` timing: the handling of arriving spikes overlaps with the work
    and messages of its neurons. A step lasts as long as the longer of the two on the busiest core, and the barrier
    after it.

    Attributes:
        synapse_dense, synapse_sparse, access, update, spike, message, hop_east_west, hop_north_south: Energies, pJ.
        message_in_time, synapse_dense_time, synapse_sparse_time: Times of a core's arriving spikes, ns.
        access_time, update_time, spike_time, message_time: Times of a core's neurons, ns.
        barrier: The time of the barrier at the end of each step in us, from the number of tiles in use.
        barrier_tiles: The numbers of tiles whose barriers a report lists.
        step: The shortest time of a step, us.
        static, embedded: Power of a chip and of its embedded processors, mW.
        host_message: Time of a message between host and board, us.
        register_time, word_time: Times of an embedded processor's accesses, ns: to a register of a core (read, written,
            or a spike sent), and to a word of its own memory.
    """

    synapse_dense: Constant
    synapse_sparse: Constant
    access: Constant
    update: Constant
    spike: Constant
    message: Constant
    hop_east_west: Constant
    hop_north_south: Constant
    message_in_time: Constant
    synapse_dense_time: Constant
    synapse_sparse_time: Constant
    access_time: Constant
    update_time: Constant
    spike_time: Constant
    message_time: Constant
    barrier: Callable[[int], Constant]
    barrier_tiles: tuple[int, ...]
    step: Constant
    static: Constant
    embedded: Constant
    host_message: Constant
    register_time: Constant
    word_time: Constant

    def listed(self) -> tuple[Constant, ...]:
        """All constants in the order of the fields, with the barriers of `barrier_tiles`, for a report."""
        constants: list[Constant] = []
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "barrier":
                constants += [self.barrier(tiles) for tiles in self.barrier_tiles]
            elif isinstance(value, Constant):
                constants.append(value)
        return tuple(constants)

    def arrival_nanoseconds(
        self, level: Level, messages_in: Number, operations_dense: Number, operations_sparse: Number
    ) -> NDArray[np.float64]:
        """The time of messages received by a core, and of their synaptic operations by the format of the rows."""
        return np.asarray(
            self.message_in_time.at(level) * messages_in
            + self.synapse_dense_time.at(level) * operations_dense
            + self.synapse_sparse_time.at(level) * operations_sparse
        )

    def neuron_nanoseconds(
        self, level: Level, accesses: Number, updates: Number, spikes: Number, messages_out: Number
    ) -> NDArray[np.float64]:
        """The time of compartments accessed and updated on a core, of their spikes, and of messages sent."""
        return np.asarray(
            self.access_time.at(level) * accesses
            + self.update_time.at(level) * updates
            + self.spike_time.at(level) * spikes
            + self.message_time.at(level) * messages_out
        )


def _barrier(tiles: int) -> Constant:
    """The barrier at the end of each step, with so many tiles in use."""
    known = loihi.BARRIER_US
    nominal = known[max((n for n in known if n <= tiles), default=min(known))]
    (few, fast), (many, slow) = sorted(loihi.DAVIES_BARRIER_US.items())
    davies = fast + (slow - fast) * (min(max(tiles, few), many) - few) / (many - few)
    what = f"barrier at the end of a step, {'1 tile' if tiles == 1 else f'{tiles} tiles'} in use"
    note = f" ({fast:g} us with {few} tile, {slow:g} us with {many}; between them a straight line, an assumption)"
    return _both(f"barrier_{tiles}", what, "us", nominal, davies, note)


_REGISTER, _WORD = loihi.REGISTER_CYCLES, loihi.WORD_CYCLES


def _cycles(name: str, what: str, cycles: tuple[int, int, int]) -> Constant:
    """The time of an access of an embedded processor, from its number of clock cycles."""
    times = [1e3 * count / clock for count, clock in zip(cycles, loihi.EMBEDDED_MHZ, strict=True)]
    stated = ", ".join(f"{count} at {clock:g} MHz" for count, clock in zip(cycles, loihi.EMBEDDED_MHZ, strict=True))
    return Constant(
        times[0], times[1], times[2], name, what, "ns", f"an assumption, no figure is public; cycles: {stated}"
    )


LOIHI_1 = CostConstants(
    synapse_dense=_both(
        "synapse_dense", "synaptic operation of a dense row", "pJ", loihi.SYNAPSE_DENSE_PJ, loihi.DAVIES_SYNAPSE_PJ
    ),
    synapse_sparse=_both(
        "synapse_sparse", "synaptic operation of a sparse row", "pJ", loihi.SYNAPSE_SPARSE_PJ, loihi.DAVIES_SYNAPSE_PJ
    ),
    access=_both("access", "access to a neuron, every step", "pJ", loihi.ACCESS_PJ, loihi.DAVIES_INACTIVE_PJ, _ACCESS),
    update=_both("update", "update of a neuron that has a reason to", "pJ", loihi.UPDATE_PJ, _MORE_PJ, _UPDATE),
    spike=_one("spike", "spike of a neuron", "pJ", loihi.SPIKE_PJ),
    message=Constant(
        loihi.MESSAGE_PJ,
        loihi.MESSAGE_PJ,
        loihi.MESSAGE_PJ + loihi.DAVIES_WITHIN_TILE_PJ,
        "message",
        "message, one for each core it goes to",
        "pJ",
        f"low and nominal: sending one, {SANA_FE}, the only source of it; high: and its way within a tile, which takes "
        f"nothing there, {DAVIES}",
    ),
    hop_east_west=_both(
        "hop_east_west", "tile crossed east-west", "pJ", loihi.HOP_EAST_WEST_PJ, loihi.DAVIES_HOP_EAST_WEST_PJ
    ),
    hop_north_south=_both(
        "hop_north_south", "tile crossed north-south", "pJ", loihi.HOP_NORTH_SOUTH_PJ, loihi.DAVIES_HOP_NORTH_SOUTH_PJ
    ),
    message_in_time=_one("message_in_time", "message received", "ns", loihi.AXON_IN_NS),
    synapse_dense_time=_both(
        "synapse_dense_time", "synaptic operation of a dense row", "ns", loihi.SYNAPSE_DENSE_NS, loihi.DAVIES_SYNAPSE_NS
    ),
    synapse_sparse_time=_both(
        "synapse_sparse_time",
        "synaptic operation of a sparse row",
        "ns",
        loihi.SYNAPSE_SPARSE_NS,
        loihi.DAVIES_SYNAPSE_NS,
    ),
    access_time=_both("access_time", "access to a neuron", "ns", loihi.ACCESS_NS, loihi.DAVIES_INACTIVE_NS, _ACCESS),
    update_time=_both("update_time", "update of a neuron", "ns", loihi.UPDATE_NS, _MORE_NS, _UPDATE),
    spike_time=_one("spike_time", "spike of a neuron", "ns", loihi.SPIKE_NS),
    message_time=_one("message_time", "message sent", "ns", loihi.MESSAGE_NS),
    barrier=_barrier,
    barrier_tiles=tuple(loihi.BARRIER_US),
    step=Constant(
        0.0,
        0.0,
        loihi.POHOIKI_STEP_US,
        "step",
        "least time of a step",
        "us",
        f"high: shortest step measured on 32 chips, {FRADY}; low and nominal: no bound but the busiest core and the "
        "barrier. Kapoho Bay's own barrier is not public",
    ),
    static=Constant(
        loihi.IDLE_MILLIWATTS,
        loihi.CHIP_MILLIWATTS,
        loihi.CHIP_MILLIWATTS,
        "static",
        "power of a chip that does nothing, each chip of the board, used or not",
        "mW",
        f"nominal and high: {FRADY} (3.34 W for 32 chips); low: idle power of another board, {BLOUW}. Kapoho Bay's own "
        "is not public",
    ),
    embedded=Constant(
        0.0,
        loihi.EMBEDDED_MILLIWATTS,
        loihi.EMBEDDED_MILLIWATTS,
        "embedded",
        "power of a chip's embedded x86 processors",
        "mW",
        f"nominal and high: {FRADY}; low: contained in the idle power of {BLOUW}",
    ),
    host_message=_one(
        "host_message",
        "message between host and board over USB; how many there are makes the range",
        "us",
        loihi.KAPOHO_BAY_MESSAGE_US,
        "one public log of Kapoho Bay, not verified",
    ),
    register_time=_cycles(
        "register_time", "register of a core read or written, or spike injected, by an embedded processor", _REGISTER
    ),
    word_time=_cycles("word_time", "word of its own memory that an embedded processor handles", _WORD),
)
"""The constants of Loihi 1 and of Kapoho Bay, a board with two such chips."""

HOST_POWER = Constant(
    *loihi.HOST_MILLIWATTS,
    "host_power",
    "power of a processor while one thread of it works: a board's host, or what needs no board",
    "mW",
    "an assumption, not verified: a robot's computer. Low and nominal: the power modes of 5 and 10 W of NVIDIA's "
    "Jetson Nano (github.com/NVIDIA-AI-IOT/jetbot, wiki, Battery Tips); high: twice that, a laptop's",
)
"""Power of the processor that encodes images, serves a board, or matches without one; it belongs to no board."""
