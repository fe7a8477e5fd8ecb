"""Inputs that need no spike traffic: compartments on the chip that integrate a bias, and so spike regularly.

Before a presentation each input's bias and start membrane are written once; the latter shifts the train in time. In
every step with input the membrane grows by the bias; a compartment whose membrane exceeds `LEVEL` spikes and starts
again from 0. In the silent steps the bias is 0.

A rate of r 2^-16 spikes a step asks for an interval of 65536 / r steps. A compartment's interval is
``LEVEL // bias + 1``, so the bias ``2 r LEVEL // (2^17 - r)`` rounds it to the nearest whole number, as well as 12 bits
of mantissa can say it.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.random import GOLDEN, derived_key, hashes, mix
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, INPUT_SHIFT

THRESHOLD = 8000
"""Threshold of the input compartments in units of v >> 6, just below what the largest bias exceeds in one step."""

LEVEL = THRESHOLD << INPUT_SHIFT
"""The threshold of the input compartments in units of v."""

_PURPOSE = "phase"
_CRC = np.uint64(zlib.crc32(_PURPOSE.encode()))
_S32 = np.uint64(32)
_LEVEL = np.uint64(LEVEL)
_TOP = ((1 << BIAS_BITS) - 1) << BIAS_EXPONENT_LIMIT


def biases(rates: NDArray[np.uint16]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Bias of each input, as mantissa and exponent of Loihi's registers.

    Args:
        rates: Spikes a step in units of 2^-16, uint16, any shape.
    Returns:
        Mantissas 0..4095 and exponents 0..7 of the bias mantissa 2^exponent in units of v, int32, same shape.
    """
    r = rates.astype(np.int64)
    exact = np.minimum(2 * r * LEVEL // ((1 << 17) - r), _TOP)
    exponent = np.zeros(r.shape, np.int64)
    for e in range(BIAS_EXPONENT_LIMIT):
        exponent += exact >= 1 << (BIAS_BITS + e)
    return (exact >> exponent).astype(np.int32), exponent.astype(np.int32)


def start_membranes(key: int, inputs: int) -> NDArray[np.int32]:
    """Membranes of the inputs before a presentation, uniform in [0, LEVEL), int32 (inputs,).

    Args:
        key: Key of the presentation (`lava_vpr.engine.random.presentation_key`).
        inputs: Number of inputs.
    """
    words = hashes(derived_key(int(key), _PURPOSE), np.zeros(1, np.int64), np.arange(inputs))[0]
    return ((words >> _S32) * _LEVEL >> _S32).astype(np.int32)


def bias_input_spikes(rates: NDArray[np.uint16], key: int, steps: int) -> NDArray[np.bool_]:
    """The spikes of one presentation, bool (steps, inputs), compartment by compartment and step by step.

    Plain numpy: the definition of what every backend's input compartments do.
    """
    mantissa, exponent = biases(rates)
    bias, v = mantissa << exponent, start_membranes(key, len(rates))
    spikes = np.zeros((steps, len(rates)), bool)
    for step in range(steps):
        v += bias
        spikes[step] = v > LEVEL
        v[spikes[step]] = 0
    return spikes


@compiled()
def schedule(bias: NDArray[np.int32], key: np.uint64, steps: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """`bias_input_spikes` as lists: those of step t are ``members[starts[t]:starts[t + 1]]``, ascending.

    Args:
        bias: In units of v, int32 (inputs,).
        key: Key of the presentation.
        steps: Steps with input.
    """
    level = np.int64(LEVEL)
    derived = mix((key ^ _CRC) + GOLDEN)
    first = np.empty(bias.size, np.int64)
    starts = np.zeros(steps + 1, np.int64)
    for j in range(bias.size):
        first[j] = steps
        if bias[j] > 0:
            word = mix(derived + GOLDEN * np.uint64(j)) >> _S32
            v = np.int64((word * _LEVEL) >> _S32)
            first[j] = (level - v) // bias[j]
            for step in range(first[j], steps, level // bias[j] + 1):
                starts[step + 1] += 1
    for step in range(steps):
        starts[step + 1] += starts[step]
    members = np.empty(starts[steps], np.int32)
    place = starts[:steps].copy()
    for j in range(bias.size):
        if first[j] < steps:
            for step in range(first[j], steps, level // bias[j] + 1):
                members[place[step]] = j
                place[step] += 1
    return starts, members
