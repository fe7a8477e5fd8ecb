"""The spiking front end as a network: its populations, and every synapse between them.

What Lava's Processes are made of, and what the general simulator runs beside the kernel
(`lava_vpr.inputs.front_end_kernels`); a query needs none of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, identity

from lava_vpr.inputs.front_end import COLUMNS, FrontEnd
from lava_vpr.loihi import BIAS_EXPONENT_LIMIT, INPUT_SHIFT, NO_MEMORY_DECAY, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT

BIAS_EXPONENT = INPUT_SHIFT
"""Exponent of the biases of pixels, whose mantissas are their grey levels."""
ONCE = ("clock", "pixels", "filters", "pairs", "onsets", "pools")
"""Populations whose neurons silence themselves by their first spike."""

Pairs = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
"""Targets, sources and weights of synapses, each of one shape."""


class NeuronGroup(NamedTuple):
    """A population, whose neurons rest at the start of a presentation.

    Attributes:
        size: Number of neurons.
        threshold: Threshold of all.
        bias: Bias mantissas, (size,); None: none, or those of an image (`BIAS_EXPONENT`).
        bias_exp: Their exponent: a bias is mantissa 2^exponent in units of v.
        du, dv: Decays as `lava_vpr.engine.general.lif.LifParameters` has them.
    """

    size: int
    threshold: int
    bias: NDArray[np.int32] | None = None
    bias_exp: int = 0
    du: int = NO_MEMORY_DECAY
    dv: int = 0


class Projection(NamedTuple):
    """Synapses of one sign and one exponent between two populations.

    Attributes:
        source, target: Names of the populations.
        weights: Of 8 bits, int32 (post, pre).
        exponent: A weight counts 2^exponent.
    """

    source: str
    target: str
    weights: csr_matrix
    exponent: int


def populations(spec: FrontEnd) -> dict[str, NeuronGroup]:
    """The populations by name, in the order of `FrontEnd.populations`."""
    sizes = spec.populations
    first = np.zeros(sizes["clock"], np.int32)
    first[0] = 1
    found = {
        "clock": NeuronGroup(sizes["clock"], 0, first, BIAS_EXPONENT_LIMIT),  # above a threshold of 1, too
        "pixels": NeuronGroup(sizes["pixels"], spec.pixel_threshold, bias_exp=BIAS_EXPONENT),
        "filters": NeuronGroup(sizes["filters"], spec.filter_threshold, du=0),
        "pairs": NeuronGroup(sizes["pairs"], spec.needed - 1),
        "onsets": NeuronGroup(sizes["onsets"], 0),
        "cells": NeuronGroup(sizes["cells"], spec.cell_weight // 2, du=0, dv=NO_MEMORY_DECAY),
        "pools": NeuronGroup(sizes["pools"], int(spec.budgets.max()) - 1),
    }
    return found | spec.further_groups()


def synapses(spec: FrontEnd) -> Iterator[Projection]:
    """Every synapse, by source and target; those of weights beyond 8 bits, and of both signs, in parts."""
    for (source, target), weights in all_weights(spec).items():
        for part, exponent in _parts(weights):
            yield Projection(source, target, part, exponent)


def event_synapses(spec: FrontEnd) -> csr_matrix:
    """Weights from the axons of events to pixels, int32 (pixels, axons): one for each axon."""
    rows, columns = (np.arange(n) // spec.axons for n in spec.shape)
    pixels = (rows[:, None] * spec.width + columns).ravel()
    ones, axons = np.ones(len(pixels), np.int32), np.arange(len(pixels))
    return csr_matrix((ones, (pixels, axons)), (spec.populations["pixels"], len(pixels)))


def _parts(weights: csr_matrix) -> Iterator[tuple[csr_matrix, int]]:
    """``weights`` as parts of 8 bits with their exponents, of each sign, which add up to it."""
    for sign in (1, -1):
        size = weights.multiply(sign).maximum(0).astype(np.int32)
        low = size.copy()
        if size.nnz and size.data.max() > WEIGHT_LIMIT:
            low.data &= (1 << WEIGHT_EXPONENT_LIMIT) - 1
            size.data >>= WEIGHT_EXPONENT_LIMIT
        else:
            size.data[:] = 0
        for part, exponent in ((low, 0), (size, WEIGHT_EXPONENT_LIMIT)):
            part.eliminate_zeros()
            if part.nnz:
                yield csr_matrix(part.multiply(sign), dtype=np.int32), exponent


def all_weights(spec: FrontEnd) -> dict[tuple[str, str], csr_matrix]:
    """Weights (post, pre) by source and target, of any size and both signs."""
    sizes = spec.populations
    ends, cells = np.array([spec.end - 1]), np.arange(sizes["cells"])
    begun = spec.window + spec.levels - 1
    levels, race = begun + np.arange(-len(spec.pixel_clock), 0), begun + np.arange(spec.race + 1)
    within, at = _around(spec)
    pools, clock = np.arange(sizes["pools"]), np.arange(sizes["clock"] - 1)
    made: dict[tuple[str, str], Pairs] = {
        ("clock", "clock"): (clock + 1, np.minimum(clock, spec.ticks - 2), np.array([1])),
        ("clock", "pixels"): _ticks(sizes["pixels"], levels, spec.pixel_clock),
        ("clock", "filters"): _ticks(sizes["filters"], race, spec.filter_clock),
        ("clock", "cells"): _ticks(sizes["cells"], ends, np.array([-spec.silencing])),
        ("clock", "pools"): (pools, np.array([0]), spec.budgets.max() - spec.budgets.ravel()),
        ("pixels", "filters"): _seen(spec),
        ("filters", "pairs"): _both(spec),
        ("pairs", "onsets"): _of_a_cell(spec),
        ("onsets", "cells"): (cells, cells, np.array([spec.onset_weight])),
        ("cells", "cells"): (cells, cells, np.array([-spec.cell_weight])),
        ("cells", "pools"): (at, within, np.array([1])),
        ("pools", "cells"): (cells, cells % len(pools), np.array([-spec.silencing])),
    }
    found = {}
    for (source, target), (to, of, weights) in made.items():
        to, of, weights = (each.ravel() for each in np.broadcast_arrays(to, of, weights))
        found[source, target] = csr_matrix((weights, (to, of)), (sizes[target], sizes[source]))
    for name in ONCE:
        own = found.get((name, name), 0)
        found[name, name] = csr_matrix(own - spec.own_silencing * identity(sizes[name], np.int64, "csr"))
    return found | spec.further_weights()


def _ticks(targets: int, ticks: NDArray[np.int64], weights: NDArray[np.int64]) -> Pairs:
    """From the clock's neurons ``ticks`` to every neuron of a population."""
    return np.arange(targets)[:, None], ticks, weights


def _seen(spec: FrontEnd) -> Pairs:
    """From pixels to the filters around; a pixel beyond the edge is the one at the edge."""
    sites, (directions, tall, wide) = spec.width // COLUMNS, spec.filters.shape
    y, x, k, row, column = np.ogrid[: spec.height, :sites, :directions, :tall, :wide]
    from_y = np.clip(y + row - tall // 2, 0, spec.height - 1)
    from_x = np.clip(COLUMNS * x + column - wide // 2, 0, spec.width - 1)
    return (y * sites + x) * directions + k, from_y * spec.width + from_x, spec.filters[k, row, column]


def _both(spec: FrontEnd) -> Pairs:
    """From the filters of a pair: two of each of its sites."""
    pairs, k, site, side = np.ogrid[
        : spec.populations["pairs"] // spec.directions, : spec.directions, : spec.joined, :2
    ]
    others = (k + (2 * side - 1) * spec.apart) % spec.directions
    return pairs * spec.directions + k, (pairs * spec.joined + site) * spec.directions + others, np.array([1])


def _of_a_cell(spec: FrontEnd) -> Pairs:
    """From all pairs of a cell and a channel, of both signs of contrast."""
    pairs = spec.width // (COLUMNS * spec.joined)
    y, x, k = np.ogrid[: spec.height, :pairs, : spec.directions]
    cell = y // (spec.height // spec.grid) * spec.grid + x // (pairs // spec.grid)
    return k % spec.orientations * spec.grid**2 + cell, (y * pairs + x) * spec.directions + k, np.array([1])


def _around(spec: FrontEnd) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cells and the pools that listen to them, (synapses,) each."""
    places = np.arange(spec.grid)
    near = np.abs(places[:, None] - places) <= spec.reach
    of, to = np.nonzero(np.kron(near, near))
    channels = np.arange(spec.orientations)[:, None] * spec.grid**2
    return (channels + of).ravel(), np.tile(to, spec.orientations)
