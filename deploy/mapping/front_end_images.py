"""The placed front end as registers and memory of every core, with the tables by which the host addresses them.

Cores have the same content as the place network's (`lava_vpr.deploy.registers.core_images`): a profile and a threshold
for each population, and a row of memory for the synapses of a neuron to one core in one format.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.mapping.front_end import NO_AXONS, PlacedFrontEnd, Rows, Way, placed
from lava_vpr.deploy.registers.core_images import CoreImage, core_registers
from lava_vpr.deploy.registers.synapse_memory import pack
from lava_vpr.deploy.registers.synapses import Formats, SynapseFormat, SynapseRows, index_bits, joined
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import NeuronGroup, populations

Places = Mapping[str, NDArray[np.int32]]
"""Chip, core and compartment of every neuron of each population, int32 (neurons, 3), by name."""


@dataclass(frozen=True)
class FrontEndImages:
    """The front end as it is written to a board: the images of its cores, and the addresses of its neurons."""

    cores: tuple[CoreImage, ...]
    tables: Places


def front_end_images(spec: FrontEnd, board: Board, taken: Sequence[tuple[int, int]]) -> FrontEndImages:
    """Images of the front end on the first cores of ``board`` that are not ``taken``.

    Raises:
        NetworkLimitError: it does not fit there, or events drive its pixels, for which no axons are implemented.
    """
    if spec.window:
        raise NetworkLimitError(NO_AXONS)
    plan, free = placed(spec, board), _free(board, taken)
    exceeded = plan.exceeded(len(taken))
    if exceeded:
        raise NetworkLimitError(exceeded)
    tables = _tables(plan, free)
    rows: dict[tuple[str, int], tuple[SynapseRows, Formats]] = {}
    axons: dict[Way, NDArray[np.int64]] = {}  # the input axon of each source neuron on each core of the target, or -1
    for name, each in plan.populations.items():
        rows |= {(name, core): _rows(plan.rows, name, board, each.starts, core, axons) for core in range(each.cores)}
    images, groups = [], populations(spec)
    for name, each in plan.populations.items():
        out = _axons_out(name, axons, tables, plan)
        for core, (start, size) in enumerate(zip(each.starts, each.sizes, strict=True)):
            chip, number, _ = tables[name][start].tolist()
            words, entries = pack(*rows[name, core])
            own = out[(out[:, 0] >= start) & (out[:, 0] < start + size)] - [start, 0, 0, 0]
            compartments = _compartments(groups[name], name, spec.reading > 0)[start : start + size]
            registers = core_registers([_profile(groups[name])], len(compartments), rows[name, core][1])
            images.append(CoreImage(chip, number, registers, compartments, words, entries, own.astype(np.int32)))
    return FrontEndImages(tuple(images), tables)


def _free(board: Board, taken: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The unused cores of ``board``, by chip and core."""
    every = ((chip, core) for chip in range(board.chips) for core in range(board.cores))
    return [core for core in every if core not in set(taken)]


def _tables(plan: PlacedFrontEnd, free: Sequence[tuple[int, int]]) -> Places:
    """The address of every neuron, with populations on the ``free`` cores one after another."""
    tables, first = {}, 0
    for name, each in plan.populations.items():
        here = np.array(free[first : first + each.cores], np.int32)
        compartments = np.arange(each.neurons) - np.repeat(each.starts, each.sizes)
        tables[name] = np.column_stack([here.repeat(each.sizes, axis=0), compartments]).astype(np.int32)
        first += each.cores
    return tables


def _profile(group: NeuronGroup) -> tuple[int, int, int]:
    """Decays of u and v, and threshold, which is not 0."""
    return group.du, group.dv, max(1, group.threshold)


def _compartments(group: NeuronGroup, name: str, begun: bool) -> NDArray[np.int32]:
    """Profile, threshold register, bias mantissa and exponent of each; the host writes the mantissas of pixels, and, so
    that a presentation is ``begun``, that of the clock."""
    found = np.zeros((group.size, 4), np.int32)
    if group.bias is not None and not (begun and name == "clock"):
        found[:, 2] = group.bias
    found[:, 3] = group.bias_exp
    return found


def _rows(
    ways: Rows,
    name: str,
    board: Board,
    starts: NDArray[np.int64],
    core: int,
    axons: dict[Way, NDArray[np.int64]],
) -> tuple[SynapseRows, Formats]:
    """The rows of a core of the population ``name``, and their formats; their numbers are added to ``axons``."""
    end = starts[core + 1] if core + 1 < len(starts) else None
    formats, parts, many = Formats(), [], 0
    for way, weights in ways.items():
        if way[1] != name:
            continue
        here = csc_matrix(weights[starts[core] : end])
        found = np.flatnonzero(np.diff(here.indptr))
        numbers = axons.setdefault(way, np.full((weights.shape[1], len(starts)), -1))
        numbers[found, core] = many + np.arange(len(found))
        many += len(found)
        parts.append(_stored(here[:, found], way[2], formats, board))
    return joined(parts), formats


def _stored(weights: csc_matrix, exponent: int, formats: Formats, board: Board) -> SynapseRows:
    """A row for each column of ``weights`` (compartments, rows)."""
    weights.sort_indices()
    bits = max(board.weight_bits)
    form = SynapseFormat.of_whole_numbers(bits, index_bits(np.arange(weights.shape[0])))
    number = formats.number(SynapseFormat(bits, form.index_bits, form.exponent + exponent))
    return SynapseRows(
        weights.indptr.astype(np.int64),
        weights.indices.astype(np.int32),
        weights.data.astype(np.int32),
        np.full(weights.shape[1], number, np.uint8),
    )


def _axons_out(
    name: str, axons: Mapping[Way, NDArray[np.int64]], tables: Places, plan: PlacedFrontEnd
) -> NDArray[np.int64]:
    """Source neuron of the population ``name``, and chip, core and input axon of each of its paths, int64 (axons,
    4)."""
    found = [np.zeros((0, 4), np.int64)]
    for (source, target, _), numbers in axons.items():
        if source == name:
            neurons, cores = np.nonzero(numbers >= 0)
            to = tables[target][plan.populations[target].starts[cores], :2]
            found.append(np.column_stack([neurons, to, numbers[neurons, cores]]))
    rows = np.concatenate(found)
    return rows[np.argsort(rows[:, 0], kind="stable")]
