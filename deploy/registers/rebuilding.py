"""The network read back from registers and memory of cores only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Plan, PopulationPart
from lava_vpr.deploy.registers.core_images import POPULATIONS, CoreImage, HostTables, members_of
from lava_vpr.deploy.registers.synapse_memory import stored_rows, unpack
from lava_vpr.deploy.registers.synapses import SynapseFormat
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ModelFileError
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, INPUT_SHIFT, WEIGHT_BITS

_UNKNOWN_NEEDS, _UNKNOWN_LOAD = Needs(0, 0, 0, 0, 0, 0, 0), Load(0, 0, 0, 0, 0, 0, 0)
"""Placeholders in the plan of a core read back from registers, which do not hold its needs and load."""


def _parts(tables: HostTables, chip: int, core: int) -> tuple[PopulationPart, ...]:
    """The parts on a core: runs of neurons on consecutive compartments."""
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
    """Input, chip, core and input axon of every path of an input's spikes to exc, int32 (paths, 4)."""
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
    """Chip, core and input axon of every path of the root's spikes, int32 (paths, 3)."""
    chip, core, compartment = tables.inh[-1]
    ways = [image.axons_out for image in images if (image.chip, image.core) == (chip, core)]
    return np.concatenate([np.zeros((0, 3), np.int32), *(own[own[:, 0] == compartment, 1:] for own in ways)])


class _Found(NamedTuple):
    """The parts of a network read so far: weights int16 (inputs, neurons), biases int32 (neurons,), bits of the inputs'
    and of the root's synapses."""

    weights: NDArray[np.int16]
    bias: NDArray[np.int32]
    weight_bits: set[int]
    inhibition_bits: set[int]


def _read_core(
    image: CoreImage,
    parts: tuple[PopulationPart, ...],
    input_ways: NDArray[np.int32],
    root_ways: NDArray[np.int32],
    found: _Found,
) -> CorePlan:
    """Add the content of a core's compartments and memory to ``found``; returns the core's plan."""
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
    of_inputs = input_ways[(input_ways[:, 1:3] == here).all(axis=1)]
    for number, row in zip(of_inputs[:, 0], row_of_axon[of_inputs[:, 3]], strict=True):
        synapses, form = slice(rows.starts[row], rows.starts[row + 1]), formats[rows.formats[row]]
        found.weights[number, owner[rows.compartments[synapses]]] = values[synapses]
        if form is not None:
            dense[number] = form.index_bits == 0
            found.weight_bits.add(form.weight_bits)
    of_root = root_ways[(root_ways[:, :2] == here).all(axis=1)]
    root_forms = [formats[number] for number in rows.formats[row_of_axon[of_root[:, 2]]]]
    found.inhibition_bits.update(form.weight_bits for form in root_forms if form is not None)
    return core


def outline(scalars: Mapping[str, int]) -> FixedNetwork:
    """The network of ``scalars``, with the numbers of its inputs and neurons, and no weights yet.

    Raises:
        NetworkLimitError: a truth value is neither 0 nor 1.
    """
    inputs, neurons = scalars["inputs"], scalars["neurons"]
    weights = np.broadcast_to(np.int16(0), (inputs, neurons))  # which takes no memory
    return FixedNetwork.of_scalars(weights, np.broadcast_to(np.int32(0), (neurons,)), scalars)


def rebuilt_plan(images: Sequence[CoreImage], tables: HostTables, scalars: Mapping[str, int], board: Board) -> Plan:
    """The plan of the network in ``images``: weights from memory, biases from compartments, everything else from
    ``scalars``. Images and tables are valid if this plan gives the same ones.

    Args:
        images: Registers and memory of every core, by chip and core.
        tables: The addresses of the network's neurons.
        scalars: ``inputs``, ``neurons`` and `lava_vpr.engine.inference.fixed.SCALARS` by name.
        board: The board of these cores.
    Raises:
        ModelFileError, NetworkLimitError, LookupError, ValueError, TypeError, OverflowError: the content is no network.
    """
    empty = outline(scalars)
    weights, bias = np.zeros(empty.weights.shape, np.int16), np.zeros(empty.neurons, np.int32)
    found, ways = _Found(weights, bias, set(), set()), (_input_ways(images, tables), _root_ways(images, tables))
    cores = tuple(_read_core(image, _parts(tables, image.chip, image.core), *ways, found) for image in images)
    network = replace(empty, weights=weights, bias=bias)
    network.check()
    fewest = min(bits for bits in board.weight_bits if bits >= board.stored_bits(network))
    bits = max(found.weight_bits, default=fewest)
    of_root = max(found.inhibition_bits, default=WEIGHT_BITS)
    return Plan(network, board, cores, bits, of_root, None, 0)
