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
from functools import cache

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


@cache
def slopes() -> NDArray[np.int32]:
    """The bias of every rate in units of v, int32 (65536,): a table of `biases`."""
    return np.left_shift(*biases(np.arange(1 << 16).astype(np.uint16)))


@compiled(error_model="numpy")
def _first_and_every(
    bias: NDArray[np.int32], key: np.uint64, steps: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], np.int64]:
    """The inputs with a bias, the first spike and the interval of each, and how many spikes there are at most.

    Quotients of whole numbers below 2^26 are exact in float64 once rounded down, and many are divided at a time.
    """
    derived, level = mix((key ^ _CRC) + GOLDEN), np.float64(LEVEL)
    active, slope, n = np.empty(bias.size, np.int32), np.empty(bias.size, np.int32), np.uint64(0)
    for j in range(bias.size):
        active[n] = j
        slope[n] = bias[j]
        n += np.uint64(bias[j] > 0)
    first, every = np.empty(n, np.int32), np.empty(n, np.int32)
    for k in range(first.size):
        word = mix(derived + GOLDEN * np.uint64(active[k])) >> _S32
        first[k] = np.int32((word * _LEVEL) >> _S32)
    most = np.int64(0)
    for k in range(first.size):
        first[k] = np.int32((level - np.float64(first[k])) / np.float64(slope[k]))
        every[k] = np.int32(level / np.float64(slope[k])) + np.int32(1)
        most += np.int32(np.float64(steps) / np.float64(every[k])) + np.int32(2)
    return active, first, every, most


@compiled()
def schedule(bias: NDArray[np.int32], key: np.uint64, steps: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """`bias_input_spikes` as lists: those of step t are ``members[starts[t]:starts[t + 1]]``, in any order.

    Args:
        bias: In units of v, int32 (inputs,).
        key: Key of the presentation.
        steps: Steps with input.
    """
    active, following, every, most = _first_and_every(bias, key, steps)
    when, who = np.empty(most, np.int32), np.empty(most, np.int32)
    starts, n, left = np.zeros(steps + 1, np.int64), np.uint64(0), np.uint64(every.size)
    # In every round all inputs that go on spiking spike once: no branch of the inner loop depends on an input.
    while left > np.uint64(0):
        kept = np.uint64(0)
        for k in range(left):
            step, gap, member = following[k], every[k], active[k]
            going = np.uint64(step < steps)
            when[n] = step
            who[n] = member
            n += going
            starts[np.uint64(min(step, steps - 1)) + np.uint64(1)] += np.int64(going)
            following[kept] = step + gap
            every[kept] = gap
            active[kept] = member
            kept += going
        left = kept
    for step in range(steps):
        starts[step + 1] += starts[step]
    members, place = np.empty(n, np.int32), starts[:steps].copy()
    for s in range(n):
        step = np.uint64(when[s])
        members[np.uint64(place[step])] = who[s]
        place[step] += 1
    return starts, members
