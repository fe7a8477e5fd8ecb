"""A presentation as SLAYER computes it: the integers of the deployed network, with gradients.

`spikes` takes an integer network as it is deployed (`lava_vpr.engine.inference.fixed`), input spikes, and the spikes of
its inhibitory neuron, and runs lava-dl's current-based neuron over all steps at once; its spikes are those of the
engine, bit for bit. The inhibitory spikes are the engine's own: what inhibition changes has no gradient, the membrane
has. The weights' gradients pass through rounding as if there were none, and through the same norms and the same mean of
all neurons that deployment takes (`scaled`).

Source: lava-dl 0.6.0, ``slayer/neuron/cuba.py`` and ``slayer/neuron/dynamics/leaky_integrator.py``; Shrestha and
Orchard, SLAYER, NeurIPS 2018.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.biases import schedule, slopes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import TOP_PERCENTILE
from lava_vpr.engine.rates import draw_trains
from lava_vpr.loihi import DECAY_UNITY, INPUT_SHIFT
from lava_vpr.slayer.needs import libraries

Tensor = Any
"""A tensor of torch, which is imported by `libraries` alone."""

UNIT = 1 << INPUT_SHIFT
"""SLAYER counts states in units of 64 weights of 1, so that gradients are of the order of 1."""

STATE_UNIT = UNIT << INPUT_SHIFT
"""Units of its membrane in one unit of its currents."""

_WIDTH, _HEIGHT = 0.01, 10.0
"""lava-dl multiplies the width of its surrogate gradient by 100 and its height by 0.1; these take both back."""


def scaled(weights: Tensor, bits: int, signed: bool) -> Tensor:
    """`lava_vpr.engine.inference.quantise` of ``weights`` (inputs, neurons) before it rounds, with gradients."""
    own = _unit(weights)
    if signed:
        own = _unit(own - own.mean(dim=1, keepdim=True))
    sizes = np.abs(own.detach().numpy())
    largest = float(np.percentile(sizes, TOP_PERCENTILE)) or float(sizes.max()) or 1.0
    return own * (((1 << bits) - 1) / largest)


def _unit(weights: Tensor) -> Tensor:
    """Every column with the Euclidean norm 1."""
    return weights / weights.norm(dim=0, keepdim=True).clamp_min(1e-12)


def input_trains(network: FixedNetwork, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> NDArray[np.float32]:
    """The spikes of inputs as they reach the neurons, float32 (n, interval, inputs)."""
    trains = np.zeros((len(rates), network.interval, network.inputs), np.float32)
    if not network.regular:
        drawn = draw_trains(rates, keys, network.steps, network.steps)
        trains[:, network.input_delay : network.input_delay + network.steps] = drawn
        return trains
    table = slopes()
    for train, image, key in zip(trains, rates, keys, strict=True):
        starts, members = schedule(table[image], key, network.steps)
        train[np.repeat(np.arange(network.steps), np.diff(starts)) + network.input_delay, members] = 1
    return trains


def spikes(
    network: FixedNetwork,
    weights: Tensor,
    trains: NDArray[np.float32],
    inhibitory: NDArray[np.uint8],
    width: float,
) -> Tensor:
    """The excitatory spikes of presentations, (n, neurons, interval).

    Args:
        network: The network as it is deployed.
        weights: `scaled` weights, (inputs, neurons), whose gradient is wanted.
        trains: From `input_trains`.
        inhibitory: Spikes of the root, uint8 (n, interval) (`lava_vpr.engine.inference.counting.inhibitory_spikes`).
        width: How far from the threshold, in thresholds, a membrane still learns.
    """
    torch, (n, steps, inputs) = libraries().torch, trains.shape
    rounded = weights + (torch.from_numpy(network.weights.astype(np.float32)) - weights).detach()
    drive = (torch.from_numpy(trains).reshape(-1, inputs) @ rounded).reshape(n, steps, network.neurons)
    taken = np.zeros((n, steps, 1), np.float32)
    taken[:, 1:, 0] = inhibitory[:, :-1] * np.float32(-network.lateral)
    gained = (network.bias / UNIT).astype(np.float32)
    current = (drive + torch.from_numpy(taken) + torch.from_numpy(gained)) / UNIT
    neuron = spiking(network.threshold / UNIT, network.decay / DECAY_UNITY, width)
    return neuron(current.transpose(1, 2).contiguous())


def spiking(threshold: float, decay: float, width: float) -> Any:
    """lava-dl's neuron, from currents (n, neurons, steps) to spikes; its gradient is 1 at the threshold.

    Args:
        threshold: Its threshold, in units of 4,096 of the membrane.
        decay: Share of the membrane that is lost in a step.
        width: As in `spikes`.
    """
    return libraries().slayer.neuron.cuba.Neuron(
        threshold=threshold,
        current_decay=1.0,
        voltage_decay=decay,
        tau_grad=width * _WIDTH,
        scale_grad=2 * width * threshold * _HEIGHT,
    )
