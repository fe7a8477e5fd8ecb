"""Arrays at the door of compiled code, which goes through them without looking at their ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lava_vpr.errors import InputError


def check_array(array: NDArray[Any], name: str, dtype: DTypeLike, shape: tuple[int, ...], remedy: str) -> None:
    """Refuse an ``array`` of another type or shape.

    Raises:
        InputError: naming both, and the remedy.
    """
    if array.dtype != dtype or array.shape != shape:
        raise InputError(
            f"{name} of type {array.dtype} and shape {array.shape}, where {np.dtype(dtype)} {shape} is needed; {remedy}"
        )


def check_rates(rates: NDArray[Any], dtype: DTypeLike, shape: tuple[int, ...]) -> None:
    """Refuse rates of another type or shape: of one presentation (inputs,), or of many (n, inputs).

    Raises:
        InputError: naming both.
    """
    check_array(rates, "rates", dtype, shape, "encode the images with the model's settings")


def check_presentations(rates: NDArray[Any], keys: NDArray[Any], dtype: DTypeLike, inputs: int) -> None:
    """Refuse rates that are not (n, inputs), or keys that are not one for each presentation.

    Raises:
        InputError: naming what does not fit.
    """
    check_rates(rates, dtype, (len(rates), inputs))
    check_array(keys, "keys", np.uint64, (len(rates),), "make one for each presentation")
