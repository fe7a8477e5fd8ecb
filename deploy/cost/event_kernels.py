"""The kernel of `lava_vpr.deploy.cost.events`: events of every step and core from spikes and routes."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT, STATE_LIMIT

Counts = NDArray[np.int64]

_IN, _FROM_INPUTS, _OPERATIONS, _UPDATES, _TOUCHED, _SPIKES, _OUT, _READ_OUTS = 0, 1, 2, 4, 5, 6, 7, 8
_WAY, _INPUT_HOPS, _INPUT_UPDATES = 9, 12, 14
KINDS = (
    "messages_in",
    "input_messages",
    "operations_dense",
    "operations_sparse",
    "updates",
    "touched",
    "spikes",
    "messages_out",
    "read_outs",
    "crossings",
    "hops_east_west",
    "hops_north_south",
    "input_hops_east_west",
    "input_hops_north_south",
    "input_updates",
)
"""What the kernel counts, in the order of the numbers above; see `lava_vpr.deploy.cost.events.EventCounts`."""


class Routes(NamedTuple):
    """A plan as the kernel takes it: N neurons, J inputs, K cores.

    Attributes:
        exc_core, relay_core: Where each neuron and its relay stand, (N,).
        input_core: Where each input stands, (J,); -1: its spikes are injected.
        input_rows, relay_rows: Operations, dense and sparse, of a spike's row on each core, (J or N, K, 2); both 0: no
            message goes there.
        stored: Whether an input's row holds a synapse of a neuron, uint8 (J, N).
        own_dense: Whether the rows of a core's own relays are dense, (K,).
        size: Excitatory neurons of each core, (K,).
        ways: Crossings, and tiles east-west and north-south, from core to core, (K, K, 3).
        entry: Tiles to each core from where spikes are injected, (K, 2).
    """

    exc_core: Counts
    relay_core: Counts
    input_core: Counts
    input_rows: Counts
    relay_rows: Counts
    stored: NDArray[np.uint8]
    own_dense: NDArray[np.bool_]
    size: Counts
    ways: Counts
    entry: Counts


@nb.njit(cache=True, inline="always")
def _reached(routes: Routes, i: int, arrived: NDArray[np.int64], before: NDArray[np.uint8], pulled: bool) -> bool:
    """Whether a stored synapse delivered to neuron ``i``: of inputs that ``arrived``, relays elsewhere, or its own."""
    if pulled:
        return True
    k = routes.exc_core[i]
    if before[i] and routes.own_dense[k] and routes.relay_rows[i, k, 0] > 0:
        return True
    for j in arrived:
        if routes.stored[j, i]:
            return True
    return False


@nb.njit(cache=True, inline="always")
def _membranes(
    routes: Routes,
    v: NDArray[np.int32],
    acc: NDArray[np.int32],
    params: NDArray[np.int64],
    arrived: NDArray[np.int64],
    fired: NDArray[np.uint8],
    before: NDArray[np.uint8],
    spikes_before: int,
    busy: NDArray[np.uint8],
    events: Counts,
) -> int:
    """One step of all excitatory neurons; the first that did not do what ``fired`` says, or -1."""
    shift, keep = np.int32(params[0]), np.int64(params[3])
    threshold, lateral = np.int64(params[1]), np.int32(params[2])
    top, wrong = np.int64(STATE_LIMIT - 1), 0
    for i in range(v.size):
        a = np.int64(acc[i] >> shift) - np.int64(lateral) * (spikes_before - np.int64(before[i]))
        had = np.int64(v[i])
        size = np.int64(abs(had)) * keep >> np.int64(DECAY_BITS)
        x = (size if had >= 0 else -size) + (a << np.int64(INPUT_SHIFT))
        x = min(max(x, -top), top)
        wrong += (x > threshold) != (fired[i] != 0)
        busy[i] = had != 0 or a != 0
        v[i] = np.int32(0 if fired[i] else x)
    for i in range(v.size):
        k = routes.exc_core[i]
        events[k, _UPDATES] += busy[i]
        events[k, _TOUCHED] += busy[i]
        if not busy[i]:
            pulled = lateral != 0 and spikes_before > before[i]
            events[k, _TOUCHED] += _reached(routes, i, arrived, before, pulled)
    return wrong


@nb.njit(cache=True, inline="always")
def _send(events: Counts, home: int, target: int, operations: Counts, ways: Counts) -> None:
    """A message from core to core, and what it meets there."""
    events[home, _OUT] += 1
    for i in range(3):
        events[home, _WAY + i] += ways[home, target, i]
    events[target, _IN] += 1
    events[target, _OPERATIONS] += operations[0]
    events[target, _OPERATIONS + 1] += operations[1]


@nb.njit(cache=True, inline="always")
def _neurons_spikes(
    routes: Routes, now_fired: NDArray[np.uint8], last_fired: NDArray[np.uint8], relay_row: Counts, now: Counts
) -> int:
    """Messages of excitatory spikes, and of the relays of those one step ago; how many these are."""
    relays = 0
    for i in range(now_fired.size):
        if now_fired[i]:
            home = routes.exc_core[i]
            now[home, _SPIKES] += 1
            now[home, _READ_OUTS] += 1
            _send(now, home, routes.relay_core[i], relay_row, routes.ways)
        if last_fired[i]:
            relays += 1
            home = routes.relay_core[i]
            for kind in (_SPIKES, _UPDATES, _TOUCHED):
                now[home, kind] += 1
            for k in range(routes.own_dense.size):
                if routes.relay_rows[i, k, 0] + routes.relay_rows[i, k, 1] > 0:
                    _send(now, home, k, routes.relay_rows[i, k], routes.ways)
    return relays


@nb.njit(cache=True, nogil=True)
def count(
    routes: Routes,
    weights: NDArray[np.uint8],
    params: NDArray[np.int64],
    steps: int,
    inputs: NDArray[np.uint8],
    exc: NDArray[np.uint8],
    events: Counts,
) -> tuple[int, int]:
    """Fills ``events`` (n, all steps, K, kinds); the first query and step that contradict ``exc``, or -1s."""
    (n, total, width), neurons, cores = inputs.shape, exc.shape[2], routes.own_dense.size
    relay_row, silent, busy = np.array([0, 1]), np.zeros(neurons, np.uint8), np.zeros(neurons, np.uint8)
    v, acc, mapped = np.zeros(neurons, np.int32), np.zeros(neurons, np.int32), np.zeros(cores, np.int64)
    arrived = np.zeros(width, np.int64)
    for j in range(width):
        if routes.input_core[j] >= 0:
            mapped[routes.input_core[j]] += 1
    for q in range(n):
        v[:] = 0
        acc[:] = 0
        count, spikes_before = 0, 0
        for step in range(total):
            now = events[q, step]
            before = exc[q, step - 2] if step > 1 else silent
            if _membranes(routes, v, acc, params, arrived[:count], exc[q, step], before, spikes_before, busy, now):
                return q, step
            last = exc[q, step - 1] if step > 0 else silent
            spikes_before = _neurons_spikes(routes, exc[q, step], last, relay_row, now)
            for k in range(cores):
                for kind in (_UPDATES, _TOUCHED, _INPUT_UPDATES):
                    now[k, kind] += mapped[k]
            acc[:] = 0
            count = 0
            for j in range(width):
                if inputs[q, step, j]:
                    arrived[count] = j
                    count += 1
                    for i in range(neurons):
                        acc[i] += np.int32(weights[j, i])
                    _input_spike(routes, j, now)
                # What spiked in the last step with input stays at 0 without a bias.
                if step >= steps and routes.input_core[j] >= 0 and inputs[q, steps - 1, j]:
                    for kind in (_UPDATES, _TOUCHED, _INPUT_UPDATES):
                        now[routes.input_core[j], kind] -= 1
    return -1, -1


@nb.njit(cache=True, inline="always")
def _input_spike(routes: Routes, j: int, now: Counts) -> None:
    """Messages of a spike of input ``j``."""
    home = routes.input_core[j]
    if home >= 0:
        now[home, _SPIKES] += 1
    for k in range(routes.size.size):
        row = routes.input_rows[j, k]
        if row[0] + row[1] == 0:
            continue
        now[k, _FROM_INPUTS] += 1
        if home >= 0:
            _send(now, home, k, row, routes.ways)
            for i in range(2):
                now[k, _INPUT_HOPS + i] += routes.ways[home, k, 1 + i]
        else:
            now[k, _IN] += 1
            for i in range(2):
                now[k, _OPERATIONS + i] += row[i]
                now[k, _INPUT_HOPS + i] += routes.entry[k, i]
