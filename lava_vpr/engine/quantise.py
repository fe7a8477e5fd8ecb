"""From learned float weights to the integers that Loihi runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.fixed import FixedNetwork
from lava_vpr.errors import ConfigError
from lava_vpr.loihi import DECAY_BITS, WEIGHT_LIMIT

MEAN_WEIGHT = 0.1
"""Mean that float weights are brought to before they are quantised; `LifNetwork.drive` refers to it."""


def equalise(weights: NDArray[np.float32]) -> NDArray[np.float64]:
    """Give every neuron (column) the same Euclidean norm, and all weights together the mean `MEAN_WEIGHT`.

    Equal norms make neurons comparable under one threshold; this is what recall at high precision hangs on.

    Raises:
        ConfigError: no weight is above 0: nothing was learned.
    """
    scaled = weights.astype(np.float64)
    norms = np.sqrt(np.sum(scaled * scaled, axis=0))
    scaled = np.divide(scaled, norms, out=np.zeros_like(scaled), where=norms > 0)
    mean = scaled.mean()
    if not mean > 0:
        raise ConfigError("all weights are 0: nothing was learned; check learning.eta and the reference images")
    return scaled * (MEAN_WEIGHT / mean)


def weight_scale(weights: NDArray[np.float64], bits: int) -> float:
    """Integer units per float weight: the 99.9th percentile of all weights, zeros included, becomes the largest."""
    top = float(np.percentile(weights, 99.9))
    return ((1 << bits) - 1) / (top if top > 0 else float(weights.max()))


def quantise(
    weights: NDArray[np.float64], network: LifNetwork, spikes_per_step: float, *, joined: bool = False
) -> FixedNetwork:
    """The integer network of equalised ``weights`` (inputs, neurons).

    The input sum is shifted right by max(0, bits - 3), so that threshold and inhibition keep about the same size (87 to
    99) at every weight width.

    Args:
        weights: From `equalise`.
        network: Settings in float units.
        spikes_per_step: Expected input spikes per step while answering queries.
        joined: Several stretches under one inhibition: use ``joined_inhibition``.
    Raises:
        NetworkLimitError: the network could overflow (`FixedNetwork.check`).
    """
    bits = network.weight_bits
    shift = max(0, bits - 3)
    scale = weight_scale(weights, bits)
    gain = network.drive / (MEAN_WEIGHT * spikes_per_step)
    unit = scale / gain / (1 << shift)
    lateral = (network.joined_inhibition if joined else network.inhibition) * unit
    exponent = 0
    while round(lateral / (1 << exponent)) > WEIGHT_LIMIT:
        exponent += 1
    fixed = FixedNetwork(
        weights=np.clip(np.round(weights * scale), 0, (1 << bits) - 1).astype(np.uint8),
        bits=bits,
        shift=shift,
        threshold=max(1, round(network.threshold * unit)),
        inhibition=round(lateral / (1 << exponent)),
        inhibition_exponent=exponent,
        decay=round((1 << DECAY_BITS) / network.tau_membrane),
        steps=network.steps,
    )
    fixed.check()
    return fixed
