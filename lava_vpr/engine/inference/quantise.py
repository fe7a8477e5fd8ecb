"""Quantisation: learned float weights become the integers that Loihi runs.

Thresholds and inhibition are multiples of the drive that a neuron gets from its own place (`own_drives`), so that they
mean the same for any number of input spikes, bits or neurons. All sums of integers are exact: equal weights and
references give equal networks on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.fixed import FixedNetwork, silent_steps
from lava_vpr.engine.inference.surroundings import Shown, surroundings
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import (
    BIAS_BITS,
    BIAS_EXPONENT_LIMIT,
    DECAY_BITS,
    INPUT_SHIFT,
    NO_MEMORY_DECAY,
    SIGNED_WEIGHT_LIMIT,
)

Weight = TypeVar("Weight", np.float32, np.float64)

TOP_PERCENTILE = 99.9
"""Percentile of the magnitudes of all weights, zeros included, that becomes the largest integer weight."""

RISE = 0.1
"""What the clock adds in a step of reading where neurons hear cells directly, in thresholds."""

RATE_UNIT = 1 << 16
"""Rates are in units of 1 / RATE_UNIT spikes a step."""


def unit_norm(weights: NDArray[Weight]) -> NDArray[np.float64]:
    """Scale every neuron (column) to the Euclidean norm 1; a column of zeros stays zero.

    Equal norms make neurons comparable under one threshold; recall at high precision depends on this.
    """
    scaled = weights.astype(np.float64)
    norms = np.sqrt(np.sum(scaled * scaled, axis=0))
    return np.divide(scaled, norms, out=np.zeros_like(scaled), where=norms > 0)


def pruned(weights: NDArray[Weight], share: float) -> NDArray[Weight]:
    """Set the smallest ``share`` of each neuron's weights to 0, by magnitude.

    Args:
        weights: (inputs, neurons); a neuron's scale does not matter.
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
    np.put_along_axis(kept, np.argsort(np.abs(weights), axis=0, kind="stable")[:count], 0.0, axis=0)
    return kept


def distinctive(learned: NDArray[np.float32], network: LifNetwork, shown: Sequence[Shown] = ()) -> NDArray[np.float64]:
    """Weights of norm 1 from ``learned`` ones (inputs, neurons), as ``network.signed`` and ``prune`` ask.

    Signed weights are what a neuron learned minus the mean of all neurons' weights of norm 1, or minus what it shares
    with its surroundings.

    Args:
        learned: Float weights.
        network: Settings.
        shown: As in `quantise`; not used where ``network.surroundings`` is 0.
    Raises:
        ConfigError: nothing was learned, all neurons have learned the same, or pruning leaves nothing of it.
    """
    weights = unit_norm(learned)
    if not weights.any():
        raise ConfigError("all weights are 0: nothing was learned; check learning.eta and the reference images")
    if network.signed:
        learning = weights.any(axis=0)
        common = weights[:, learning].mean(axis=1, keepdims=True)
        if network.surroundings:
            parts = [surroundings(weights[:, part.neurons], common, network.surroundings, part) for part in shown]
            common = np.concatenate(parts, axis=1)[:, learning]
        weights[:, learning] -= common
        weights[np.abs(weights) < 1e-12] = 0.0  # the rest that rounding leaves of equal weights
        if not weights.any():
            raise ConfigError(
                "all neurons have learned the same, and signed weights hold differences; show other places"
            )
        weights = unit_norm(weights)
    kept = unit_norm(pruned(weights, network.prune))
    if not kept.any():
        raise ConfigError(f"pruning {network.prune} of every neuron's weights leaves none; lower network.prune")
    return kept


def mantissa_of(value: float, most: int = SIGNED_WEIGHT_LIMIT) -> tuple[int, int]:
    """``value`` as mantissa x 2^exponent of a lateral synapse, with the least exponent.

    Args:
        value: At least 0.
        most: The largest mantissa: by default that of a synapse which holds its sign, as every board stores it.
    """
    exponent = 0
    while round(value / (1 << exponent)) > most:
        exponent += 1
    return round(value / (1 << exponent)), exponent


def integer_weights(weights: NDArray[np.float64], bits: int) -> NDArray[np.int16]:
    """``weights`` (inputs, neurons) scaled so that the `TOP_PERCENTILE` of their magnitudes becomes 2^bits - 1; larger
    ones are clipped."""
    top, sizes = (1 << bits) - 1, np.abs(weights)
    largest = float(np.percentile(sizes, TOP_PERCENTILE)) or float(sizes.max())
    return np.clip(np.round(weights * (top / largest)), -top, top).astype(np.int16)


def mean_drives(weights: NDArray[np.int16], shown: Sequence[Shown]) -> NDArray[np.float64]:
    """Each neuron's mean drive over all references, in weight units a step, float64 (neurons,)."""
    total = np.sum([part.rates.sum(axis=0, dtype=np.int64) for part in shown], axis=0, dtype=np.int64)
    images = sum(len(part.rates) for part in shown)
    # Whole numbers far below 2^53: their float products and sums are exact, in any order.
    return np.asarray((total.astype(np.float64) @ weights.astype(np.float64)) / (images * RATE_UNIT))


def own_drives(weights: NDArray[np.int16], shown: Sequence[Shown]) -> NDArray[np.float64]:
    """The largest drive that each neuron gets from any reference of its stretch, in units of `mean_drives`."""
    best = np.zeros(weights.shape[1])
    for part in shown:
        drives = part.rates.astype(np.float64) @ weights[:, part.neurons].astype(np.float64)
        best[part.neurons] = drives.max(axis=0, initial=-np.inf)
    return best / RATE_UNIT


def biases_of(drives: NDArray[np.float64], highest: int) -> NDArray[np.int32]:
    """Biases in units of v that subtract ``drives`` (..., neurons), as registers hold them, none above ``highest``."""
    most = ((1 << BIAS_BITS) - 1) << BIAS_EXPONENT_LIMIT
    wanted = np.clip(np.round(-drives * (1 << INPUT_SHIFT)), -most, min(most, highest))
    return held_biases(wanted.astype(np.int64))


def subtracting(network: FixedNetwork, drives: NDArray[np.float64]) -> NDArray[np.int32]:
    """Biases of ``network`` that subtract ``drives`` (..., neurons), in weight units a step; see `biases_of`."""
    return biases_of(drives * network.bias_steps, network.safe_bias)


def check_steps(network: LifNetwork, neurons: int) -> int:
    """The silent steps of a presentation to ``neurons`` neurons.

    Raises:
        ConfigError: the presentation has no other steps.
    """
    silent = silent_steps(neurons, network.input_mode == "bias")
    if network.steps <= silent:
        raise ConfigError(
            f"network.steps is {network.steps}, but {neurons:,} neurons need {silent} silent ones; raise it"
        )
    return silent


def quantise(
    weights: NDArray[np.float64], network: LifNetwork, shown: Sequence[Shown], encoder: EncoderConfig | None = None
) -> FixedNetwork:
    """The integer network of ``weights`` (inputs, neurons) from `distinctive`.

    Args:
        weights: Of norm 1.
        network: Settings.
        shown: The references, stretch after stretch; together they hold all neurons.
        encoder: Settings of the inputs, cells that neurons may hear directly: then rates are
            `lava_vpr.engine.inference.direct.strengths`; None: inputs have rates.
    Raises:
        ConfigError: no reference drives its neuron more than the others do, or a presentation would have silent steps
            only.
        NetworkLimitError: the network could overflow (`FixedNetwork.check`).
    """
    integers, neurons = integer_weights(weights, network.weight_bits), weights.shape[1]
    drives = mean_drives(integers, shown) if network.signed else np.zeros(neurons)
    learned = integers.any(axis=0)
    unit = float((own_drives(integers, shown) - drives)[learned].mean()) if learned.any() else 0.0
    if not unit > 0:
        raise ConfigError(
            "no neuron is driven by its own place: all reference images are alike, as far as inputs see them, or "
            "learning.eta is too small; give images of different places"
        )
    if encoder is None or encoder.direct is None:
        fixed = scaled(network, integers, unit)
    else:
        fixed = heard_directly(network, integers, unit, encoder, encoder.direct)
    fixed = replace(fixed, bias=subtracting(fixed, drives))
    fixed.check()
    return fixed


def heard_directly(
    network: LifNetwork, weights: NDArray[np.int16], unit: float, encoder: EncoderConfig, front_end: FrontEnd
) -> FixedNetwork:
    """The integer network, without biases, of neurons that hear the cells of ``front_end`` themselves.

    What a burst brings stays, so that membranes need not keep it. From the end of the race on the clock adds `RISE`
    thresholds in each step, until the most driven neurons spike; then the root takes its share from all, and so on.

    Args:
        network: Settings of the weights.
        weights: Integer weights, int16 (inputs, neurons).
        unit: Drive of a neuron by an image of its own place, in units of the weights, over `BURST_STEPS` steps.
        encoder: Settings of reading; the threshold is a multiple of ``unit``.
        front_end: The front end.
    """
    threshold = encoder.read_threshold * unit
    mantissa, exponent = mantissa_of(encoder.read_inhibition * threshold)
    return FixedNetwork(
        weights=weights,
        bias=np.zeros(weights.shape[1], np.int32),
        bits=network.weight_bits,
        signed=network.signed,
        threshold=max(1, round(threshold)),
        inhibition=mantissa,
        inhibition_exponent=exponent,
        decay=NO_MEMORY_DECAY,
        steps=front_end.ticks,
        regular=True,
        rising=front_end.rising,
        rise=round(RISE * threshold),
    )


def scaled(network: LifNetwork, weights: NDArray[np.int16], unit: float) -> FixedNetwork:
    """The integer network of the settings ``network`` without biases.

    Args:
        network: The settings; threshold and inhibition are multiples of ``unit``.
        weights: Integer weights, int16 (inputs, neurons).
        unit: Drive that a neuron gets in one step from an image of its own place, in units of the weights.
    Raises:
            ConfigError: a presentation would have silent steps only.
    """
    neurons = weights.shape[1]
    mantissa, exponent = mantissa_of(network.inhibition * unit)
    return FixedNetwork(
        weights=weights,
        bias=np.zeros(neurons, np.int32),
        bits=network.weight_bits,
        signed=network.signed,
        threshold=max(1, round(network.threshold * unit)),
        inhibition=mantissa,
        inhibition_exponent=exponent,
        decay=min((1 << DECAY_BITS) - 1, round((1 << DECAY_BITS) / network.tau_membrane)),
        steps=network.steps - check_steps(network, neurons),
        regular=network.trains == "regular",
        bias_input=network.input_mode == "bias",
        model=network.model,
    )
