"""The kernels of `lava_vpr.deploy.registers.simulator`: compartments, axons and rows, whatever network they make."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT, LOIHI_1_INPUT_LIMIT, STATE_LIMIT

EVENTS = (
    "messages_in",
    "operations_dense",
    "operations_sparse",
    "updates",
    "spikes",
    "messages_out",
    "crossings",
    "hops_east_west",
    "hops_north_south",
)
"""What is counted for each core. An update: a compartment with an input, a bias or a state. Crossings are messages to
another chip; hops are tiles, 0 without positions."""

_IN, _OPERATIONS, _UPDATES, _SPIKES, _OUT, _CROSSINGS, _HOPS = 0, 1, 3, 4, 5, 6, 7
_BOUND = LOIHI_1_INPUT_LIMIT << INPUT_SHIFT


class Wiring(NamedTuple):
    """The cores one after another, as the kernel takes them; C compartments, K cores, A input axons, O output axons.

    Attributes:
        first: Compartments of core k are ``first[k]`` to ``first[k + 1] - 1``, (K + 1,).
        keep_u, keep_v, refract: Decays and refractory steps of each compartment, (C,).
        floor, ceiling: Bounds of the membranes of a core, (K,).
        out_start, out_core, out_axon: Output axons by source (C + 1,); core and input axon of each,
            (O,).
        hops: Whether an output axon leaves its chip, and its tiles east-west and north-south, (O, 3).
        row_of: The row of each input axon, (A,).
        row_start, row_target, row_value, row_sparse: The rows' synapses; whether they are sparse.
    """

    first: NDArray[np.int64]
    keep_u: NDArray[np.int64]
    keep_v: NDArray[np.int64]
    refract: NDArray[np.int64]
    floor: NDArray[np.int64]
    ceiling: NDArray[np.int64]
    out_start: NDArray[np.int64]
    out_core: NDArray[np.int64]
    out_axon: NDArray[np.int64]
    hops: NDArray[np.int64]
    row_of: NDArray[np.int64]
    row_start: NDArray[np.int64]
    row_target: NDArray[np.int32]
    row_value: NDArray[np.int32]
    row_sparse: NDArray[np.int64]


class State(NamedTuple):
    """The state of all compartments, (C,): current, membrane, accumulator, refractory steps that are left, bias."""

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
    events: NDArray[np.int64],
    fired: NDArray[np.int64],
) -> tuple[int, int]:
    """Advance all compartments by one step; returns how many ``fired``, and the first that overflows, or -1."""
    u, v, sums, held, bias = state
    n = 0
    for core in range(wiring.first.size - 1):
        low, high, updates = wiring.floor[core], wiring.ceiling[core], 0
        for i in range(wiring.first[core], wiring.first[core + 1]):
            if sums[i] == 0 and u[i] == 0 and v[i] == 0 and bias[i] == 0 and held[i] == 0:
                continue
            if sums[i] >= _BOUND or sums[i] <= -_BOUND:
                return n, i
            current = _decayed(u[i], wiring.keep_u[i])
            if sums[i] != 0 or current != 0 or v[i] != 0 or bias[i] != 0:
                updates += 1
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
                events[core, _SPIKES] += 1
            u[i], v[i] = current, x
        events[core, _UPDATES] += updates
    return n, -1


@compiled(inline="always")
def _deliver(wiring: Wiring, sums: NDArray[np.int64], core: int, axon: int, events: NDArray[np.int64]) -> None:
    """Add the row of the input axon that a spike meets to the accumulators."""
    row = wiring.row_of[axon]
    begin, end = wiring.row_start[row], wiring.row_start[row + 1]
    for s in range(begin, end):
        sums[wiring.row_target[s]] += wiring.row_value[s]
    events[core, _IN] += 1
    events[core, _OPERATIONS + wiring.row_sparse[row]] += end - begin


@compiled(nogil=True)
def present(
    wiring: Wiring,
    state: State,
    threshold: NDArray[np.int64],
    inputs: NDArray[np.int64],
    steps: int,
    sent_start: NDArray[np.int64],
    sent_core: NDArray[np.int64],
    sent_axon: NDArray[np.int64],
    events: NDArray[np.int64],
    film: NDArray[np.uint8],
) -> tuple[int, int]:
    """Run one presentation and fill ``film`` (all steps, C) with its spikes.

    ``inputs``: input compartments whose bias is written to 0 before the silent steps. ``sent_*``: core and input axon
    of what is injected in each step.

    Returns:
        Messages in flight at the end and -1; or how many steps went well, and the compartment that overflowed.
    """
    fired = np.empty(wiring.keep_u.size, np.int64)
    flying = 0
    for step in range(film.shape[0]):
        if step == steps:
            state.bias[inputs] = 0
        n, overflow = update(wiring, state, threshold, events, fired)
        if overflow >= 0:
            return step, overflow
        flying, core = 0, 0
        for i in fired[:n]:
            film[step, i] = 1
            while i >= wiring.first[core + 1]:
                core += 1
            for a in range(wiring.out_start[i], wiring.out_start[i + 1]):
                target = wiring.out_core[a]
                flying += 1
                events[core, _OUT] += 1
                for k in range(3):
                    events[core, _CROSSINGS + k] += wiring.hops[a, k]
                _deliver(wiring, state.sums, target, wiring.out_axon[a], events)
        if step < steps:
            flying += sent_start[step + 1] - sent_start[step]
            for s in range(sent_start[step], sent_start[step + 1]):
                _deliver(wiring, state.sums, sent_core[s], sent_axon[s], events)
    return flying, -1
