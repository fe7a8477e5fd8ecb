"""A network as a file of another program draws it, in real numbers, and the integer network that it makes here."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.fixed import FAN_IN, FixedNetwork, silent_steps
from lava_vpr.engine.inference.quantise import TOP_PERCENTILE, mantissa_of
from lava_vpr.errors import NetworkLimitError, brief
from lava_vpr.loihi import (
    BIAS_BITS,
    BIAS_EXPONENT_LIMIT,
    DECAY_BITS,
    DECAY_UNITY,
    INPUT_SHIFT,
    THRESHOLD_LIMIT,
    WEIGHT_BITS,
)

STEP_UNIT = 1 << INPUT_SHIFT
"""Units of the membrane in one unit of weights and thresholds."""

_MOST_BIAS = ((1 << BIAS_BITS) - 1) << BIAS_EXPONENT_LIMIT
"""The largest bias of a register, in units of the membrane."""


class UnfitNetwork(Exception):
    """A file's content that is no such network, or would be too large a file; the message says why, as in "has two
    inputs"."""


@dataclass(frozen=True)
class Drawn:
    """The network in a file, in any units, as long as they are the same everywhere.

    Attributes:
        weights: What an input's spike adds to each membrane, float64 (inputs, neurons).
        bias: What each membrane gains in every step, float64 (neurons,).
        threshold: Above it a neuron spikes, and starts again at 0.
        decay: Share of a membrane that is lost in a step, in [0, 1].
        inhibition: How much each spike of the inhibitory root inhibits every membrane; 0 without one.
        unit: What a weight of 1 adds to a membrane, where the file says so.
        scalars: `FixedNetwork.scalars`, where the file keeps them: it was written from a model.
        digest: `digest` of the network that it was written from, where the file keeps it.
        references: What `lava_vpr.storage.container.pack` made of the model's references, where the file keeps them.
    """

    weights: NDArray[np.float64] = field(repr=False)
    bias: NDArray[np.float64] = field(repr=False)
    threshold: float
    decay: float
    inhibition: float
    unit: float | None = None
    scalars: Mapping[str, int] | None = None
    digest: str | None = None
    references: bytes | None = field(default=None, repr=False)


def packed_references(kept: Mapping[str, Any]) -> bytes | None:
    """The references that a file keeps, of what our own export added to it; None: there are none.

    Raises:
        Unfit: they are no bytes.
    """
    packed = kept.get("references")
    if packed is not None and not (isinstance(packed, np.ndarray) and packed.dtype == np.uint8):
        raise UnfitNetwork(f"has references that are no bytes: {brief(packed)}")
    return None if packed is None else packed.tobytes()


def heard(neurons: int, inhibitory: int) -> NDArray[np.bool_]:
    """Whom each inhibitory neuron listens to, bool (inhibitory, population): the root to all, by leaves if it has any.

    The population is ``neurons`` excitatory ones, the leaves and, last, the root.
    """
    listens = np.zeros((inhibitory, neurons + inhibitory), np.bool_)
    listens[np.arange(neurons) // FAN_IN if inhibitory > 1 else 0, np.arange(neurons)] = True
    listens[-1, neurons:-1] = True
    return listens


def inhibition_of(
    recurrent: NDArray[np.float64],
    weights: NDArray[np.float64],
    bias: NDArray[np.float64],
    threshold: float,
    neurons: int,
) -> float:
    """How much the root of a population inhibits every excitatory neuron, checked to be the only recurrence.

    Args:
        recurrent: What a spike of each neuron of the population adds to each, (to, from).
        weights: Of the inputs, (population, inputs).
        bias: Of each neuron of the population.
        threshold: The one threshold.
        neurons: How many of the population are excitatory, the first ones.
    Raises:
        Unfit: it is not one root that listens to all, by leaves where they are too many, and to nothing else.
    """
    taken, own, listens = recurrent[:neurons, -1], recurrent[neurons:], heard(neurons, len(recurrent) - neurons)
    if taken.min() != taken.max() or taken[0] > 0:
        raise UnfitNetwork("has a last neuron that does not take the same from every excitatory one")
    if recurrent[:neurons, :-1].any() or own[~listens].any() or not (own[listens] > threshold).all():
        raise UnfitNetwork("has a recurrent edge other than one inhibitory neuron that any spike fires")
    if weights[neurons:].any() or bias[neurons:].any():
        raise UnfitNetwork("has inputs or biases of its inhibitory neurons, the last of the population")
    return float(-taken[0])


class Whole(NamedTuple):
    """An integer network, and what had to be changed for it, for people."""

    network: FixedNetwork
    notes: tuple[str, ...]


def digest(network: FixedNetwork) -> str:
    """A checksum of all numbers of ``network``: two networks with the same one are equal."""
    checksum = hashlib.sha256(json.dumps(network.scalars, sort_keys=True).encode())
    checksum.update(network.weights.astype("<i2").tobytes())
    checksum.update(network.bias.astype("<i4").tobytes())
    return checksum.hexdigest()


def whole(drawn: Drawn, settings: LifNetwork) -> Whole:
    """The integer network that ``drawn`` makes under ``settings``.

    Weights that are whole numbers of a unit, small enough for a synapse, stay as they are; all others are rounded to
    the bits of the settings, the `TOP_PERCENTILE` of their magnitudes becoming the largest, as training does.
    Threshold, biases and inhibition follow in the same unit, each rounded to what its register holds.

    Args:
        drawn: The network.
        settings: Steps, trains and input mode; bits and sign unless the weights ask for others.
    Raises:
        NetworkLimitError: the chip's registers cannot hold it.
    """
    notes: list[str] = []
    signed = bool((drawn.weights < 0).any()) or settings.signed
    bits, unit = _scale(drawn, settings, signed)
    top = (1 << bits) - 1
    weights = np.ascontiguousarray(np.clip(np.round(drawn.weights / unit), -top, top).astype(np.int16))
    _note(notes, f"weights are rounded to {bits} bits{' and a sign' if signed else ''}", weights * unit, drawn.weights)
    threshold = _threshold(drawn.threshold / unit)
    _note(notes, "the threshold is rounded", threshold * unit, drawn.threshold)
    decay = round(drawn.decay * DECAY_UNITY)
    _note(notes, f"the decay is rounded to a multiple of 2^-{DECAY_BITS}", decay / DECAY_UNITY, drawn.decay)
    bias = _biases(drawn.bias / unit)
    _note(notes, "biases are rounded to 12 bits and an exponent", bias * (unit / STEP_UNIT), drawn.bias)
    mantissa, exponent = _inhibition(drawn, unit)
    _note(notes, "inhibition is rounded to 7 bits and an exponent", (mantissa << exponent) * unit, drawn.inhibition)
    neurons = weights.shape[1]
    silent = silent_steps(neurons, settings.input_mode == "bias")
    network = FixedNetwork(
        weights=weights,
        bias=bias,
        bits=bits,
        signed=signed,
        threshold=threshold,
        inhibition=mantissa,
        inhibition_exponent=exponent,
        decay=decay,
        steps=settings.steps - silent,
        regular=settings.trains == "regular",
        bias_input=settings.input_mode == "bias",
    )
    network.check()
    return Whole(network, tuple(notes))


def _scale(drawn: Drawn, settings: LifNetwork, signed: bool) -> tuple[int, float]:
    """Bits of a weight's magnitude, and the unit of weights: the first in which all are whole, else the settings'.

    Raises:
        NetworkLimitError: there is no weight but 0.
    """
    sizes = np.abs(drawn.weights)
    largest, most = float(sizes.max(initial=0)), WEIGHT_BITS - signed
    if largest == 0:
        raise NetworkLimitError("all weights of the network are 0; give one that has learned something")
    own = drawn.scalars["bits"] if drawn.scalars is not None else settings.weight_bits
    for unit in (drawn.unit, float(STEP_UNIT), 1.0):
        if unit is not None and largest < unit * (1 << most) and bool((np.round(sizes / unit) * unit == sizes).all()):
            return max(min(own, most), int(largest / unit).bit_length()), unit
    bits = min(own, most)
    if drawn.unit is not None and largest <= drawn.unit * ((1 << bits) - 0.5):  # altered, but to the same scale
        return bits, drawn.unit
    return bits, (float(np.percentile(sizes, TOP_PERCENTILE)) or largest) / ((1 << bits) - 1)


def _threshold(value: float) -> int:
    """The threshold in units of weights.

    Raises:
        NetworkLimitError: no register holds it.
    """
    if not 0.5 <= value < THRESHOLD_LIMIT - 0.5:
        raise NetworkLimitError(
            f"the threshold is {value:g} times a weight of 1, but must be in 1..{THRESHOLD_LIMIT - 1:,}; scale the "
            "network otherwise"
        )
    return round(value)


def _biases(values: NDArray[np.float64]) -> NDArray[np.int32]:
    """Biases in units of the membrane, as registers hold them, from ``values`` in units of weights.

    Raises:
        NetworkLimitError: one is beyond all registers.
    """
    wanted = np.round(values * STEP_UNIT)
    if (beyond := np.abs(wanted) > _MOST_BIAS).any():
        raise NetworkLimitError(
            f"a bias is {values[beyond][0]:g} times a weight of 1, but must be at most {_MOST_BIAS / STEP_UNIT:g} "
            "either way; scale the network otherwise"
        )
    return held_biases(wanted.astype(np.int64))


def _inhibition(drawn: Drawn, unit: float) -> tuple[int, int]:
    """Mantissa and exponent of the inhibition: those that the file keeps if they say the same, else the least."""
    value, scalars = drawn.inhibition / unit, drawn.scalars
    if not 0 <= value < THRESHOLD_LIMIT:
        raise NetworkLimitError(
            f"the inhibition is {value:g} times a weight of 1, but must be in 0..{THRESHOLD_LIMIT - 1:,}; scale the "
            "network otherwise"
        )
    if scalars is not None and scalars["inhibition"] << scalars["inhibition_exponent"] == value:
        return scalars["inhibition"], scalars["inhibition_exponent"]
    return mantissa_of(value)


def _note(notes: list[str], said: str, made: NDArray[np.float64] | float, wanted: NDArray[np.float64] | float) -> None:
    """Add to ``notes`` what was done to a value, if that changed it by more than its own rounding."""
    wanted, made = np.asarray(wanted, np.float64), np.asarray(made, np.float64)
    largest = float(np.abs(wanted).max(initial=0))
    change = float(np.abs(made - wanted).max(initial=0))
    if change > 1e-6 * largest:
        notes.append(f"{said}: by {100 * change / largest:.2g} % of the largest at most")
