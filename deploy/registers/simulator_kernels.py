"""The kernels of `lava_vpr.deploy.registers.simulator`: compartments, axons and rows of any network."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT, LOIHI_1_INPUT_LIMIT, STATE_LIMIT

_BOUND = LOIHI_1_INPUT_LIMIT << INPUT_SHIFT


class Wiring(NamedTuple):
    """The cores one after another, as the kernel takes them; C compartments, K cores, A input axons, O output axons.

    Attributes:
        first: Compartments of core k are ``first[k]`` to ``first[k + 1] - 1``, (K + 1,).
        keep_u, keep_v, refract: Decays and refractory steps of each compartment, (C,).
        floor, ceiling: Bounds of the membranes of a core, (K,).
        out_start, out_axon: Output axons by source (C + 1,); the input axon of each, (O,).
        row_of: The row of each input axon, (A,).
        row_start, row_target, row_value: The rows' synapses.
    """

    first: NDArray[np.int64]
    keep_u: NDArray[np.int64]
    keep_v: NDArray[np.int64]
    refract: NDArray[np.int64]
    floor: NDArray[np.int64]
    ceiling: NDArray[np.int64]
    out_start: NDArray[np.int64]
    out_axon: NDArray[np.int64]
    row_of: NDArray[np.int64]
    row_start: NDArray[np.int64]
    row_target: NDArray[np.int32]
    row_value: NDArray[np.int32]


class State(NamedTuple):
    """The state of all compartments, (C,): current, membrane, accumulator, remaining refractory steps, bias."""

    u: NDArray[np.int64]
    v: NDArray[np.int64]
    sums: NDArray[np.int64]
    held: NDArray[np.int64]
    bias: NDArray[np.int64]


@compiled(inline="always")
def _decayed(x: int, keep: int) -> int:
    """sign(x) (|x| keep >> 12)."""
    return (x * keep >> DECAY_BITS) if x >= 0 else -(-x * keep >> DECAY_BITS)


@compiled(nogil=True)
def update(
    wiring: Wiring,
    state: State,
    threshold: NDArray[np.int64],
    fired: NDArray[np.int64],
) -> tuple[int, int]:
    """Advance all compartments by one step; returns the number that ``fired``, and the first that overflows, or -1."""
    u, v, sums, held, bias = state
    n = 0
    for core in range(wiring.first.size - 1):
        low, high = wiring.floor[core], wiring.ceiling[core]
        for i in range(wiring.first[core], wiring.first[core + 1]):
            if sums[i] == 0 and u[i] == 0 and v[i] == 0 and bias[i] == 0 and held[i] == 0:
                continue
            if sums[i] >= _BOUND or sums[i] <= -_BOUND:
                return n, i
            current = _decayed(u[i], wiring.keep_u[i])
            current += sums[i]
            sums[i] = 0
            if current > STATE_LIMIT:
                current -= 2 * STATE_LIMIT
            elif current <= -STATE_LIMIT:
                current += 2 * STATE_LIMIT
            x = min(max(_decayed(v[i], wiring.keep_v[i]) + current + bias[i], low), high)
            if held[i] > 0:
                held[i] -= 1
                x = 0
            if x > threshold[i]:
                x = 0
                held[i] = wiring.refract[i] - 1
                fired[n] = i
                n += 1
            u[i], v[i] = current, x
    return n, -1


@compiled(inline="always")
def _deliver(wiring: Wiring, sums: NDArray[np.int64], axon: int) -> None:
    """Add the row of a spike's input axon to the accumulators."""
    row = wiring.row_of[axon]
    for s in range(wiring.row_start[row], wiring.row_start[row + 1]):
        sums[wiring.row_target[s]] += wiring.row_value[s]


@compiled(nogil=True)
def present(
    wiring: Wiring,
    state: State,
    threshold: NDArray[np.int64],
    inputs: NDArray[np.int64],
    steps: int,
    sent_start: NDArray[np.int64],
    sent_axon: NDArray[np.int64],
    film: NDArray[np.uint8],
) -> tuple[int, int]:
    """Run one presentation and fill ``film`` (all steps, C) with its spikes.

    ``inputs``: input compartments whose bias is written to 0 before the silent steps. ``sent_*``: the input axons into
        which spikes are injected in each step.

    Returns:
        Messages in flight at the end, and -1; or the number of steps before an overflow, and the compartment that
        overflowed.
    """
    fired = np.empty(wiring.keep_u.size, np.int64)
    flying = 0
    for step in range(film.shape[0]):
        if step == steps:
            state.bias[inputs] = 0
        n, overflow = update(wiring, state, threshold, fired)
        if overflow >= 0:
            return step, overflow
        flying = 0
        for i in fired[:n]:
            film[step, i] = 1
            for a in range(wiring.out_start[i], wiring.out_start[i + 1]):
                flying += 1
                _deliver(wiring, state.sums, wiring.out_axon[a])
        if step < steps:
            flying += sent_start[step + 1] - sent_start[step]
            for s in range(sent_start[step], sent_start[step + 1]):
                _deliver(wiring, state.sums, sent_axon[s])
    return flying, -1
