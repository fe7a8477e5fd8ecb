"""A plan as registers and memory of every core, with the tables by which the host addresses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.plan import (
    COUNTER_THRESHOLD,
    COUNTER_WEIGHT,
    RELAY_THRESHOLD,
    RELAY_WEIGHT,
    CorePlan,
    Plan,
    PopulationName,
)
from lava_vpr.deploy.registers.synapse_memory import pack
from lava_vpr.deploy.registers.synapses import Formats, SynapseFormat, SynapseRows, index_bits, joined, lateral_synapse
from lava_vpr.engine.inference import biases, fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import (
    CEILING_EXPONENT_LIMIT,
    FLOOR_EXPONENT_LIMIT,
    INPUT_SHIFT,
    LEAST_REFRACTORY_STEPS,
    NO_MEMORY_DECAY,
    UPDATE_GROUP,
)

POPULATIONS: tuple[PopulationName, ...] = get_args(PopulationName)
COUNTER_UNIT = COUNTER_WEIGHT << INPUT_SHIFT
"""What a spike of a neuron adds to the membrane of its counter, in units of v."""


@dataclass(frozen=True)
class CoreImage:
    """Registers and memory of one core.

    Attributes:
        chip, core: Number of the chip and of its core, from 0.
        registers: Registers of the whole core by NxSDK's names, as JSON has them.
        compartments: Profile, threshold register, bias mantissa and bias exponent of each, int32 (compartments, 4).
        synapses: Memory as `lava_vpr.deploy.registers.synapses` has it, uint64 (words,).
        axons_in: The synapse map: first word, words and synapses of each input axon, int32 (axons, 3).
        axons_out: Source compartment, chip, core and input axon there, int32 (axons, 4), by source.
    """

    chip: int
    core: int
    registers: dict[str, Any] = field(repr=False)
    compartments: NDArray[np.int32] = field(repr=False)
    synapses: NDArray[np.uint64] = field(repr=False)
    axons_in: NDArray[np.int32] = field(repr=False)
    axons_out: NDArray[np.int32] = field(repr=False)

    @property
    def name(self) -> str:
        """The core's name in messages."""
        return f"chip {self.chip} core {self.core}"


@dataclass(frozen=True)
class HostTables:
    """The addresses of the network for the host.

    Attributes:
        injection: Input, chip, core and input axon that its spikes are injected into, int32 (axons, 4), by input: to
            every core with a weight of that input, or to its relay; empty if inputs integrate a bias.
        inputs: Chip, core and compartment of each input's bias or relay, int32 (inputs, 3); empty if there are none.
        exc, counters, inh: Chip, core and compartment of each excitatory neuron, of its counter, and of each inhibitory
            neuron, int32 (neurons, 3).
    """

    injection: NDArray[np.int32]
    inputs: NDArray[np.int32]
    exc: NDArray[np.int32]
    counters: NDArray[np.int32]
    inh: NDArray[np.int32]


class _Axons(NamedTuple):
    """The input axons of a core by source, numbered in the order of their rows in memory; -1 where there is none.

    Attributes:
        of_input: Of each input, to exc, int64 (inputs,).
        of_root: Of the inhibitory root, to exc, int64 (1,).
        of_counted: Of each excitatory neuron, to its counter, int64 (neurons,).
        of_neuron, of_leaf: Of each excitatory neuron and each leaf, to the inhibitory neuron here that listens to it,
            int64 (neurons,), (leaves,).
        of_relay: Of each input, to its relay, int64 (inputs,).
    """

    of_input: NDArray[np.int64]
    of_root: NDArray[np.int64]
    of_counted: NDArray[np.int64]
    of_neuron: NDArray[np.int64]
    of_leaf: NDArray[np.int64]
    of_relay: NDArray[np.int64]


def members_of(core: CorePlan, population: PopulationName) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the neurons of ``population`` on ``core``, and their compartments."""
    parts = [part for part in core.parts if part.population == population]
    ranges = [(np.arange(p.first, p.first + p.size), np.arange(p.compartment, p.compartment + p.size)) for p in parts]
    empty = np.zeros(0, np.int64)
    return np.concatenate([empty, *(r[0] for r in ranges)]), np.concatenate([empty, *(r[1] for r in ranges)])


def listening(network: FixedNetwork) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The inhibitory neuron that listens to each excitatory one, int64 (neurons,), and to each leaf, (leaves,)."""
    root, leaves = network.inhibitory - 1, network.leaves
    first = np.arange(network.neurons) // fixed.FAN_IN if leaves else np.full(network.neurons, root)
    return first, np.full(leaves, root)


def _axons(network: FixedNetwork, core: CorePlan) -> _Axons:
    """The input axons of ``core``."""
    neurons, counted, inh, inputs = (members_of(core, name)[0] for name in POPULATIONS)
    # First whom the leaves listen to, leaf after leaf, or the root if it listens itself; then the leaves.
    heard, heard_leaves = (np.isin(listener, inh) for listener in listening(network))
    present = (
        network.weights[:, neurons].any(axis=1),
        np.array([network.inhibition > 0 and neurons.size > 0]),
        np.isin(np.arange(network.neurons), counted),
        heard,
        heard_leaves,
        np.isin(np.arange(network.inputs), inputs if network.relayed else inputs[:0]),
    )
    every, ends = np.concatenate(present), np.cumsum([mask.size for mask in present])
    return _Axons(*np.split(np.where(every, np.cumsum(every) - 1, -1), ends[:-1]))


def _rows(plan: Plan, core: CorePlan, axons: _Axons) -> tuple[SynapseRows, list[SynapseFormat | None]]:
    """The rows of the memory of ``core``, one for each of its ``axons``, and their synapse formats by number."""
    network, formats = plan.network, Formats()
    neurons, compartments = members_of(core, "exc")
    active = axons.of_input >= 0
    index = index_bits(compartments)
    form = SynapseFormat.of_whole_numbers(plan.weight_bits, index)
    parts = [formats.rows(network.weights[active][:, neurons], compartments, core.dense_inputs[active], form)]
    if axons.of_root[0] >= 0:
        taken, exponent = lateral_synapse(network, plan.inhibition_bits)
        form = SynapseFormat(plan.inhibition_bits, index, exponent)
        parts.append(formats.rows(np.full((1, neurons.size), taken), compartments, np.zeros(1, np.bool_), form))
    counted, of_counters = members_of(core, "counters")
    bits = plan.single_bits
    parts.append(_single(formats, of_counters, np.arange(counted.size), bits, COUNTER_WEIGHT))
    inh, of_inh = members_of(core, "inh")
    heard = [listener[np.isin(listener, inh)] for listener in listening(network)]
    parts.append(_single(formats, of_inh, np.searchsorted(inh, np.concatenate(heard)), bits))
    relays, of_relays = members_of(core, "inputs")
    parts.append(_single(formats, of_relays, np.arange(relays.size if network.relayed else 0), bits))
    return joined(parts), formats


def _single(
    formats: Formats, compartments: NDArray[np.int64], targets: NDArray[np.int64], bits: int, weight: int = RELAY_WEIGHT
) -> SynapseRows:
    """Rows of one synapse of ``bits`` bits, which adds ``weight`` to ``compartments[target]``."""
    form = SynapseFormat.of_whole_numbers(bits, index_bits(compartments))
    ones = np.full((targets.size, 1), weight)
    rows = formats.rows(ones, np.zeros(1, np.int64), np.zeros(targets.size, np.bool_), form)
    return replace(rows, compartments=compartments[targets].astype(np.int32))


def _registers(
    network: FixedNetwork, names: Sequence[PopulationName], size: int, formats: Sequence[SynapseFormat | None]
) -> dict[str, Any]:
    """The registers of a core: one profile and one threshold for each population on it."""
    of_population: dict[PopulationName, tuple[int, int]] = {  # decayV and threshold
        "exc": (network.decay, network.threshold),
        "counters": (0, COUNTER_THRESHOLD),
        "inh": (NO_MEMORY_DECAY, RELAY_THRESHOLD),
        "inputs": (NO_MEMORY_DECAY, RELAY_THRESHOLD) if network.relayed else (0, biases.THRESHOLD),
    }
    return core_registers([(NO_MEMORY_DECAY, *of_population[name]) for name in names], size, formats)


def core_registers(
    profiles: Sequence[tuple[int, int, int]], size: int, formats: Sequence[SynapseFormat | None]
) -> dict[str, Any]:
    """The registers of a core of ``size`` compartments, from decayU, decayV and threshold of each profile."""
    return {
        "cxProfileCfg": [
            {
                "decayU": decay_u,
                "decayV": decay_v,
                "refractDelay": LEAST_REFRACTORY_STEPS,
                "enableNoise": 0,
                "bapAction": 1,
            }
            for decay_u, decay_v, _ in profiles
        ],
        "vthProfileCfg": [{"vth": threshold} for _, _, threshold in profiles],
        "synapseFmt": [None if form is None else form.registers for form in formats],
        "dendriteSharedCfg": {"posVmLimit": CEILING_EXPONENT_LIMIT, "negVmLimit": FLOOR_EXPONENT_LIMIT},
        "numUpdates": {"numUpdates": -(-size // UPDATE_GROUP), "numStdp": 0},
    }


def _axons_out(plan: Plan, core: CorePlan, axons: Sequence[_Axons]) -> NDArray[np.int32]:
    """The output axons of ``core``, by source compartment; ``axons``: the input axons of all cores."""
    targets = np.array([(other.chip, other.core) for other in plan.cores], np.int64)
    to_inputs = np.stack([own.of_input for own in axons])
    to_neurons = np.stack([own.of_neuron for own in axons])
    to_counters = np.stack([own.of_counted for own in axons])
    to_inh = np.full((len(axons), plan.network.inhibitory), -1)
    to_inh[:, :-1] = np.stack([own.of_leaf for own in axons])
    to_inh[:, -1] = [own.of_root[0] for own in axons]
    found = []
    tables: tuple[tuple[PopulationName, NDArray[np.int64]], ...]
    tables = (("exc", to_neurons), ("exc", to_counters), ("inh", to_inh), ("inputs", to_inputs))
    for population, table in tables:
        members, places = members_of(core, population)
        source, target = np.nonzero(table.T[members] >= 0)
        found.append(np.column_stack([places[source], targets[target], table[target, members[source]]]))
    rows = np.concatenate(found)
    return rows[np.argsort(rows[:, 0], kind="stable")].astype(np.int32)


def core_images(plan: Plan) -> tuple[CoreImage, ...]:
    """Registers and memory of every core of ``plan``, in its order.

    Raises:
        NetworkLimitError: Loihi 1's registers cannot hold the network.
    """
    if plan.network.decay > NO_MEMORY_DECAY:
        raise NetworkLimitError(
            f"decay {plan.network.decay} does not fit 0..{NO_MEMORY_DECAY}; raise network.tau_membrane"
        )
    axons = [_axons(plan.network, core) for core in plan.cores]
    mantissas, exponent = plan.network.bias_registers
    images = []
    for core, own in zip(plan.cores, axons, strict=True):
        members = [(name, members_of(core, name)[1]) for name in POPULATIONS]
        present = [name for name, numbers in members if numbers.size]
        compartments = np.zeros((sum(numbers.size for _, numbers in members), 4), np.int32)
        for name, numbers in members:
            if numbers.size:
                compartments[numbers, :2] = present.index(name)
        neurons, places = members_of(core, "exc")
        compartments[places, 2], compartments[places, 3] = mantissas[neurons], exponent
        rows, formats = _rows(plan, core, own)
        registers = _registers(plan.network, present, len(compartments), formats)
        words, entries = pack(rows, formats)
        axons_out = _axons_out(plan, core, axons)
        images.append(CoreImage(core.chip, core.core, registers, compartments, words, entries, axons_out))
    return tuple(images)


def locations(plan: Plan, population: PopulationName) -> NDArray[np.int32]:
    """Chip, core and compartment of every neuron of ``population``, int32 (neurons, 3)."""
    rows = [np.zeros((0, 4), np.int64)]
    for core in plan.cores:
        numbers, compartments = members_of(core, population)
        where = np.broadcast_to([core.chip, core.core], (numbers.size, 2))
        rows.append(np.column_stack([numbers, where, compartments]))
    table = np.concatenate(rows)
    return table[np.argsort(table[:, 0], kind="stable"), 1:].astype(np.int32)


def host_tables(plan: Plan) -> HostTables:
    """The addresses of the network of ``plan`` for the host."""
    network, injection = plan.network, [np.zeros((0, 4), np.int64)]
    for core in plan.cores if not network.bias_input else ():
        axons = _axons(network, core)
        into = axons.of_relay if network.relayed else axons.of_input
        inputs = np.flatnonzero(into >= 0)
        where = np.broadcast_to([core.chip, core.core], (inputs.size, 2))
        injection.append(np.column_stack([inputs, where, into[inputs]]))
    table = np.concatenate(injection).astype(np.int32)
    by_input = table[np.argsort(table[:, 0], kind="stable")]
    return HostTables(by_input, *(locations(plan, name) for name in ("inputs", "exc", "counters", "inh")))
