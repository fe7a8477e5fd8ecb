"""The kernel of `lava_vpr.deploy.cost.events`: events of every step and core from spikes and routes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

Counts = NDArray[np.int64]

_IN, _FROM_INPUTS, _INJECTED, _OPERATIONS, _UPDATES, _TOUCHED, _SPIKES, _OUT, _READ_OUTS = 0, 1, 2, 3, 5, 6, 7, 8, 9
_WAY, _INPUT_HOPS, _INJECTED_HOPS, _INPUT_UPDATES = 10, 13, 15, 17
KINDS = (
    "messages_in",
    "input_messages",
    "injected_messages",
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
    "injected_hops_east_west",
    "injected_hops_north_south",
    "input_updates",
)
"""What the kernel counts, in the order of the numbers above; see `lava_vpr.deploy.cost.events.EventCounts`."""


class Routes(NamedTuple):
    """A plan as the kernel takes it: N neurons, L leaves, J inputs, K cores.

    Attributes:
        exc_core, listener_core: Core of each neuron, and of the inhibitory neuron that listens to it, (N,).
        counted: Whether a counter beside each neuron counts its spikes; else the vendor's library reads them.
        leaf_core: Core of each leaf, (L,).
        root_core: Core of the root.
        input_core: Core of each input's compartment, (J,); -1: it has none.
        relayed: Whether these compartments relay injected spikes, instead of integrating a bias.
        input_rows: Operations, dense and sparse, of an input's row on each core, (J, K, 2); both 0: no message goes
            there.
        root_rows: The same of the root's row, (K, 2).
        stored: Whether an input's row holds a synapse of a neuron, uint8 (J, N).
        biased: Whether a neuron integrates a bias, uint8 (N,).
        ways: Crossings, and tiles east-west and north-south, from core to core, (K, K, 3).
        entry: Tiles to each core from where spikes are injected, (K, 2).
    """

    exc_core: Counts
    listener_core: Counts
    counted: bool
    leaf_core: Counts
    root_core: int
    input_core: Counts
    relayed: bool
    input_rows: Counts
    root_rows: Counts
    stored: NDArray[np.uint8]
    biased: NDArray[np.uint8]
    ways: Counts
    entry: Counts


@compiled(inline="always")
def _updates(
    routes: Routes,
    membranes_before: NDArray[np.int32],
    membranes: NDArray[np.int32],
    fired: NDArray[np.uint8],
    arrived: NDArray[np.int64],
    pulled: NDArray[np.bool_],
    events: Counts,
) -> None:
    """Count the updates of the excitatory neurons in one step.

    A neuron is updated if it integrates a bias, if its membrane was not 0, or if the sum that arrived is not 0: its
    membrane is then not 0, or it has spiked. It is touched by any synapse delivered to it.

    Args:
        routes: The plan.
        membranes_before, membranes: After the step before, and after this one, (N,).
        fired: Which neurons spiked, (N,).
        arrived: Inputs whose spikes arrive in this step.
        pulled: Cores at which a row of the root arrives, (K,).
        events: Events of this step, (K, kinds).
    """
    for i in range(membranes.size):
        k = routes.exc_core[i]
        if routes.biased[i] or membranes_before[i] != 0 or membranes[i] != 0 or fired[i]:
            events[k, _UPDATES] += 1
            events[k, _TOUCHED] += 1
            continue
        touched = pulled[k]
        for j in arrived:
            if touched:
                break
            touched = routes.stored[j, i] != 0
        if touched:
            events[k, _TOUCHED] += 1


@compiled(inline="always")
def _receive(events: Counts, target: int, operations: Counts) -> None:
    """Count an arriving message and the operations of its row."""
    events[target, _IN] += 1
    events[target, _OPERATIONS] += operations[0]
    events[target, _OPERATIONS + 1] += operations[1]


@compiled(inline="always")
def _send(events: Counts, home: int, target: int, operations: Counts, ways: Counts) -> None:
    """Count a message from core to core and the operations of its row."""
    events[home, _OUT] += 1
    for i in range(3):
        events[home, _WAY + i] += ways[home, target, i]
    _receive(events, target, operations)


@compiled(inline="always")
def _inject(events: Counts, target: int, operations: Counts, entry: Counts) -> None:
    """Count an injected message and the operations of its row."""
    events[target, _FROM_INPUTS] += 1
    events[target, _INJECTED] += 1
    for i in range(2):
        events[target, _INPUT_HOPS + i] += entry[target, i]
        events[target, _INJECTED_HOPS + i] += entry[target, i]
    _receive(events, target, operations)


@compiled(inline="always")
def _fire(events: Counts, home: int) -> None:
    """Count a spike of a neuron without memory, caused by the spike that has just arrived."""
    events[home, _SPIKES] += 1
    events[home, _UPDATES] += 1
    events[home, _TOUCHED] += 1


@compiled(inline="always")
def _count_on(routes: Routes, counting: NDArray[np.bool_], fired: NDArray[np.uint8], now: Counts) -> None:
    """Count the updates of counters that counted a spike before this step (``counting``), since they keep their
    membrane; then add those whose neurons fire now."""
    for i in range(fired.size):
        if counting[i]:
            now[routes.exc_core[i], _UPDATES] += 1
            now[routes.exc_core[i], _TOUCHED] += 1
        counting[i] |= fired[i] != 0


@compiled(inline="always")
def _exc_spikes(routes: Routes, fired: NDArray[np.uint8], single: Counts, now: Counts) -> None:
    """Count the messages of excitatory spikes, to their counters and to the inhibitory neurons that listen."""
    for i in range(fired.size):
        if fired[i]:
            home = routes.exc_core[i]
            now[home, _SPIKES] += 1
            if routes.counted:
                now[home, _READ_OUTS] += 1
                _send(now, home, home, single, routes.ways)
            _send(now, home, routes.listener_core[i], single, routes.ways)


@compiled(inline="always")
def _inhibitory_spikes(
    routes: Routes, fired: NDArray[np.uint8], single: Counts, pulled: NDArray[np.bool_], now: Counts
) -> None:
    """Count spikes of the inhibitory neurons: from leaves to the root, and from the root to the cores with exc
    (``pulled``)."""
    for leaf in range(fired.size - 1):
        if fired[leaf]:
            _fire(now, routes.leaf_core[leaf])
            _send(now, routes.leaf_core[leaf], routes.root_core, single, routes.ways)
    pulled[:] = False
    if fired[fired.size - 1]:
        _fire(now, routes.root_core)
        for k in range(pulled.size):
            if routes.root_rows[k, 0] + routes.root_rows[k, 1] > 0:
                _send(now, routes.root_core, k, routes.root_rows[k], routes.ways)
                pulled[k] = True


@compiled(inline="always")
def _input_spike(routes: Routes, j: int, now: Counts) -> None:
    """Count the messages of a spike of input ``j`` to the cores where it has weights."""
    home = routes.input_core[j]
    for k in range(routes.entry.shape[0]):
        row = routes.input_rows[j, k]
        if row[0] + row[1] == 0:
            continue
        if home < 0:
            _inject(now, k, row, routes.entry)
            continue
        now[k, _FROM_INPUTS] += 1
        for i in range(2):
            now[k, _INPUT_HOPS + i] += routes.ways[home, k, 1 + i]
        _send(now, home, k, row, routes.ways)


@compiled(inline="always")
def _integrating(routes: Routes, mapped: Counts, stopped: NDArray[np.uint8], now: Counts) -> None:
    """Count updates of inputs that integrate a bias: of all but those without one that ``stopped`` at 0."""
    for kind in (_UPDATES, _TOUCHED, _INPUT_UPDATES):
        for k in range(mapped.size):
            now[k, kind] += mapped[k]
        for j in range(stopped.size):
            if stopped[j]:
                now[routes.input_core[j], kind] -= 1


@compiled(nogil=True)
def count_presentation(
    routes: Routes,
    steps: int,
    inputs: NDArray[np.uint8],
    exc: NDArray[np.uint8],
    inh: NDArray[np.uint8],
    membranes: NDArray[np.int32],
    events: Counts,
) -> None:
    """Add the events of one presentation to ``events`` (all steps, K, kinds).

    Args:
        routes: The plan.
        steps: Steps with input.
        inputs, exc, inh: Every spike, uint8 (all steps, J or N or L + 1).
        membranes: After each step, int32 (all steps, N).
    """
    (total, width), cores = inputs.shape, routes.entry.shape[0]
    single, at_rest, no_input = np.array([0, 1]), np.zeros(exc.shape[1], np.int32), np.zeros(width, np.uint8)
    mapped, pulled = np.zeros(cores, np.int64), np.zeros(cores, np.bool_)
    counting = np.zeros(exc.shape[1], np.bool_)
    arrived, count = np.zeros(width, np.int64), 0
    integrating = width > 0 and routes.input_core[0] >= 0 and not routes.relayed
    for j in range(width):
        if integrating:
            mapped[routes.input_core[j]] += 1
    for step in range(total):
        now = events[step]
        before = membranes[step - 1] if step > 0 else at_rest
        _updates(routes, before, membranes[step], exc[step], arrived[:count], pulled, now)
        if routes.counted:
            _count_on(routes, counting, exc[step], now)
        _exc_spikes(routes, exc[step], single, now)
        _inhibitory_spikes(routes, inh[step], single, pulled, now)
        if integrating:
            # A neuron that spiked in the last step with input stays at 0 without a bias.
            _integrating(routes, mapped, inputs[steps - 1] if step >= steps else no_input, now)
        passed = step - 1 if routes.relayed else step
        count = 0
        for j in range(width):
            if routes.relayed and inputs[step, j]:
                _inject(now, routes.input_core[j], single, routes.entry)
            if passed < 0 or not inputs[passed, j]:
                continue
            arrived[count] = j
            count += 1
            if routes.relayed:
                _fire(now, routes.input_core[j])
                now[routes.input_core[j], _INPUT_UPDATES] += 1
            elif integrating:
                now[routes.input_core[j], _SPIKES] += 1
            _input_spike(routes, j, now)
