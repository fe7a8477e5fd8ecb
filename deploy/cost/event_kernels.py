"""The kernel of `lava_vpr.deploy.cost.events`: events of every step and core from spikes and routes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

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


@compiled(inline="always")
def _reached(routes: Routes, i: int, arrived: NDArray[np.int64], relayed: NDArray[np.uint8], pulled: bool) -> bool:
    """Whether a stored synapse delivered to neuron ``i``: of inputs that ``arrived``, relays elsewhere, or its own."""
    if pulled:
        return True
    k = routes.exc_core[i]
    if relayed[i] and routes.own_dense[k] and routes.relay_rows[i, k, 0] > 0:
        return True
    for j in arrived:
        if routes.stored[j, i]:
            return True
    return False


@compiled(inline="always")
def _updates(
    routes: Routes,
    membranes_before: NDArray[np.int32],
    membranes: NDArray[np.int32],
    fired: NDArray[np.uint8],
    arrived: NDArray[np.int64],
    relayed: NDArray[np.uint8],
    relays: int,
    inhibited: bool,
    events: Counts,
) -> None:
    """Count the updates of the excitatory neurons in one step.

    A neuron has a reason to be updated if its membrane was not 0, or if the sum that arrived is not 0: then its
    membrane is not 0 afterwards, or it has spiked.

    Args:
        routes: The plan.
        membranes_before, membranes: After the step before, and after this one, (N,).
        fired: Who spiked, (N,).
        arrived: Inputs that spiked in the step before.
        relayed: Whose relays spiked in the step before, (N,).
        relays: The number of those.
        inhibited: Whether a relay's spike takes anything from the others.
        events: Events of this step, (K, kinds).
    """
    for i in range(membranes.size):
        k = routes.exc_core[i]
        if membranes_before[i] != 0 or membranes[i] != 0 or fired[i] != 0:
            events[k, _UPDATES] += 1
            events[k, _TOUCHED] += 1
        elif _reached(routes, i, arrived, relayed, inhibited and relays > relayed[i]):
            events[k, _TOUCHED] += 1


@compiled(inline="always")
def _send(events: Counts, home: int, target: int, operations: Counts, ways: Counts) -> None:
    """Count a message from core to core, and what it meets there."""
    events[home, _OUT] += 1
    for i in range(3):
        events[home, _WAY + i] += ways[home, target, i]
    events[target, _IN] += 1
    events[target, _OPERATIONS] += operations[0]
    events[target, _OPERATIONS + 1] += operations[1]


@compiled(inline="always")
def _neurons_spikes(
    routes: Routes, now_fired: NDArray[np.uint8], last_fired: NDArray[np.uint8], relay_row: Counts, now: Counts
) -> int:
    """Count messages of excitatory spikes, and of relays of those one step ago; returns the number of these relays."""
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


@compiled(inline="always")
def _input_spike(routes: Routes, j: int, now: Counts) -> None:
    """Count the messages of a spike of input ``j``."""
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


@compiled(inline="always")
def _input_updates(routes: Routes, mapped: Counts, stopped: NDArray[np.uint8], now: Counts) -> None:
    """Count updates of input compartments: of all but those without a bias that ``stopped`` at 0."""
    for kind in (_UPDATES, _TOUCHED, _INPUT_UPDATES):
        for k in range(mapped.size):
            now[k, kind] += mapped[k]
        for j in range(stopped.size):
            if stopped[j] and routes.input_core[j] >= 0:
                now[routes.input_core[j], kind] -= 1


@compiled(nogil=True)
def count_presentation(
    routes: Routes,
    inhibited: bool,
    steps: int,
    inputs: NDArray[np.uint8],
    exc: NDArray[np.uint8],
    membranes: NDArray[np.int32],
    events: Counts,
) -> None:
    """Add the events of one presentation to ``events`` (all steps, K, kinds).

    Args:
        routes: The plan.
        inhibited: Whether a relay's spike takes anything from the other neurons.
        steps: Steps with input.
        inputs, exc: Every spike, uint8 (all steps, J or N).
        membranes: After each step, int32 (all steps, N).
    """
    (total, width), neurons, cores = inputs.shape, exc.shape[1], routes.own_dense.size
    relay_row, nobody = np.array([0, 1]), np.zeros(neurons, np.uint8)
    at_rest, no_input = np.zeros(neurons, np.int32), np.zeros(width, np.uint8)
    mapped, arrived, count, relays = np.zeros(cores, np.int64), np.zeros(width, np.int64), 0, 0
    for j in range(width):
        if routes.input_core[j] >= 0:
            mapped[routes.input_core[j]] += 1
    for step in range(total):
        now = events[step]
        relayed = exc[step - 2] if step > 1 else nobody
        before = membranes[step - 1] if step > 0 else at_rest
        _updates(routes, before, membranes[step], exc[step], arrived[:count], relayed, relays, inhibited, now)
        relays = _neurons_spikes(routes, exc[step], exc[step - 1] if step > 0 else nobody, relay_row, now)
        # What spiked in the last step with input stays at 0 without a bias.
        _input_updates(routes, mapped, inputs[steps - 1] if step >= steps else no_input, now)
        count = 0
        for j in range(width):
            if inputs[step, j]:
                arrived[count] = j
                count += 1
                _input_spike(routes, j, now)
