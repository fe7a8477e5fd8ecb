"""A model's integer network as a NIR graph.

    input -> synapses (Affine) -> population.lif (LIF) -> output
                                   |          ^
                                   +-> population.w_rec (Linear)

The population is the excitatory neurons and, behind them, the inhibitory ones, the root last; one step of the recurrent
edge is one step of the chip. All numbers are those of the chip's registers, in units of the membrane v, so that with
forward Euler and the time step that the metadata tell a simulator computes

    v = v (1 - decay / 2^12) + W spikes(t - input delay) + bias + R population(t - 1);   spike if v > v_threshold, v = 0

What NIR cannot say stands in the metadata: see docs/exchange.md.
Source of the nodes' equations: nir 1.0.8, ``nir/ir/neuron.py`` and ``linear.py``.
"""

from __future__ import annotations

import io
import json
from typing import Any

import nir
import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.exchange.drawn import STEP_UNIT, UnfitNetwork, digest, heard
from lava_vpr.exchange.formats import FileOptions
from lava_vpr.loihi import DECAY_UNITY, INPUT_SHIFT
from lava_vpr.model import IntegerModel, checked_content
from lava_vpr.storage import container
from lava_vpr.storage.limits import excess

FORMAT = "lava-vpr network 1"
"""What the metadata of our graphs say that they are."""

UNITS = (
    "weights, biases, thresholds and membranes: units of Loihi's 24-bit membrane v, in which a synapse weight of 1 is "
    "64; tau: seconds, of which time_step is one step"
)
STEP = (
    "v = trunc(v (1 - time_step / tau)) + input + bias, in whole numbers, truncated towards 0; spike if v > "
    "v_threshold, then v = 0 in the same step"
)
PRESENTATION = (
    "all states are 0 at its start; 'steps' steps with input, then silent ones up to 'interval'; an input spike of "
    "step t adds to the membranes in step t + input_delay; spikes of the first 'neurons' outputs are counted"
)
POPULATION = (
    "the first 'neurons' are excitatory, one or more for each place; the others are inhibitory, and the last of "
    "them inhibits every excitatory one"
)


def content(model: IntegerModel, options: FileOptions) -> tuple[bytes, tuple[str, ...]]:
    """The content of a file with the network of ``model``, and what the graph does not say, for people.

    Args:
        model: The model.
        options: Seconds of a step, and whether the file takes along all of the model that the network does not say.
    Raises:
        Unfit: it would be larger than what is read.
    """
    network = model.network
    size = network.neurons + network.inhibitory
    beyond = excess("model_bytes", 4 * size * (size + network.inputs))
    if beyond is not None:
        raise UnfitNetwork(f"would unpack to {beyond}")
    buffer = io.BytesIO()
    nir.write(buffer, graph_of(network, options.time_step, container_of(model) if options.references else None))
    return buffer.getvalue(), (
        f"NIR says nothing of input delays: an input spike reaches the membranes {network.input_delay} step(s) later",
        "NIR has no integers: a simulator that does not truncate the decayed membrane may differ by some spikes",
    )


def container_of(model: IntegerModel) -> bytes:
    """Everything of ``model`` but its network, with the weights that it has learned, as a container."""
    header, arrays = checked_content(model, network=False)
    return container.pack("references", header, {**arrays, "learned": model.learned})


def graph_of(network: FixedNetwork, time_step: float, references: bytes | None = None) -> nir.NIRGraph:
    """The graph of ``network``.

    Args:
        network: The network.
        time_step: Seconds of a step.
        references: What `container_of` made of the model, if the graph is to keep it.
    """
    size = network.neurons + network.inhibitory
    weights = np.zeros((size, network.inputs), np.float32)
    weights[: network.neurons] = network.weights.T
    bias = np.zeros(size, np.float32)
    bias[: network.neurons] = network.bias
    tau = time_step * DECAY_UNITY / network.decay if network.decay else np.inf
    # Without leak a time constant is infinite, which no file should hold; in 10^15 steps no register loses a unit. IF
    # would say the same, but snnTorch 1.0.0 gives it a leak of a tenth.
    tau = min(tau, 1e15 * time_step)
    per_neuron = np.ones(size, np.float64)
    nodes = {
        "input": nir.Input({"input": np.array([network.inputs])}),
        "synapses": nir.Affine(weights * STEP_UNIT, bias),
        "population.lif": nir.LIF(
            tau=per_neuron * tau,
            r=per_neuron * (tau / time_step),
            v_leak=np.zeros(size),
            v_threshold=per_neuron * (network.threshold << INPUT_SHIFT),
            v_reset=np.zeros(size),
        ),
        "population.w_rec": nir.Linear(recurrence(network)),
        "output": nir.Output({"output": np.array([size])}),
    }
    edges = [
        ("input", "synapses"),
        ("synapses", "population.lif"),
        ("population.lif", "population.w_rec"),
        ("population.w_rec", "population.lif"),
        ("population.lif", "output"),
    ]
    return nir.NIRGraph(nodes, edges, metadata=metadata_of(network, time_step, references))


def metadata_of(network: FixedNetwork, time_step: float, references: bytes | None) -> dict[str, Any]:
    """What the nodes cannot say, flat: texts, numbers, and the references as bytes."""
    values: dict[str, Any] = {
        "format": FORMAT,
        "program": f"lava-vpr {__version__}",
        "units": UNITS,
        "step": STEP,
        "presentation": PRESENTATION,
        "population": POPULATION,
        "time_step": time_step,
        "weight_unit": float(STEP_UNIT),
        "neurons": network.neurons,
        "inhibitory": network.inhibitory,
        "steps": network.steps,
        "interval": network.interval,
        "input_delay": network.input_delay,
        "network": json.dumps(network.scalars, sort_keys=True),
        "digest": digest(network),
    }
    if references is not None:
        values["references"] = np.frombuffer(references, np.uint8)
    return values


def recurrence(network: FixedNetwork) -> NDArray[np.float32]:
    """What a spike of each neuron of the population adds to each, float32 (to, from), in units of the membrane.

    A single spike makes an inhibitory neuron fire in the step after: it brings twice the threshold.
    """
    neurons, size = network.neurons, network.neurons + network.inhibitory
    fires = np.float32(2 * (network.threshold << INPUT_SHIFT))
    matrix = np.zeros((size, size), np.float32)
    matrix[:neurons, -1] = -(network.lateral << INPUT_SHIFT)
    matrix[neurons:][heard(neurons, network.inhibitory)] = fires
    return matrix
