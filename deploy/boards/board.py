"""The boards for deployment: limits, storage of synapses, times, and the clearing of states between two queries (the
contract in `docs/network.md`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lava_vpr import loihi
from lava_vpr.deploy.boards.constants import LOIHI_1, CostConstants, Number
from lava_vpr.deploy.boards.memory import UNLIMITED, ByteBudget, Memory, PackedRows
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import BackendUnavailableError, NetworkLimitError
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY, LOIHI_2_RESET_LIMIT, STATE_LIMIT, reset_interval
from lava_vpr.rows.registry import Registry


def rest_steps(network: FixedNetwork) -> int | None:
    """Steps without input after which every membrane has decayed to 0 from any value.

    None if no number of steps is enough, because neurons have biases or membranes do not decay.
    """
    if network.bias.any() or network.decay == 0:
        return None
    keep, v, steps = DECAY_UNITY - network.decay, STATE_LIMIT - 1, 0
    while v:
        v, steps = v * keep >> DECAY_BITS, steps + 1
    return steps


def check_reset(interval: int, setting: str) -> None:
    """Refuse a presentation after which Loihi 2 cannot reset its neurons: LIFReset's intervals are powers of two.

    Args:
        interval: Steps of a presentation, the silent ones included.
        setting: The setting that determines it, for the remedy.
    Raises:
        NetworkLimitError: naming the possible intervals.
    """
    above = reset_interval(interval)
    if interval != above or interval > LOIHI_2_RESET_LIMIT:
        below, above = min(above // 2, LOIHI_2_RESET_LIMIT), min(above, LOIHI_2_RESET_LIMIT)
        able = f"{below:,}" if below == above else f"{below:,} or {above:,}"
        raise NetworkLimitError(
            f"a presentation takes {interval:,} steps, but Loihi 2 resets neurons at powers of two of at most "
            f"{LOIHI_2_RESET_LIMIT:,}; train with {setting} such that it takes {able}, the silent steps included"
        )


def _always(network: FixedNetwork, bias: int, adapted: bool) -> dict[str, Any]:
    """The fields that both mechanisms share: with ``adapted``, the registers written for biases of a query."""
    return ({"bias_writes_per_query": bias} if adapted else {}) | {
        "rest_steps_instead": rest_steps(network),
        "silent_steps": network.silent_steps,
    }


@dataclass(frozen=True)
class LifReset:
    """Lava's LIFReset, which clears states in the first step of each presentation."""

    def check(self, network: FixedNetwork) -> None:
        """Refuse a network whose presentations cannot be followed by a reset; see `check_reset`."""
        check_reset(network.interval, "network.steps")

    def of(self, network: FixedNetwork, *, adapted: bool = False) -> dict[str, Any]:
        """The mechanism, and what it costs in a query; with ``adapted`` each brings biases, a register a neuron."""
        bias = network.neurons * adapted
        return {
            "mechanism": "LIFReset",
            "what": "Lava's LIFReset sets u and v of exc and inh to 0 in the first step of each presentation",
            "reset_interval": network.interval,
            "reset_offset": 1,
            "writes_per_query": 3 * network.inputs * network.bias_input + bias,
            **_always(network, bias, adapted),
        }


@dataclass(frozen=True)
class EmbeddedWrites:
    """Writes by the chips' embedded processors after the last silent step."""

    def check(self, network: FixedNetwork) -> None:
        """Accept every network: a processor can write after any step."""

    def of(self, network: FixedNetwork, *, adapted: bool = False) -> dict[str, Any]:
        """The mechanism, and what it costs in a query; with ``adapted`` each brings biases, a register a neuron."""
        neurons, inputs = network.neurons, network.inputs * network.bias_input
        bias = neurons * adapted
        return {
            "mechanism": "embedded writes",
            "what": "an embedded processor of each chip writes v = 0 of its exc compartments and of their counters "
            "after the last silent step; currents have no memory, and inhibitory neurons and relays are at 0 by then",
            "exc_writes_per_query": neurons,
            "counter_reads_per_query": neurons,
            "counter_writes_per_query": neurons,
            "input_writes_per_query": 3 * inputs,
            "writes_per_query": 2 * neurons + 3 * inputs + bias,
            **_always(network, bias, adapted),
        }


Clearing = LifReset | EmbeddedWrites


@dataclass(frozen=True)
class Mesh:
    """The mesh of a chip: cores of a tile, and columns and rows of tiles."""

    tile_cores: int
    columns: int
    rows: int


@dataclass(frozen=True)
class Board:
    """A board's limits and mechanisms; numbers are per core unless stated otherwise.

    A limit that is not public is `UNLIMITED`, so that no network is refused for it (`public`).

    Attributes:
        name: The name that ``--target`` takes.
        title: The name for people.
        chip: The name of its chips.
        chips: Chips of the board.
        cores: Neuron cores of a chip.
        mesh: The arrangement of the cores on a chip; None: not public.
        input_limit: Exclusive bound of what one neuron can receive in one step, in weight units.
        memory: How synapses are stored.
        compartments, axons_in, axons_out: Limits.
        profiles, thresholds, formats: Number of different ones that a core can hold.
        weight_bits: Widths that a stored weight can have.
        host_spikes: Spikes that the host can send to one chip in one step.
        input_mode: Default source of input spikes; None: the model's.
        counters: Whether each excitatory neuron has a compartment beside it that counts its spikes, and is read once
            a query; else the vendor's library reads spikes out.
        clearing: The mechanism that returns states to 0 between two queries.
        constants: Energies and times of its operations; None: not public.
    """

    name: str
    title: str
    chip: str
    chips: int
    cores: int
    mesh: Mesh | None
    input_limit: int
    memory: Memory
    compartments: int
    weight_bits: tuple[int, ...]
    input_mode: Literal["injected", "bias"] | None
    counters: bool
    clearing: Clearing
    constants: CostConstants | None
    axons_in: int = UNLIMITED
    axons_out: int = UNLIMITED
    profiles: int = UNLIMITED
    thresholds: int = UNLIMITED
    formats: int = UNLIMITED
    host_spikes: int = UNLIMITED

    def stored_bits(self, network: FixedNetwork) -> int:
        """Bits that a stored weight of ``network`` needs: its magnitude's, and one for a sign."""
        return network.bits + (network.signed or not self.memory.one_sign)

    @property
    def known(self) -> str:
        """Public and non-public facts of a board whose way of storing synapses is not public; else empty."""
        return self.memory.described(self.chips * self.cores, self.compartments)

    def busy(
        self,
        *,
        messages_in: Number = 0.0,
        operations_dense: Number = 0.0,
        operations_sparse: Number = 0.0,
        accesses: Number = 0.0,
        updates: Number = 0.0,
        spikes: Number = 0.0,
        messages_out: Number = 0.0,
    ) -> NDArray[np.float64]:
        """The measure of a core's work in a step by which plans are compared; it is no modelled time.

        Returns:
            Nominal time of these events one after another, in ns; where times are not public, their number.
        """
        arriving = (messages_in, operations_dense, operations_sparse)
        neurons = (accesses, updates, spikes, messages_out)
        if self.constants is None:
            return np.asarray(sum((*arriving, *neurons)), np.float64)
        arrived = self.constants.arrival_nanoseconds("nominal", *arriving)
        return np.asarray(arrived + self.constants.neuron_nanoseconds("nominal", *neurons))

    def as_json(self) -> dict[str, Any]:
        """Limits and mesh by name, as a bundle's manifest has them; None: not public."""
        mesh = ("tile_cores", "columns", "rows")
        return {
            "name": self.name,
            "title": self.title,
            "chips": self.chips,
            "cores": self.cores,
            **{name: None if self.mesh is None else getattr(self.mesh, name) for name in mesh},
            "input_limit": self.input_limit,
            "compartments": self.compartments,
            "axons_in": public(self.axons_in),
            "axons_out": public(self.axons_out),
            "synapse_words": self.memory.words,
            "profiles": public(self.profiles),
            "thresholds": public(self.thresholds),
            "formats": public(self.formats),
            "weight_bits": self.weight_bits,
            "index_bits": self.memory.index_bits,
            "host_spikes": public(self.host_spikes),
            "timed": self.constants is not None,
        }


def public(limit: int) -> int | None:
    """A limit of a board; None if it is not public."""
    return None if limit >= UNLIMITED else limit


BOARDS: Registry[Board] = Registry("board", BackendUnavailableError)
"""Every board by the name that ``--target`` takes."""

KAPOHO_BAY = BOARDS.register(
    Board(
        name="kapoho-bay",
        title="Kapoho Bay (two Loihi 1 chips)",
        chip="Loihi 1",
        chips=loihi.KAPOHO_BAY_CHIPS,
        cores=loihi.LOIHI_1_CORES,
        mesh=Mesh(loihi.TILE_CORES, loihi.MESH_COLUMNS, loihi.MESH_ROWS),
        input_limit=loihi.LOIHI_1_INPUT_LIMIT,
        memory=PackedRows(loihi.CORE_SYNAPSE_WORDS),
        compartments=loihi.CORE_COMPARTMENTS,
        axons_in=loihi.CORE_AXONS,
        axons_out=loihi.CORE_AXONS,
        profiles=loihi.CORE_PROFILES,
        thresholds=loihi.CORE_THRESHOLDS,
        formats=loihi.CORE_FORMATS,
        weight_bits=loihi.LOIHI_1_WEIGHT_BITS,
        host_spikes=loihi.HOST_SPIKES,
        input_mode=None,
        counters=True,
        clearing=EmbeddedWrites(),
        constants=LOIHI_1,
    )
)

LOIHI_2 = BOARDS.register(
    Board(
        name="loihi2",
        title="Loihi 2",
        chip="Loihi 2",
        chips=1,
        cores=loihi.LOIHI_2_CORES,
        mesh=None,
        input_limit=loihi.INPUT_LIMIT,
        memory=ByteBudget(loihi.LOIHI_2_CORE_BYTES, loihi.LOIHI_2_SYNAPSES),
        compartments=loihi.LOIHI_2_COMPARTMENTS,
        weight_bits=tuple(range(1, 9)),
        input_mode="bias",
        counters=False,
        clearing=LifReset(),
        constants=None,
    )
)
