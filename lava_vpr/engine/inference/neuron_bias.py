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


def bias_registers(bias: NDArray[Any]) -> tuple[NDArray[np.int32], int]:
    """Mantissas int32 and the least exponent that hold ``bias``, any shape, in units of v; low bits may be lost."""
    values = np.asarray(bias, np.int64)  # of int32 the lowest has no magnitude
    sizes = np.abs(values)
    exponent = max(0, int(sizes.max(initial=0)).bit_length() - BIAS_BITS)
    return (np.sign(values) * (sizes >> exponent)).astype(np.int32), exponent


def check_bias(bias: NDArray[np.int32], highest: int) -> None:
    """Refuse biases (..., neurons) that registers cannot hold, or by which a neuron would spike without input.

    Raises:
        NetworkLimitError: naming the first.
    """
    mantissas, exponent = bias_registers(bias)
    if exponent > BIAS_EXPONENT_LIMIT or not np.array_equal(mantissas.astype(np.int64) << exponent, bias):
        most = int(np.abs(bias.astype(np.int64)).max())
        raise NetworkLimitError(f"biases up to {most} fit no {BIAS_BITS} bits and an exponent; train the model again")
    if int(bias.max(initial=0)) > highest:
        raise NetworkLimitError(
            f"a bias of {int(bias.max())} makes its neuron spike without input, above {highest}; train the model again"
        )
