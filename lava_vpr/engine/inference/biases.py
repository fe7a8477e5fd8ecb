"""Bias inputs: compartments on the chip that integrate a bias and so spike regularly, without spikes from the host.

Before a presentation the host writes each input's bias and start membrane once; the start membrane shifts the train in
time. In every step with input the membrane grows by the bias; a compartment whose membrane exceeds `LEVEL` spikes and
starts again from 0. In the silent steps the bias is 0.

A rate of r 2^-16 spikes a step asks for an interval of 65536 / r steps. A compartment's interval is
``LEVEL // bias + 1``, so the bias ``2 r LEVEL // (2^17 - r)`` rounds it to the nearest whole number, as well as 12 bits
of mantissa can say it.

Excitatory neurons have biases, too; this module also computes how registers round them and how high they may be.
"""

from __future__ import annotations

import zlib
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.random import GOLDEN, derived_key, hashes, mix
from lava_vpr.errors import NetworkLimitError
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, DECAY_BITS, INPUT_SHIFT

THRESHOLD = 8000
"""Threshold of the input compartments in units of v >> 6, just below what the largest bias exceeds in one step."""

LEVEL = THRESHOLD << INPUT_SHIFT
"""The threshold of the input compartments in units of v."""

SPARE_DECAY = 1
"""Margin of decay, in units of 2^-12: even if a chip decays by this much less than its register says, no bias makes a
neuron spike without input."""

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
def _trains(
    bias: NDArray[np.int32], key: np.uint64, steps: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """The inputs that spike, ascending, and the first spike, the interval and the number of spikes of each, int32 (k,).

    Quotients of whole numbers below 2^26 are exact in float64 once rounded down, and many are divided at a time.
    """
    derived, level, last = mix((key ^ _CRC) + GOLDEN), np.float64(LEVEL), np.int32(steps - 1)
    active, slope, n = np.empty(bias.size, np.int32), np.empty(bias.size, np.int32), np.uint64(0)
    for j in range(bias.size):
        active[n] = j
        slope[n] = bias[j]
        n += np.uint64(bias[j] > 0)
    first, every, many = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    for k in range(first.size):
        word = mix(derived + GOLDEN * np.uint64(active[k])) >> _S32
        first[k] = np.int32((word * _LEVEL) >> _S32)
    for k in range(first.size):
        first[k] = np.int32((level - np.float64(first[k])) / np.float64(slope[k]))
        every[k] = np.int32(level / np.float64(slope[k])) + np.int32(1)
        many[k] = np.int32(np.float64(np.int32(last - first[k])) / np.float64(every[k])) + np.int32(1)
    n = np.uint64(0)
    for k in range(first.size):
        active[n], first[n], every[n], many[n] = active[k], first[k], every[k], many[k]
        n += np.uint64(first[k] <= last)
    return active[:n], first[:n], every[:n], many[:n]


@compiled()
def schedule(bias: NDArray[np.int32], key: np.uint64, steps: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """`bias_input_spikes` as lists: those of step t are ``members[starts[t]:starts[t + 1]]``, ascending.

    Args:
        bias: In units of v, int32 (inputs,).
        key: Key of the presentation.
        steps: Steps with input.
    """
    active, following, every, many = _trains(bias, key, steps)
    total = np.int32(0)
    for k in range(many.size):  # where each input's spikes begin in a list of all, by input
        total, many[k] = total + many[k], total
    when, who, place = np.empty(total, np.int32), np.empty(total, np.int32), many
    starts, left = np.zeros(steps + 1, np.int64), np.uint64(active.size)
    # In each round every input with spikes left spikes once: no branch of the inner loop depends on an input.
    while left > np.uint64(0):
        kept = np.uint64(0)
        for k in range(left):
            step, gap, member, position = following[k], every[k], active[k], place[k]
            when[np.uint64(position)] = step
            who[np.uint64(position)] = member
            starts[np.uint64(step) + np.uint64(1)] += 1
            following[kept], every[kept], active[kept], place[kept] = step + gap, gap, member, position + 1
            kept += np.uint64(step + gap < steps)
        left = kept
    for step in range(steps):
        starts[step + 1] += starts[step]
    members, begin = np.empty(total, np.int32), starts[:steps].copy()
    for s in range(total):
        at = np.uint64(when[s])
        members[np.uint64(begin[at])] = who[s]
        begin[at] += 1
    return starts, members


def highest_bias(threshold: int, decay: int) -> int:
    """The largest bias, in units of v, with which no membrane rises above the threshold without input.

    A membrane that gains b and loses ``decay`` 2^-12 of itself in every step stays below b 2^12 / ``decay``.
    """
    return ((threshold << INPUT_SHIFT) * decay) >> DECAY_BITS


def safe_bias(threshold: int, decay: int) -> int:
    """`highest_bias` with a margin of `SPARE_DECAY`: valid even on a chip whose decay is off by that much."""
    return highest_bias(threshold, max(0, decay - SPARE_DECAY))


def bias_registers(bias: NDArray[Any]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Mantissas, and for each row the least exponent, that hold ``bias`` in units of v; low bits may be lost.

    Args:
        bias: Whole numbers, (..., neurons).
    Returns:
        Mantissas int32 (..., neurons), and exponents int32 (...).
    """
    values = np.asarray(bias, np.int64)  # the lowest int32 has no positive counterpart
    sizes = np.abs(values)
    _, lengths = np.frexp(sizes.max(axis=-1, initial=0).astype(np.float64))  # bits, exact below 2^53
    exponents = np.asarray(np.maximum(lengths - BIAS_BITS, 0), np.int32)
    return (np.sign(values) * (sizes >> exponents[..., None])).astype(np.int32), exponents


def held_biases(bias: NDArray[Any]) -> NDArray[np.int32]:
    """``bias`` (..., neurons) in units of v as registers round it: each row has mantissas and one exponent."""
    mantissas, exponents = bias_registers(bias)
    return mantissas << exponents[..., None]


def check_bias(bias: NDArray[np.int32], highest: int) -> None:
    """Refuse biases (..., neurons), a row a presentation, that registers cannot hold or by which a neuron would spike.

    Raises:
        NetworkLimitError: naming the first.
    """
    mantissas, exponents = bias_registers(bias)
    held = mantissas.astype(np.int64) << exponents[..., None]
    if exponents.max(initial=0) > BIAS_EXPONENT_LIMIT or not np.array_equal(held, bias):
        most = int(np.abs(bias.astype(np.int64)).max())
        raise NetworkLimitError(f"biases up to {most} fit no {BIAS_BITS} bits and an exponent; train the model again")
    if int(bias.max(initial=0)) > highest:
        raise NetworkLimitError(
            f"a bias of {int(bias.max())} makes its neuron spike without input, above {highest}; train the model again"
        )
