"""The spiking front end as populations and synapses of the general simulator, every neuron in every step.

Used by inputs.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import GeneralNetwork, Population, Synapses, simulate
from lava_vpr.inputs.front_end import COLUMNS, HOLD, FrontEnd

CLOCK, PIXELS, FILTERS, PAIRS, ONSETS, CELLS, POOLS = range(7)
ONCE = {"hold_steps": HOLD}


def stored(source: int, target: int, weights: NDArray[np.int64]) -> Iterator[Synapses]:
    """Synapses of 8 bits, of each sign and of each of two exponents, that add up to ``weights`` (pre, post)."""
    for sign in (1, -1):
        size = np.maximum(sign * weights, 0)
        for part, exponent in ((size & 127, 0), (size >> 7, 7)):
            if part.any():
                mode = "excitatory" if sign > 0 else "inhibitory"
                yield Synapses(source, target, sign * part, exponent=exponent, sign=mode)


def network(spec: FrontEnd, grey: NDArray[np.uint8]) -> GeneralNetwork:
    """The network that is shown grey images (n, rows, columns), one after the other."""
    height, width, grid = spec.height, spec.width, spec.grid
    sites, channels, directions = width // COLUMNS, spec.orientations, spec.directions
    sizes = list(spec.populations.values())
    weights = {
        (CLOCK, CLOCK): np.eye(sizes[CLOCK], k=1, dtype=np.int64),
        (CLOCK, PIXELS): np.zeros((sizes[CLOCK], sizes[PIXELS]), np.int64),
        (CLOCK, FILTERS): np.zeros((sizes[CLOCK], sizes[FILTERS]), np.int64),
        (CLOCK, CELLS): np.zeros((sizes[CLOCK], sizes[CELLS]), np.int64),
        (PIXELS, FILTERS): np.zeros((sizes[PIXELS], sizes[FILTERS]), np.int64),
        (FILTERS, PAIRS): np.zeros((sizes[FILTERS], sizes[PAIRS]), np.int64),
        (PAIRS, ONSETS): np.zeros((sizes[PAIRS], sizes[ONSETS]), np.int64),
        (ONSETS, CELLS): spec.onset_weight * np.eye(sizes[CELLS], dtype=np.int64),
        (CELLS, CELLS): -spec.cell_weight * np.eye(sizes[CELLS], dtype=np.int64),
        (CELLS, POOLS): np.zeros((sizes[CELLS], sizes[POOLS]), np.int64),
        (POOLS, CELLS): np.zeros((sizes[POOLS], sizes[CELLS]), np.int64),
    }
    weights[CLOCK, PIXELS][: spec.levels - 1] = spec.pixel_clock[:, None]
    weights[CLOCK, FILTERS][spec.levels - 1 : spec.levels + spec.race] = spec.filter_clock[:, None]
    weights[CLOCK, CELLS][spec.end - 1] = -spec.silencing
    tall, wide = spec.filters.shape[1:]
    for y, x, k in np.ndindex(height, sites, directions):
        place = (y * sites + x) * directions + k
        for row, column in np.ndindex(tall, wide):
            pixel_y = min(max(y + row - tall // 2, 0), height - 1)
            pixel_x = min(max(COLUMNS * x + column - wide // 2, 0), width - 1)
            weights[PIXELS, FILTERS][pixel_y * width + pixel_x, place] += spec.filters[k, row, column]
        for other in (k - spec.apart, k + spec.apart):
            weights[FILTERS, PAIRS][(y * sites + x) * directions + other % directions, place] = 1
        cell = (y // (height // grid)) * grid + x // (sites // grid)
        weights[PAIRS, ONSETS][place, k % channels * grid * grid + cell] = 1
    for channel, row, column, y, x in np.ndindex(channels, grid, grid, grid, grid):
        cell = (channel * grid + row) * grid + column
        if max(abs(row - y), abs(column - x)) <= spec.reach:
            weights[CELLS, POOLS][cell, y * grid + x] = 1
        if (row, column) == (y, x):
            weights[POOLS, CELLS][y * grid + x, cell] = -spec.silencing
    lasting, steps = {"du": 0}, spec.steps
    first = np.zeros(sizes[CLOCK], np.int64)
    first[0] = 1
    populations = (
        Population(np.zeros(sizes[CLOCK], int), first, 0, LifParameters(**ONCE), steps),
        Population(
            np.full(sizes[PIXELS], spec.pixel_threshold),
            grey.reshape(len(grey), -1).astype(np.int64),
            np.full((len(grey), 1), 6),
            LifParameters(**ONCE),
            steps,
        ),
        Population(np.full(sizes[FILTERS], spec.filter_threshold), 0, 0, LifParameters(**lasting, **ONCE), steps),
        Population(np.ones(sizes[PAIRS], int), 0, 0, LifParameters(**ONCE), steps),
        Population(np.zeros(sizes[ONSETS], int), 0, 0, LifParameters(**ONCE), steps),
        Population(np.full(sizes[CELLS], spec.cell_weight // 2), 0, 0, LifParameters(**lasting, dv=4096), steps),
        Population(spec.budgets.ravel() - 1, 0, 0, LifParameters(**ONCE), steps),
    )
    synapses = (one for (source, target), values in weights.items() for one in stored(source, target, values))
    return GeneralNetwork(1, populations, tuple(synapses))


def spikes(spec: FrontEnd, grey: NDArray[np.uint8]) -> list[NDArray[np.int64]]:
    """How often each neuron spikes, (n, neurons) of each population, in the order of `FrontEnd.populations`."""
    silence = np.zeros((len(grey) * spec.steps, 1), bool)
    run = simulate(network(spec, grey), silence)
    return [film.reshape(len(grey), spec.steps, -1).sum(axis=1) for film in run.spikes]
