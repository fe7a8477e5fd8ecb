"""The network that registers and memory of cores hold, read back from them alone."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Plan, PopulationPart
from lava_vpr.deploy.registers.core_images import (
    POPULATIONS,
    CoreImage,
    HostTables,
    core_images,
    host_tables,
    members_of,
)
from lava_vpr.deploy.registers.synapse_memory import stored_rows, unpack
from lava_vpr.deploy.registers.synapses import SynapseFormat
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import LavaVprError, ModelFileError
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, INPUT_SHIFT, WEIGHT_BITS

_UNKNOWN_NEEDS, _UNKNOWN_LOAD = Needs(0, 0, 0, 0, 0, 0, 0), Load(0, 0, 0, 0, 0, 0, 0)
"""What stands in the plan of a core that was read back from registers, which say nothing of it."""


def _parts(tables: HostTables, chip: int, core: int) -> tuple[PopulationPart, ...]:
    """What stands on a core: runs of neurons on consecutive compartments."""
    parts = []
    for name in POPULATIONS:
        table = getattr(tables, name)
        numbers = np.flatnonzero((table[:, :2] == (chip, core)).all(axis=1))
        compartments = table[numbers, 2]
        ends = np.flatnonzero((np.diff(numbers) != 1) | (np.diff(compartments) != 1)) + 1
        for run in np.split(np.arange(numbers.size), ends) if numbers.size else ():
            parts.append(PopulationPart(name, int(numbers[run[0]]), run.size, int(compartments[run[0]])))
    return tuple(parts)


def _input_ways(images: Sequence[CoreImage], tables: HostTables) -> NDArray[np.int32]:
    """Input, chip, core and input axon of every way that an input's spikes take to exc, int32 (ways, 4)."""
    if not len(tables.inputs):
        return tables.injection
    ways = [np.zeros((0, 4), np.int32)]
    for image in images:
        numbers = np.flatnonzero((tables.inputs[:, :2] == (image.chip, image.core)).all(axis=1))
        owner = np.full(len(image.compartments), -1)
        owner[tables.inputs[numbers, 2]] = numbers
        sources = owner[image.axons_out[:, 0]]
        ways.append(np.column_stack([sources, image.axons_out[:, 1:]])[sources >= 0])
    return np.concatenate(ways).astype(np.int32)


def _root_ways(images: Sequence[CoreImage], tables: HostTables) -> NDArray[np.int32]:
    """Chip, core and input axon of every way that the root's spikes take, int32 (ways, 3)."""
    chip, core, compartment = tables.inh[-1]
    ways = [image.axons_out for image in images if (image.chip, image.core) == (chip, core)]
    return np.concatenate([np.zeros((0, 3), np.int32), *(own[own[:, 0] == compartment, 1:] for own in ways)])


class _Ways(NamedTuple):
    """Where spikes to exc go, as `_input_ways` and `_root_ways` have them."""

    of_inputs: NDArray[np.int32]
    of_root: NDArray[np.int32]


class _Found(NamedTuple):
    """What memory holds of a network while it is read: weights int16 (inputs, neurons), biases int32 (neurons,), bits
    of the inputs' and of the root's synapses."""

    weights: NDArray[np.int16]
    bias: NDArray[np.int32]
    weight_bits: set[int]
    inhibition_bits: set[int]


def _read_core(image: CoreImage, parts: tuple[PopulationPart, ...], ways: _Ways, found: _Found) -> CorePlan:
    """Add what a core's compartments and memory hold to ``found``; returns its plan."""
    registers = image.registers["synapseFmt"]
    formats = [None if form is None else SynapseFormat.of(form, image.name) for form in registers]
    dense = np.zeros(len(found.weights), np.bool_)
    core = CorePlan(image.chip, image.core, parts, dense, _UNKNOWN_NEEDS, _UNKNOWN_LOAD)
    named = np.concatenate([np.arange(part.compartment, part.compartment + part.size) for part in parts])
    if not np.array_equal(np.sort(named), np.arange(len(image.compartments))):
        raise ModelFileError(
            f"{image.name}: the host's tables do not name each of its compartments once; deploy the model again"
        )
    neurons, compartments = members_of(core, "exc")
    mantissas, exponents = image.compartments[compartments, 2:].T
    if (abs(mantissas.astype(np.int64)) >> BIAS_BITS).any() or (exponents & ~BIAS_EXPONENT_LIMIT).any():
        raise ModelFileError(f"{image.name}: a bias does not fit its register; deploy the model again")
    found.bias[neurons] = mantissas << exponents
    owner = np.full(len(image.compartments), -1)
    owner[compartments] = neurons
    entries, row_of_axon = stored_rows(image.synapses, image.axons_in, image.name)
    rows = unpack(image.synapses, entries, formats, len(image.compartments), image.name)
    values = rows.currents(formats) >> INPUT_SHIFT
    here = (image.chip, image.core)
    of_inputs = ways.of_inputs[(ways.of_inputs[:, 1:3] == here).all(axis=1)]
    for number, row in zip(of_inputs[:, 0], row_of_axon[of_inputs[:, 3]], strict=True):
        synapses, form = slice(rows.starts[row], rows.starts[row + 1]), formats[rows.formats[row]]
        found.weights[number, owner[rows.compartments[synapses]]] = values[synapses]
        if form is not None:
            dense[number] = form.index_bits == 0
            found.weight_bits.add(form.weight_bits)
    of_root = ways.of_root[(ways.of_root[:, :2] == here).all(axis=1)]
    root_forms = [formats[number] for number in rows.formats[row_of_axon[of_root[:, 2]]]]
    found.inhibition_bits.update(form.weight_bits for form in root_forms if form is not None)
    return core


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
    for name in ("injection", "inputs", "exc", "counters", "inh"):
        if not np.array_equal(getattr(tables, name), getattr(tables_again, name)):
            differences.append(f"the host's table {name}")
    return differences


def network_of(
    images: Sequence[CoreImage], tables: HostTables, scalars: Mapping[str, int], board: Board
) -> FixedNetwork:
    """The network that images hold: weights from memory, biases from compartments; all else as ``scalars`` has it.

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


def outline(scalars: Mapping[str, int]) -> FixedNetwork:
    """The network of ``scalars``, with the numbers of its inputs and neurons, and no weights yet.

    Raises:
        NetworkLimitError: a truth value is none.
    """
    inputs, neurons = scalars["inputs"], scalars["neurons"]
    weights = np.broadcast_to(np.int16(0), (inputs, neurons))  # which takes no memory
    return FixedNetwork.of_scalars(weights, np.broadcast_to(np.int32(0), (neurons,)), scalars)


def _rebuilt(
    images: Sequence[CoreImage], tables: HostTables, scalars: Mapping[str, int], board: Board
) -> tuple[FixedNetwork, tuple[CoreImage, ...], HostTables]:
    """The network with weights and biases from the images, and images and tables made of it again."""
    empty = outline(scalars)
    weights, bias = np.zeros(empty.weights.shape, np.int16), np.zeros(empty.neurons, np.int32)
    found, ways = _Found(weights, bias, set(), set()), _Ways(_input_ways(images, tables), _root_ways(images, tables))
    cores = tuple(_read_core(image, _parts(tables, image.chip, image.core), ways, found) for image in images)
    network = replace(empty, weights=weights, bias=bias)
    network.check()
    fewest = min(bits for bits in board.weight_bits if bits >= board.stored_bits(network))
    bits = max(found.weight_bits, default=fewest)
    of_root = max(found.inhibition_bits, default=WEIGHT_BITS)
    plan = Plan(network, board, cores, bits, of_root, None, 0)
    return network, core_images(plan), host_tables(plan)
