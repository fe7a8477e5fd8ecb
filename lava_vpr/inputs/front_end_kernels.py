"""The compiled kernel of the spiking front end: every spike that decides a cell's, in the arithmetic of Loihi.

Currents shrink as `lava_vpr.engine.general.lif` has it where a decay register is 0: by 2^-12 in each step, rounded up.
Of neurons that spike once it keeps the step, `NEVER` if there is none.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY

NEVER = np.int32(1 << 20)

Raced: TypeAlias = "tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]"
"""Spikes of the cells, int32 (orientations, grid, grid); of all pixels, filters, pairs, onsets, cells and pools
together, int64 (6,); the steps in which onsets spike, shaped as the cells; and those after the pools'
spikes, (grid, grid)."""


class RaceNumbers(NamedTuple):
    """A front end as the kernel reads it; see `lava_vpr.inputs.front_end.FrontEnd`.

    Attributes:
        filters: Weights in units of u, int32 (rows, columns, directions).
        pixel_steps: The step in which a pixel of each grey level spikes, (256,).
        levels: Steps in which pixels spike.
        clock: What the clock adds to the filters' currents in each step from ``levels`` on, in units of u.
        threshold: That of filters, in units of v.
        budgets: Spikes at which each pool spikes, (grid, grid).
        apart: Directions between a pair and either of its filters.
        reach: Cells to each side that a pool listens to.
        most: Most spikes of a cell.
        columns: One of so many columns of pixels has filters.
        joined: Sites side by side whose filters a pair hears.
        needed: Spikes of these that it needs.
    """

    filters: NDArray[np.int32]
    pixel_steps: NDArray[np.int64]
    levels: int
    clock: NDArray[np.int32]
    threshold: np.int32
    budgets: NDArray[np.int64]
    apart: int
    reach: int
    most: int
    columns: int
    joined: int
    needed: int


def lasting(current: int) -> int:
    """What is left of a current after a step where its decay register is 0, in units of u."""
    kept = abs(current) * (DECAY_UNITY - 1) >> DECAY_BITS
    return kept if current > 0 else -kept


@compiled(nogil=True)
def _in_turn(grey: NDArray[np.uint8], numbers: RaceNumbers) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels in the order of their spikes: row and column of each, (n, 2), and where each step's begin, (levels + 1,).

    Those of the edge stand for the pixels beyond it, too, as far as filters reach.
    """
    height, width = grey.shape
    up, left = numbers.filters.shape[0] // 2, numbers.filters.shape[1] // 2
    steps = np.empty((height + 2 * up, width + 2 * left), np.int64)
    begins = np.zeros(numbers.levels + 1, np.int64)
    for y in range(steps.shape[0]):
        for x in range(steps.shape[1]):
            level = grey[min(max(y - up, 0), height - 1), min(max(x - left, 0), width - 1)]
            steps[y, x] = numbers.pixel_steps[level]
            begins[steps[y, x] + 1] += 1
    begins = np.cumsum(begins)
    order, filled = np.empty((steps.size, 2), np.int64), begins.copy()
    for y in range(steps.shape[0]):
        for x in range(steps.shape[1]):
            order[filled[steps[y, x]]] = y - up, x - left
            filled[steps[y, x]] += 1
    return order, begins


@compiled(nogil=True)
def _shrunk(currents: NDArray[np.int32]) -> None:
    """Currents a step later: what `lasting` says, of all."""
    for k in range(currents.size):
        x = currents[k]
        lost = (abs(x) + np.int32(DECAY_UNITY - 1)) >> np.int32(DECAY_BITS)
        currents[k] = x - lost if x > 0 else x + lost


@compiled(nogil=True)
def _arrived(y: int, x: int, numbers: RaceNumbers, currents: NDArray[np.int32]) -> None:
    """A pixel's spike reaches the filters around, whose currents are (rows, columns, directions)."""
    tall, wide, directions = numbers.filters.shape
    for row in range(tall):
        to = y + tall // 2 - row
        if to < 0 or to >= currents.shape[0]:
            continue
        for column in range(wide):
            at = x + wide // 2 - column
            if at < 0 or at >= currents.shape[1] * numbers.columns or at % numbers.columns:
                continue
            target, weights = currents[to, at // numbers.columns], numbers.filters[row, column]
            for k in range(directions):
                target[k] += weights[k]


@compiled(nogil=True)
def _filter_steps(grey: NDArray[np.uint8], numbers: RaceNumbers) -> NDArray[np.int32]:
    """The step in which each filter spikes, int32 (rows, columns, directions)."""
    shape = grey.shape[0], grey.shape[1] // numbers.columns, numbers.filters.shape[2]
    order, begins = _in_turn(grey, numbers)
    currents, membranes = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    found = np.full(shape, NEVER, np.int32)
    u, v, steps = currents.reshape(-1), membranes.reshape(-1), found.reshape(-1)
    for step in range(1, numbers.levels + numbers.clock.size - 1):
        _shrunk(u)
        if step <= numbers.levels:
            for n in range(begins[step - 1], begins[step]):
                _arrived(order[n, 0], order[n, 1], numbers, currents)
        risen = numbers.clock[step - numbers.levels] if step >= numbers.levels else np.int32(0)
        for k in range(u.size):
            u[k] += risen
            v[k] += u[k]
            steps[k] = step if v[k] > numbers.threshold and steps[k] == NEVER else steps[k]
    return found


@compiled(nogil=True)
def pair_steps(times: NDArray[np.int32], numbers: RaceNumbers) -> NDArray[np.int32]:
    """The step in which each pair has the spikes that it needs, int32 (rows, pairs of a row, directions).

    Args:
        times: The step in which each filter spikes, int32 (rows, columns, directions).
        numbers: The front end.
    """
    height, sites, directions = times.shape
    found = np.empty((height, sites // numbers.joined, directions), np.int32)
    first = np.empty(numbers.needed + 1, np.int32)  # the earliest of those heard so far, in order
    for y in range(height):
        for x in range(found.shape[1]):
            for k in range(directions):
                first[:] = NEVER
                for n in range(2 * numbers.joined):
                    side = numbers.apart if n % 2 else directions - numbers.apart
                    step, rank = times[y, x * numbers.joined + n // 2, (k + side) % directions], numbers.needed
                    while rank > 0 and first[rank - 1] > step:
                        first[rank] = first[rank - 1]
                        rank -= 1
                    first[rank] = step
                found[y, x, k] = first[numbers.needed - 1]
    return found


@compiled(nogil=True)
def raced(times: NDArray[np.int32], numbers: RaceNumbers) -> Raced:
    """What becomes of the filters' spikes.

    Args:
        times: The step in which each filter spikes, int32 (rows, columns, directions).
        numbers: The front end.
    """
    height, sites, directions = times.shape
    grid, channels = len(numbers.budgets), directions // 2
    pairs = pair_steps(times, numbers)
    tall, wide = height // grid, pairs.shape[1] // grid
    first = np.full((channels, grid, grid), NEVER, np.int32)
    spikes = np.zeros(6, np.int64)
    spikes[0] = height * sites * numbers.columns
    spikes[1], spikes[2] = (times < NEVER).sum(), (pairs < NEVER).sum()
    for y in range(height):
        for x in range(pairs.shape[1]):
            for k in range(directions):
                if pairs[y, x, k] < NEVER:
                    channel, row, column = k % channels, y // tall, x // wide
                    first[channel, row, column] = min(first[channel, row, column], pairs[y, x, k] + 2)
    counts = np.zeros((channels, grid, grid), np.int32)
    heard, silent = np.zeros((grid, grid), np.int64), np.full((grid, grid), NEVER, np.int32)
    new, reach = np.zeros((grid, grid), np.int64), numbers.reach
    end = numbers.levels + numbers.clock.size - 1 + 3
    for step in range(numbers.levels, end + 1):
        for row in range(grid):  # what cells spiked in the step before arrives
            for column in range(grid):
                if new[row, column]:
                    for to in range(max(row - reach, 0), min(row + reach + 1, grid)):
                        for at in range(max(column - reach, 0), min(column + reach + 1, grid)):
                            heard[to, at] += new[row, column]
        for row in range(grid):
            for column in range(grid):
                if silent[row, column] == NEVER and heard[row, column] >= numbers.budgets[row, column]:
                    silent[row, column] = step + 1
                    spikes[5] += 1
                new[row, column] = 0
                for channel in range(channels):
                    begun = first[channel, row, column]
                    spikes[3] += begun == step
                    if begun < step < min(silent[row, column], end) and counts[channel, row, column] < numbers.most:
                        counts[channel, row, column] += 1
                        new[row, column] += 1
                spikes[4] += new[row, column]
    return counts, spikes, first, silent


@compiled(nogil=True)
def counted(grey: NDArray[np.uint8], numbers: RaceNumbers) -> tuple[NDArray[np.int32], Raced]:
    """The step in which each filter that sees an image, uint8 (rows, columns), spikes, int32 (rows, columns,
    directions), and what becomes of these spikes."""
    times = _filter_steps(grey, numbers)
    return times, raced(times, numbers)
