"""Biases of excitatory neurons: what the chip's registers hold of them, and how high they may be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, DECAY_BITS, INPUT_SHIFT


def highest_bias(threshold: int, decay: int) -> int:
    """The largest bias, in units of v, with which no membrane rises above the threshold without input.

    A membrane that gains b and loses ``decay`` 2^-12 of itself in every step stays below b 2^12 / ``decay``.
    """
    return ((threshold << INPUT_SHIFT) * decay) >> DECAY_BITS


def bias_registers(bias: NDArray[Any]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Mantissas, and for each row the least exponent, that hold ``bias`` in units of v; low bits may be lost.

    Args:
        bias: Whole numbers, (..., neurons).
    Returns:
        Mantissas int32 (..., neurons), and exponents int32 (...).
    """
    values = np.asarray(bias, np.int64)  # of int32 the lowest has no magnitude
    sizes = np.abs(values)
    _, lengths = np.frexp(sizes.max(axis=-1, initial=0).astype(np.float64))  # bits, exact below 2^53
    exponents = np.asarray(np.maximum(lengths - BIAS_BITS, 0), np.int32)
    return (np.sign(values) * (sizes >> exponents[..., None])).astype(np.int32), exponents


def held_biases(bias: NDArray[Any]) -> NDArray[np.int32]:
    """What registers hold of ``bias``, (..., neurons), in units of v: each row as mantissas and one exponent."""
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
