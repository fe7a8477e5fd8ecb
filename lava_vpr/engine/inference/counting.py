"""Spikes and events of presentations: what the integer network counts for every image that it is shown.

`count_spikes` shares the presentations among threads and runs the kernel that suits the network: the compiled one of
leaky neurons, that of networks which hear cells directly, or one step at a time for any other neuron model. Spikes of
the inhibitory neurons follow from those of the excitatory ones (`inhibitory_spikes`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.biases import slopes
from lava_vpr.engine.inference.direct import present_direct
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.fixed_kernels import present
from lava_vpr.engine.inference.stepped import present_stepped
from lava_vpr.engine.presentations import check_presentations, share
from lava_vpr.neurons.models import LIF, NEURONS

EVENTS = (
    *("synaptic_operations", "synaptic_operations_dense", "neuron_updates"),
    *("input_spikes", "exc_spikes", "inh_spikes", "messages", "steps"),
)
"""The events that a run counts; see `named_events`."""


def inhibitory_spikes(network: FixedNetwork, exc: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Spikes of the inhibitory neurons, first the leaves, then the root, computed from those of exc.

    Args:
        network: The network.
        exc: uint8 (n, interval, neurons).
    Returns:
        uint8 (n, interval, inhibitory).
    """
    spikes = np.zeros((*exc.shape[:2], network.inhibitory), np.uint8)
    spikes[:, network.depth :, -1] = exc[:, : -network.depth].any(axis=2)
    for leaf in range(network.leaves):
        spikes[:, 1:, leaf] = exc[:, :-1, leaf * fixed.FAN_IN : (leaf + 1) * fixed.FAN_IN].any(axis=2)
    return spikes


def named_events(network: FixedNetwork, raw: NDArray[np.int64], n: int) -> dict[str, int]:
    """Named events of ``n`` presentations, from what the kernel counts (`fixed_kernels.present`).

    Every excitatory neuron is updated in every step but the first, an inhibitory one when a spike arrives, a relay when
    its input spikes. Every spike of inputs, relays, exc and inh is one message (to one core).
    """
    operations, inputs, exc, leaf_spikes, root_spikes = (int(value) for value in raw)
    inh, relayed = leaf_spikes + root_spikes, inputs if network.relayed else 0
    inhibited = root_spikes * network.neurons
    listened = exc + leaf_spikes  # by leaves and root, or by the root alone
    return {
        "synaptic_operations": operations + relayed + listened + inhibited,
        "synaptic_operations_dense": inputs * network.neurons + relayed + listened + inhibited,
        "neuron_updates": n * network.neurons * (network.interval - 1) + relayed + inh,
        "input_spikes": inputs,
        "exc_spikes": exc,
        "inh_spikes": inh,
        "messages": inputs + relayed + exc + inh,
        "steps": n * network.interval,
    }


def count_spikes(
    network: FixedNetwork,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    *,
    bias: NDArray[np.int32] | None = None,
    threads: int = 1,
    raster: bool = False,
) -> tuple[NDArray[np.int32], dict[str, int], NDArray[np.uint8]]:
    """Present every image to the network.

    Args:
        network: The network, checked (`FixedNetwork.check`).
        rates: Spike probabilities in units of 2^-16, uint16 (n, inputs); bursts where the network hears cells directly.
        keys: One key per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
        bias: Biases of each presentation, int32 (n, neurons), as `check_bias` allows; None: the network's.
        threads: Threads that share the images; the result does not depend on it.
        raster: Also record every excitatory spike.
    Returns:
        Spike counts int32 (n, neurons); events by name, summed; raster uint8 (n, interval, neurons) or empty.
    Raises:
        InputError: rates, keys or biases of another type or shape.
        NetworkLimitError: a bias out of its range.
    """
    check_presentations(rates, keys, np.uint16, network.inputs)
    n = len(rates)
    if bias is not None:
        network.check_presented(bias, n)
    counts = np.zeros((n, network.neurons), np.int32)
    film = np.zeros((n, network.interval, network.neurons) if raster else (0, 0, 0), np.uint8)
    (weights, row_sizes, numbers), narrow = network.prepared, network.narrow
    rates = np.ascontiguousarray(rates)
    table = slopes() if network.regular else np.zeros(0, np.int32)
    own = network.bias[None] if bias is None else np.ascontiguousarray(bias)
    bounded, neurons = network.bounded(own), NEURONS[network.model]

    def present_some(part: slice) -> NDArray[np.int64]:
        events = np.zeros(5, np.int64)
        shown = (rates[part], table, keys[part], own if bias is None else own[part])
        if network.direct:
            acc = np.zeros(weights.shape[1], np.int16 if narrow else np.int32)
            present_direct(weights, row_sizes, numbers, rates[part], shown[-1], acc, counts[part], events, film[part])
        elif neurons is LIF:
            acc = np.zeros(weights.shape[1], np.int16 if narrow else np.int32)
            present(weights, row_sizes, numbers, bounded, *shown, acc, counts[part], events, film[part])
        else:
            present_stepped(neurons, weights, row_sizes, numbers, *shown, counts[part], events, film[part])
        return events

    raw = sum(share(present_some, n, threads), np.zeros(5, np.int64))
    return counts, named_events(network, raw, n), film
