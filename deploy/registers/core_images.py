"""A plan as the content of every core's registers and memory, with what the host must know of it, and the way back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import RELAY_THRESHOLD, RELAY_WEIGHT, CorePlan, Load, Needs, Part, Plan, PopulationName
from lava_vpr.deploy.registers.synapse_memory import pack, stored_rows, unpack
from lava_vpr.deploy.registers.synapses import Format, Formats, Rows, index_bits, joined, lateral_synapse
from lava_vpr.engine.inference import bias_input
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import LavaVprError, ModelFileError, NetworkLimitError
from lava_vpr.loihi import (
    CEILING_EXPONENT_LIMIT,
    FLOOR_EXPONENT_LIMIT,
    INPUT_SHIFT,
    LEAST_REFRACTORY_STEPS,
    NO_MEMORY_DECAY,
    UPDATE_GROUP,
    WEIGHT_BITS,
)

POPULATIONS: tuple[PopulationName, ...] = get_args(PopulationName)
READ_OUT = -1
"""Instead of a core: the axon goes to the embedded processor of its chip, to the spike counter of neuron ``axon``."""

_UNKNOWN_NEEDS, _UNKNOWN_LOAD = Needs(0, 0, 0, 0, 0, 0, 0), Load(0, 0, 0, 0, 0, 0, 0)
"""What stands in the plan of a core that was read back from registers, which say nothing of it."""


@dataclass(frozen=True)
class CoreImage:
    """Registers and memory of one core.

    Attributes:
        chip, core: Number of the chip and of its core, from 0.
        registers: Registers of the whole core by NxSDK's names, as JSON has them.
        compartments: Profile, threshold register, bias mantissa and bias exponent of each, int32 (compartments, 4).
        synapses: Memory as `lava_vpr.deploy.registers.synapses` has it, uint64 (words,).
        axons_in: The synapse map: first word, words and synapses of each input axon, int32 (axons, 3).
        axons_out: Source compartment, chip, core (or `READ_OUT`) and input axon there, int32 (axons, 4), by source.
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
    """Where the host finds the network.

    Attributes:
        injection: Input, chip, core and input axon that its spikes are injected into, int32 (axons, 4), by input; empty
            if inputs integrate a bias.
        inputs: Chip, core and compartment of each input, int32 (inputs, 3); empty if its spikes are injected.
        exc, inh: Chip, core and compartment of each neuron and of its relay, int32 (neurons, 3).
    """

    injection: NDArray[np.int32]
    inputs: NDArray[np.int32]
    exc: NDArray[np.int32]
    inh: NDArray[np.int32]


@dataclass(frozen=True)
class _Memory:
    """What a core receives: the rows of its memory, and the input axons that lead to them.

    Attributes:
        rows: The rows of its memory.
        formats: Their synapse formats by number.
        row_of_axon: The row of each input axon, int64 (axons,).
        of_input, of_relay, of_neuron: The input axon of each input, of each relay and of each excitatory neuron (to its
            relay), -1 for none, int64 (inputs,), (neurons,), (neurons,).
    """

    rows: Rows
    formats: list[Format | None]
    row_of_axon: NDArray[np.int64]
    of_input: NDArray[np.int64]
    of_relay: NDArray[np.int64]
    of_neuron: NDArray[np.int64]


def _members(core: CorePlan, population: PopulationName) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the neurons of ``population`` on ``core``, and their compartments."""
    parts = [part for part in core.parts if part.population == population]
    ranges = [(np.arange(p.first, p.first + p.size), np.arange(p.compartment, p.compartment + p.size)) for p in parts]
    empty = np.zeros(0, np.int64)
    return np.concatenate([empty, *(r[0] for r in ranges)]), np.concatenate([empty, *(r[1] for r in ranges)])


def _input_axons(network: FixedNetwork, neurons: NDArray[np.int64]) -> NDArray[np.int64]:
    """The axon of each input on the core that holds ``neurons``, -1 if all its weights there are 0; int64 (inputs,)."""
    active = network.weights[:, neurons].any(axis=1)
    return np.where(active, np.cumsum(active) - 1, -1)


def _memory(plan: Plan, core: CorePlan) -> _Memory:
    """The rows of the memory of ``core``, and the input axons that lead to them.

    Rows stand in this order: of the inputs, ascending; one of all relays elsewhere; of its neurons' relays; to its
    relays.
    """
    network, formats = plan.network, Formats()
    (neurons, compartments), (relays, relay_compartments) = _members(core, "exc"), _members(core, "inh")
    of_input = _input_axons(network, neurons)
    active = of_input >= 0
    form = Format(plan.weight_bits, index_bits(compartments), plan.weight_bits - WEIGHT_BITS, "excitatory")
    parts = [formats.rows(network.weights[active][:, neurons], compartments, core.dense_inputs[active], form)]
    of_axon = [np.arange(active.sum())]
    of_relay, of_neuron = np.full(network.neurons, -1), np.full(network.neurons, -1)
    if network.inhibition and neurons.size:
        magnitude, exponent = lateral_synapse(network, plan.lateral_bits)
        # A relay whose neuron is alone on its core has nobody there to inhibit.
        with_own_row = neurons if neurons.size > 1 else neurons[:0]
        elsewhere = np.delete(np.arange(network.neurons), neurons)
        shared = 1 if elsewhere.size else 0
        inhibited = np.concatenate([np.ones((shared, neurons.size)), (1 - np.eye(neurons.size))[: with_own_row.size]])
        dense = np.full(len(inhibited), core.dense_lateral)
        dense[:shared] = True
        form = Format(plan.lateral_bits, form.index_bits, exponent, "inhibitory")
        parts.append(formats.rows(magnitude * inhibited, compartments, dense, form))
        row_of = np.full(network.neurons, -1)
        row_of[elsewhere] = of_axon[0].size
        row_of[with_own_row] = of_axon[0].size + shared + np.arange(with_own_row.size)
        sources = np.flatnonzero(row_of >= 0)
        of_relay[sources] = of_axon[0].size + np.arange(sources.size)
        of_axon.append(row_of[sources])
    bits = RELAY_WEIGHT.bit_length()
    form = Format(bits, index_bits(relay_compartments), bits - WEIGHT_BITS, "excitatory")
    one_to_one = RELAY_WEIGHT * np.eye(relays.size)
    of_neuron[relays] = sum(axons.size for axons in of_axon) + np.arange(relays.size)
    of_axon.append(sum(len(part.formats) for part in parts) + np.arange(relays.size))
    parts.append(formats.rows(one_to_one, relay_compartments, np.zeros(relays.size, np.bool_), form))
    return _Memory(joined(parts), formats, np.concatenate(of_axon), of_input, of_relay, of_neuron)


def _settings(network: FixedNetwork) -> dict[PopulationName, tuple[int, int]]:
    """decayV and threshold of each population."""
    return {
        "exc": (network.decay, network.threshold),
        "inh": (NO_MEMORY_DECAY, RELAY_THRESHOLD),
        "inputs": (0, bias_input.THRESHOLD),
    }


def _registers(network: FixedNetwork, names: Sequence[PopulationName], size: int, formats: list[Any]) -> dict[str, Any]:
    """A core's registers: one profile and one threshold for each population on it."""
    settings = [_settings(network)[name] for name in names]
    profiles = [
        {
            "decayU": NO_MEMORY_DECAY,
            "decayV": decay,
            "refractDelay": LEAST_REFRACTORY_STEPS,
            "enableNoise": 0,
            "bapAction": 1,
        }
        for decay, _ in settings
    ]
    return {
        "cxProfileCfg": profiles,
        "vthProfileCfg": [{"vth": threshold} for _, threshold in settings],
        "synapseFmt": [None if form is None else form.registers for form in formats],
        "dendriteSharedCfg": {"posVmLimit": CEILING_EXPONENT_LIMIT, "negVmLimit": FLOOR_EXPONENT_LIMIT},
        "numUpdates": {"numUpdates": -(-size // UPDATE_GROUP), "numStdp": 0},
    }


def _axons_out(plan: Plan, core: CorePlan, memories: Sequence[_Memory], relays: NDArray[np.int32]) -> NDArray[np.int32]:
    """Where the spikes of ``core`` go, by source compartment; ``relays`` (neurons, 4): where the relays stand."""
    targets = np.array([(other.chip, other.core) for other in plan.cores], np.int64)
    numbers, compartments = _members(core, "exc")
    to_counter = np.broadcast_to([core.chip, READ_OUT], (numbers.size, 2))
    read_out = np.column_stack([compartments, to_counter, numbers])
    axons_out = [np.column_stack([compartments, relays[numbers]]), read_out]
    senders: tuple[tuple[PopulationName, str], ...] = (("inh", "of_relay"), ("inputs", "of_input"))
    for population, table in senders:
        numbers, compartments = _members(core, population)
        axons = np.stack([getattr(memory, table)[numbers] for memory in memories], axis=1)
        source, target = np.nonzero(axons >= 0)
        axons_out.append(np.column_stack([compartments[source], targets[target], axons[source, target]]))
    rows = np.concatenate(axons_out)
    return rows[np.argsort(rows[:, 0], kind="stable")].astype(np.int32)


def core_images(plan: Plan) -> tuple[CoreImage, ...]:
    """Registers and memory of every core of ``plan``, in its order.

    Raises:
        NetworkLimitError: the network cannot be said in Loihi 1's registers.
    """
    if plan.network.shift:
        raise NetworkLimitError(
            f"Loihi 1 shifts each weight, not their sum by {plan.network.shift} bits; use fewer weight bits"
        )
    if plan.network.decay > NO_MEMORY_DECAY:
        raise NetworkLimitError(
            f"decay {plan.network.decay} does not fit 0..{NO_MEMORY_DECAY}; raise network.tau_membrane"
        )
    memories = [_memory(plan, core) for core in plan.cores]
    relay_locations = locations(plan, "inh")
    axons = np.full(plan.network.neurons, -1, np.int32)
    for memory in memories:
        axons = np.maximum(axons, memory.of_neuron)
    relays = np.column_stack([relay_locations[:, :2], axons])
    images = []
    for core, memory in zip(plan.cores, memories, strict=True):
        members = [(name, _members(core, name)[1]) for name in POPULATIONS]
        present = [name for name, numbers in members if numbers.size]
        compartments = np.zeros((sum(numbers.size for _, numbers in members), 4), np.int32)
        for name, numbers in members:
            if numbers.size:
                compartments[numbers, :2] = present.index(name)
        registers = _registers(plan.network, present, len(compartments), memory.formats)
        words, entries = pack(memory.rows, memory.formats)
        axons_out = _axons_out(plan, core, memories, relays)
        images.append(
            CoreImage(core.chip, core.core, registers, compartments, words, entries[memory.row_of_axon], axons_out)
        )
    return tuple(images)


def locations(plan: Plan, population: PopulationName) -> NDArray[np.int32]:
    """Chip, core and compartment of every neuron of ``population``, int32 (neurons, 3)."""
    rows = [np.zeros((0, 4), np.int64)]
    for core in plan.cores:
        numbers, compartments = _members(core, population)
        where = np.broadcast_to([core.chip, core.core], (numbers.size, 2))
        rows.append(np.column_stack([numbers, where, compartments]))
    table = np.concatenate(rows)
    return table[np.argsort(table[:, 0], kind="stable"), 1:].astype(np.int32)


def host_tables(plan: Plan) -> HostTables:
    """Where the host finds the network of ``plan``."""
    injection = [np.zeros((0, 4), np.int64)]
    for core in plan.cores if not plan.network.bias_input else ():
        axons = _input_axons(plan.network, _members(core, "exc")[0])
        inputs = np.flatnonzero(axons >= 0)
        where = np.broadcast_to([core.chip, core.core], (inputs.size, 2))
        injection.append(np.column_stack([inputs, where, axons[inputs]]))
    table = np.concatenate(injection).astype(np.int32)
    by_input = table[np.argsort(table[:, 0], kind="stable")]
    return HostTables(by_input, *(locations(plan, name) for name in ("inputs", "exc", "inh")))


def _parts(tables: HostTables, chip: int, core: int) -> tuple[Part, ...]:
    """What stands on a core: runs of neurons on consecutive compartments."""
    parts = []
    for name in POPULATIONS:
        table = getattr(tables, name)
        numbers = np.flatnonzero((table[:, :2] == (chip, core)).all(axis=1))
        compartments = table[numbers, 2]
        ends = np.flatnonzero((np.diff(numbers) != 1) | (np.diff(compartments) != 1)) + 1
        for run in np.split(np.arange(numbers.size), ends) if numbers.size else ():
            parts.append(Part(name, int(numbers[run[0]]), run.size, int(compartments[run[0]])))
    return tuple(parts)


def _input_ways(images: Sequence[CoreImage], tables: HostTables) -> NDArray[np.int32]:
    """Input, chip, core and input axon of every way that an input's spikes take, int32 (ways, 4)."""
    ways = [tables.injection]
    for image in images:
        numbers = np.flatnonzero((tables.inputs[:, :2] == (image.chip, image.core)).all(axis=1))
        owner = np.full(len(image.compartments), -1)
        owner[tables.inputs[numbers, 2]] = numbers
        sources = owner[image.axons_out[:, 0]]
        ways.append(np.column_stack([sources, image.axons_out[:, 1:]])[sources >= 0])
    return np.concatenate(ways).astype(np.int32)


def _read_core(
    image: CoreImage, parts: tuple[Part, ...], ways: NDArray[np.int32], weights: NDArray[np.uint8]
) -> tuple[CorePlan, list[int], list[int]]:
    """Fill ``weights`` with what a core's memory holds; its plan, and bits of inputs' and of relays' synapses."""
    registers = image.registers["synapseFmt"]
    formats = [None if form is None else Format.of(form, image.name) for form in registers]
    core = CorePlan(
        image.chip, image.core, parts, np.zeros(len(weights), np.bool_), True, _UNKNOWN_NEEDS, _UNKNOWN_LOAD
    )
    neurons, compartments = _members(core, "exc")
    owner = np.full(len(image.compartments), -1)
    owner[compartments] = neurons
    entries, row_of_axon = stored_rows(image.synapses, image.axons_in, image.name)
    rows = unpack(image.synapses, entries, formats, len(image.compartments), image.name)
    values = rows.currents(formats) >> INPUT_SHIFT
    ways_here = ways[(ways[:, 1:3] == (image.chip, image.core)).all(axis=1)]
    bits = []
    for number, row in zip(ways_here[:, 0], row_of_axon[ways_here[:, 3]], strict=True):
        synapses, form = slice(rows.starts[row], rows.starts[row + 1]), formats[rows.formats[row]]
        weights[number, owner[rows.compartments[synapses]]] = values[synapses]
        if form is not None:
            core.dense_inputs[number] = form.index_bits == 0
            bits.append(form.weight_bits)
    lateral = [form for form in formats if form is not None and form.sign == "inhibitory"]
    core = replace(core, dense_lateral=all(form.index_bits == 0 for form in lateral))
    return core, bits, [form.weight_bits for form in lateral]


def _differences(
    images: Sequence[CoreImage], tables: HostTables, again: Sequence[CoreImage], tables_again: HostTables
) -> list[str]:
    """What of the images and tables differs from those made again, by name."""
    differences = []
    for image, other in zip(images, again, strict=True):
        if json.dumps(image.registers, sort_keys=True) != json.dumps(other.registers, sort_keys=True):
            differences.append(f"registers of {image.name}")
        for name in ("compartments", "synapses", "axons_in", "axons_out"):
            if not np.array_equal(getattr(image, name), getattr(other, name)):
                differences.append(f"{name} of {image.name}")
    for name in ("injection", "inputs", "exc", "inh"):
        if not np.array_equal(getattr(tables, name), getattr(tables_again, name)):
            differences.append(f"the host's table {name}")
    return differences


def network_of(
    images: Sequence[CoreImage], tables: HostTables, scalars: Mapping[str, int], board: Board
) -> FixedNetwork:
    """The network that images hold: weights from memory; all else must be as a network with ``scalars`` has it.

    Args:
        images: Registers and memory of every core.
        tables: Where the network's neurons stand.
        scalars: ``inputs``, ``neurons`` and `lava_vpr.engine.inference.fixed.SCALARS` by name.
        board: Whose cores they are.
    Raises:
        ModelFileError: images, tables and scalars contradict each other.
    """
    images = sorted(images, key=lambda image: (image.chip, image.core))
    try:
        network, again, tables_again = _rebuilt(images, tables, scalars, board)
        different = _differences(images, tables, again, tables_again)
    except ModelFileError:
        raise
    except (LookupError, ValueError, TypeError, OverflowError, LavaVprError) as error:
        raise ModelFileError(f"cores and tables hold no network of ours ({error}); deploy the model again") from None
    if different:
        raise ModelFileError(
            f"{different[0]} contradict{'s' if 'table' in different[0] else ''} the rest of the network; deploy the "
            "model again"
        )
    return network


def _rebuilt(
    images: Sequence[CoreImage], tables: HostTables, scalars: Mapping[str, int], board: Board
) -> tuple[FixedNetwork, tuple[CoreImage, ...], HostTables]:
    """The network with weights from the images' memory, and images and tables made of it again."""
    inputs, neurons = scalars["inputs"], scalars["neurons"]
    sizes = (len(tables.exc), len(tables.inh), len(tables.inputs))
    if sizes != (neurons, neurons, inputs if scalars["regular"] else 0):
        raise ModelFileError(
            f"the host's tables hold {sizes[0]} neurons, {sizes[1]} relays and {sizes[2]} inputs, but the network has "
            f"{neurons} neurons and {inputs} inputs; deploy the model again"
        )
    weights = np.zeros((inputs, neurons), np.uint8)
    ways = _input_ways(images, tables)
    cores, bits, lateral = [], set(), set()
    for image in images:
        core, own_bits, own_lateral = _read_core(image, _parts(tables, image.chip, image.core), ways, weights)
        cores.append(core)
        bits.update(own_bits)
        lateral.update(own_lateral)
    network = FixedNetwork.of_scalars(weights, scalars)
    network.check()
    plan = Plan(
        network, board, tuple(cores), max(bits, default=WEIGHT_BITS), max(lateral, default=WEIGHT_BITS), None, 0
    )
    return network, core_images(plan), host_tables(plan)
