"""From learned float weights to the integers that Loihi runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.fixed import FixedNetwork
from lava_vpr.errors import ConfigError
from lava_vpr.loihi import DECAY_BITS, INPUT_LIMIT, LOIHI_1_INPUT_LIMIT, WEIGHT_LIMIT

MEAN_WEIGHT = 0.1
"""Mean that float weights are brought to before they are quantised; `LifNetwork.drive` refers to it."""


THRESHOLDS = (32, 256)
"""Smallest and largest threshold, in units of the input sum: below is too coarse, above adds nothing."""


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


def _unit(scale_per_drive: float, threshold: float, inhibition: float, neurons: int) -> tuple[int, float]:
    """Right shift of the input sum, and units of the shifted sum per float unit.

    The smallest shift under which lateral inhibition of all neurons fits Loihi 1's accumulator; where the threshold
    would become too coarse, Loihi 2's. (If neither fits, `FixedNetwork.check` refuses the network.)
    """
    lowest, highest = THRESHOLDS
    first = 0
    while threshold * scale_per_drive / (1 << first) > highest:
        first += 1
    for limit in (LOIHI_1_INPUT_LIMIT, INPUT_LIMIT):
        for shift in range(first, first + 4):
            unit = scale_per_drive / (1 << shift)
            if threshold * unit >= lowest and (neurons - 1) * (inhibition * unit + 1) < limit:
                return shift, unit
    return first, scale_per_drive / (1 << first)


def quantise(
    weights: NDArray[np.float64], network: LifNetwork, spikes_per_step: float, *, joined: bool = False
) -> FixedNetwork:
    """The integer network of equalised ``weights`` (inputs, neurons).

    The unit of the input sum is set by a right shift of its own: bits and unit are two things.

    Args:
        weights: From `equalise`.
        network: Settings in float units.
        spikes_per_step: Expected input spikes per step while answering queries.
        joined: Several stretches under one inhibition: use ``joined_inhibition``.
    Raises:
        NetworkLimitError: the network could overflow (`FixedNetwork.check`).
    """
    bits, neurons = network.weight_bits, weights.shape[1]
    scale = weight_scale(weights, bits)
    gain = network.drive / (MEAN_WEIGHT * spikes_per_step)
    inhibition = network.joined_inhibition if joined else network.inhibition
    shift, unit = _unit(scale / gain, network.threshold, inhibition, neurons)
    exponent = 0
    while round(inhibition * unit / (1 << exponent)) > WEIGHT_LIMIT:
        exponent += 1
    fixed = FixedNetwork(
        weights=np.clip(np.round(weights * scale), 0, (1 << bits) - 1).astype(np.uint8),
        bits=bits,
        shift=shift,
        threshold=max(1, round(network.threshold * unit)),
        inhibition=round(inhibition * unit / (1 << exponent)),
        inhibition_exponent=exponent,
        decay=round((1 << DECAY_BITS) / network.tau_membrane),
        steps=network.steps,
    )
    fixed.check()
    return fixed
