"""From learned float weights to the integers that Loihi runs."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError
from lava_vpr.loihi import DECAY_BITS, INPUT_LIMIT, LOIHI_1_INPUT_LIMIT, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT

Weight = TypeVar("Weight", np.float32, np.float64)

MEAN_WEIGHT = 0.1
"""Mean that float weights are brought to before they are quantised; `LifNetwork.drive` refers to it."""


FINEST, FINE, COARSE = 256, 32, 16
"""Thresholds in units of the input sum: the largest that is of use, the smallest that fitting Loihi 1 is worth, and the
smallest of all."""


ROUNDING = 0.97
"""Share of the accumulator that unrounded weights may fill."""


def equalise(weights: NDArray[Weight]) -> NDArray[np.float64]:
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


def pruned(weights: NDArray[Weight], share: float) -> NDArray[Weight]:
    """Set the smallest ``share`` of each neuron's weights to 0.

    Args:
        weights: (inputs, neurons), not below 0; a neuron's scale does not matter.
        share: In [0, 1), of all inputs. Of equal weights those of the first inputs go first.
    Raises:
        ConfigError: a share outside that range.
    """
    if not 0 <= share < 1:
        raise ConfigError(f"the share of pruned weights is {share}, but must be in [0, 1); choose a smaller one")
    count = round(share * len(weights))
    if count == 0:
        return weights
    kept = weights.copy()
    np.put_along_axis(kept, np.argsort(weights, axis=0, kind="stable")[:count], 0.0, axis=0)
    return kept


def distinctive(learned: NDArray[np.float32], network: LifNetwork) -> NDArray[np.float64]:
    """Equalised weights of ``learned`` ones (inputs, neurons), without what ``network.common`` and ``prune`` take off.

    Raises:
        ConfigError: no weight is above 0.
    """
    weights = equalise(learned)
    if network.common == 0 and network.prune == 0:
        return weights
    if network.common > 0:
        weights = np.maximum(weights - network.common * weights.mean(axis=1, keepdims=True), 0.0)
        if not weights.any():
            raise ConfigError(
                f"network.common {network.common:g} takes every weight off: all neurons have learned the same; lower it"
            )
    return equalise(pruned(weights, network.prune))


def weight_scale(weights: NDArray[np.float64], bits: int) -> float:
    """Integer units per float weight: the 99.9th percentile of all weights, zeros included, becomes the largest."""
    top = float(np.percentile(weights, 99.9))
    return ((1 << bits) - 1) / (top if top > 0 else float(weights.max()))


def mantissa_of(value: float) -> tuple[int, int]:
    """``value`` as mantissa x 2^exponent of a lateral synapse."""
    exponent = 0
    while round(value / (1 << exponent)) > WEIGHT_LIMIT:
        exponent += 1
    return round(value / (1 << exponent)), exponent


def _first_shift(scale_per_drive: float, threshold: float) -> int:
    """Right shift of the input sum under which the threshold is not finer than is of use."""
    sizes = (threshold * scale_per_drive / (1 << shift) for shift in range(WEIGHT_EXPONENT_LIMIT + 1))
    return next((shift for shift, size in enumerate(sizes) if size <= FINEST), WEIGHT_EXPONENT_LIMIT)


def _shift(scale_per_drive: float, threshold: float, inhibition: float, neurons: int) -> int:
    """Right shift of the input sum: the smallest under which lateral inhibition fits Loihi 1's accumulator.

    Where the threshold would become too coarse for that, the smallest that fits Loihi 2's current; where none fits, the
    largest (`FixedNetwork.check` then refuses the network).
    """
    sizes = [threshold * scale_per_drive / (1 << k) for k in range(WEIGHT_EXPONENT_LIMIT + 1)]
    first = last = _first_shift(scale_per_drive, threshold)
    for limit, least in ((LOIHI_1_INPUT_LIMIT, FINE), (INPUT_LIMIT, COARSE)):
        for shift in range(first, len(sizes)):
            if sizes[shift] < least:
                break
            last = max(last, shift)
            mantissa, exponent = mantissa_of(inhibition * scale_per_drive / (1 << shift))
            if (neurons - 1) * (mantissa << exponent) < limit:
                return shift
    return last


def _largest_unit(inhibition: float, neurons: int) -> float:
    """Units of the input sum per float unit for which all lateral inhibition just fits Loihi 1's accumulator."""
    most = (LOIHI_1_INPUT_LIMIT - 1) // max(1, neurons - 1)
    exponent = max(0, most.bit_length() - WEIGHT_LIMIT.bit_length())
    return (most >> exponent << exponent) / inhibition if inhibition else math.inf


def _scale_and_shift(
    weights: NDArray[np.float64], scale: float, gain: float, threshold: float, inhibition: float, shift: int | None
) -> tuple[float, int]:
    """Integer units per float weight, and the right shift of the input sum.

    Loihi 1 shifts no sums, so without a shift there is one network for both chips: none is taken if inhibition, and all
    inputs at once, fit its accumulator as they are. Where a shift that makes the threshold no finer than is of use does
    not suffice for that, a scale that just fits is better than one more shift, as long as it loses less than the bit
    that the shift would cost.

    Args:
        weights: From `equalise`.
        scale: From `weight_scale`.
        gain: Float drive per input sum.
        threshold, inhibition: In float units.
        shift: None: what is best; else this one.
    """
    neurons, most = weights.shape[1], (LOIHI_1_INPUT_LIMIT - 1) / float(weights.sum(axis=0).max())
    whole = min(_largest_unit(inhibition, neurons) * gain, ROUNDING * most)
    if shift is None and whole >= scale:
        return scale, 0
    right_shift = _first_shift(scale / gain, threshold) if shift is None else shift
    fitting = min(scale, whole * (1 << right_shift))
    if 2 * fitting > scale:
        return fitting, right_shift
    return scale, _shift(scale / gain, threshold, inhibition, neurons) if shift is None else shift


def most_neurons(threshold: float, inhibition: float) -> int:
    """Neurons that one inhibition can serve at the coarsest unit, for a check before anything is learned."""
    lateral = max(1, math.floor(inhibition / threshold * COARSE))
    return (INPUT_LIMIT - 1) // lateral + 1


def quantise(
    weights: NDArray[np.float64],
    network: LifNetwork,
    spikes_per_step: float,
    *,
    joined: bool = False,
    shift: int | None = None,
) -> FixedNetwork:
    """The integer network of equalised ``weights`` (inputs, neurons).

    The unit of the input sum is set by a right shift of its own: bits and unit are two things.

    Args:
        weights: From `equalise`.
        network: Settings in float units.
        spikes_per_step: Expected input spikes per step while answering queries.
        joined: Several stretches under one inhibition: use ``joined_inhibition``.
        shift: Right shift of the input sum (default: what is best); a chip that shifts no sums needs 0.
    Raises:
        NetworkLimitError: the network could overflow (`FixedNetwork.check`).
    """
    bits = network.weight_bits
    scale = weight_scale(weights, bits)
    gain = network.drive / (MEAN_WEIGHT * spikes_per_step)
    inhibition = network.joined_inhibition if joined else network.inhibition
    scale, shift = _scale_and_shift(weights, scale, gain, network.threshold, inhibition, shift)
    unit = scale / gain / (1 << shift)
    mantissa, exponent = mantissa_of(inhibition * unit)
    fixed = FixedNetwork(
        weights=np.clip(np.round(weights * scale), 0, (1 << bits) - 1).astype(np.uint8),
        bits=bits,
        shift=shift,
        threshold=max(1, round(network.threshold * unit)),
        inhibition=mantissa,
        inhibition_exponent=exponent,
        decay=min((1 << DECAY_BITS) - 1, round((1 << DECAY_BITS) / network.tau_membrane)),
        steps=network.steps,
        bias_input=network.input_mode == "bias",
    )
    fixed.check()
    return fixed
