"""NeuroBench's metrics of a network, counted from the spikes of a run.

Definitions: Yik et al., "The NeuroBench framework for benchmarking neuromorphic computing algorithms and systems",
Nature Communications 16:1545 (2025), and where the text leaves it open, the package neurobench 2.3.0
(`benchmarks.neurobench.metrics` compares every figure with it). For this network that means:

* **Layers** are the synapses inputs -> exc (inputs x neurons), exc -> inh (one for each neuron), leaves -> root (one
  for each leaf) and root -> exc (one for each neuron), and the neurons exc and inh. Inputs that integrate a bias are
  neurons, too; so are relays, with one synapse for each injected input. Injected inputs themselves are data.
* **Footprint**: bytes of all weights as stored, of the biases, if any, and of the membranes (int32). Zeros count.
  **Parameters** are these weights and biases.
* **Connection sparsity**: zeros among the weights of all synapses. **Activation sparsity**: one minus spikes per neuron
  and step, over all neurons and steps.
* **Synaptic operations**: every spike, input or not, times its weights that are not 0. Inputs of synapses are 0 or 1,
  so all of these are accumulates, none multiply-accumulates. **Dense**: all weights in every step.
* **Membrane updates**: all neurons in the first step, later those whose membrane changes in a step. A neuron of inh, or
  a relay, that spikes and is reset within one step does not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Workload
from lava_vpr.engine.inference.biases import LEVEL, biases, start_membranes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.membranes import membranes
from lava_vpr.engine.presentations import Trains
from lava_vpr.model import checked_network

QUERIES = 100
"""Most queries that are counted; all of their spikes are kept in memory."""

INT32_BYTES = 4


def workload(queries: QuerySet, trains: Trains | None = None, limit: int = QUERIES) -> Workload:
    """The metrics of a model on the first ``limit`` of ``queries``.

    Args:
        queries: Queries to a model with an integer network, at least one.
        trains: Every spike of at least these queries; None: computed here.
        limit: Most queries.
    Raises:
        ConfigError: the model has no integer network.
    """
    network, first = checked_network(queries.model, "bench"), slice(limit)
    spikes = queries.trains(first) if trains is None else trains.part(first)
    shown = queries.shown.part(first)
    return of_trains(network, spikes, shown.rates, shown.keys)


def of_trains(network: FixedNetwork, trains: Trains, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> Workload:
    """The metrics of a network on given spikes.

    Args:
        network: Any.
        trains: Every spike of all three populations, uint8 (n, interval, width).
        rates: Rates of these presentations, uint16 (n, inputs).
        keys: Keys of these presentations, uint64 (n,).
    """
    if trains.inputs is None or trains.inh is None:
        raise ValueError("trains of the inputs and of inh are needed")
    neurons, inputs, (n, steps, _) = network.neurons, network.inputs, trains.exc.shape
    relays, biases_held = inputs if network.relayed else 0, neurons if network.bias.any() else 0
    weights = inputs * neurons + 2 * neurons + network.leaves + relays
    zeros = int(np.count_nonzero(network.weights == 0)) + (0 if network.lateral else neurons)
    sent = trains.inputs.sum(axis=(0, 1), dtype=np.int64)
    exc, inh = int(trains.exc.sum(dtype=np.int64)), int(trains.inh.sum(dtype=np.int64))
    root = int(trains.inh[:, :, -1].sum(dtype=np.int64))
    effective = int(sent @ np.count_nonzero(network.weights, axis=1)) + exc + inh - root
    effective += (root * neurons if network.lateral else 0) + (int(sent.sum()) if relays else 0)
    spikes = exc + inh + (int(sent.sum()) if network.input_compartments else 0)
    all_neurons = neurons + network.inhibitory + network.input_compartments
    updates = membrane_updates(network, trains.inputs, trains.inh)
    if network.bias_input:
        updates += sum(
            input_updates(own_rates, int(key), network.steps) for own_rates, key in zip(rates, keys, strict=True)
        )
    return Workload(
        footprint_bytes=weights + INT32_BYTES * (biases_held + all_neurons),
        parameters=weights + biases_held,
        connection_sparsity=zeros / weights,
        activation_sparsity=1 - spikes / (n * steps * all_neurons),
        dense_operations=float(steps * weights),
        effective_macs=0.0,
        effective_acs=effective / n,
        membrane_updates=updates / n,
    )


def membrane_updates(network: FixedNetwork, inputs: NDArray[np.uint8], inh: NDArray[np.uint8]) -> int:
    """Membrane updates of exc, inh and relays; see the definition above. Membranes of inh and relays are 0 between
    steps.

    Args:
        network: Any.
        inputs, inh: Every spike of the presentations, uint8 (n, interval, width).
    """
    first, changed = network.neurons + network.inhibitory + (network.inputs if network.relayed else 0), 0
    for arriving, pulling in zip(inputs, inh, strict=True):
        after = membranes(network, arriving, pulling).after
        changed += int(np.count_nonzero(after[1:] != after[:-1])) + first
    return changed


def input_updates(rates: NDArray[np.uint16], key: int, steps: int) -> int:
    """Membrane updates of inputs that integrate a bias, in one presentation; in its silent steps nothing changes.

    Args:
        rates: uint16 (inputs,).
        key: The key of the presentation.
        steps: Steps with input.
    """
    mantissa, exponent = biases(rates)
    bias, v = (mantissa << exponent).astype(np.int64), start_membranes(key, len(rates)).astype(np.int64)
    changed = len(rates)
    for step in range(steps):
        after = v + bias
        after[after > LEVEL] = 0
        changed += int(np.count_nonzero(after != v)) if step else 0
        v = after
    return changed
