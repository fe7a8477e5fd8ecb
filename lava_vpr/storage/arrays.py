"""What an array of a file must be: its type, its shape, and the range of its values."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import brief


class UnfitError(ValueError):
    """A value of a file that is not what its format says; the message names it, `how` goes before it."""

    how = "lacks or garbles"


class UnexpectedError(UnfitError):
    """Something in a file that its format does not have."""

    how = "has"


class ArrayRule(NamedTuple):
    """What an array must be: its type, its shape, and the range of its values."""

    dtype: str
    shape: tuple[int, ...]
    least: float = 0
    most: float = math.inf


def narrow(counts: NDArray[Any]) -> NDArray[Any]:
    """Spike counts of any shape, at least 0, as uint16 where all of them fit, else as int32: long maps have many."""
    fits = int(counts.max(initial=0)) <= np.iinfo(np.uint16).max
    return counts.astype(np.uint16 if fits else np.int32, copy=False)


def check_keys(values: Mapping[str, Any], needed: Collection[str], further: Collection[str], what: str) -> None:
    """Refuse ``values`` of a file of which one is missing or unexpected.

    Args:
        values: The values by name.
        needed: Names that must be there.
        further: Names that may be there, too.
        what: An unexpected one, for a message: "array {}".
    Raises:
        UnfitError: naming the first.
    """
    for name in values:
        if name not in needed and name not in further:
            raise UnexpectedError(f"an unexpected {what.format(brief(name))}")
    for name in needed:
        if name not in values:
            raise UnfitError(brief(name))


def check_arrays(
    arrays: Mapping[str, NDArray[Any]], rules: Mapping[str, ArrayRule], optional: Collection[str] = ()
) -> None:
    """Refuse ``arrays`` that are not what ``rules`` say, or not all of them but ``optional`` ones, or more.

    Raises:
        UnfitError: naming the first, and what is wrong with it.
    """
    check_keys(arrays, [name for name in rules if name not in optional], rules, "array {}")
    for name, array in arrays.items():
        _check_array(array, name, rules[name])


def _check_array(array: NDArray[Any], name: str, rule: ArrayRule) -> None:
    """Refuse an ``array`` that is not what ``rule`` says."""
    if array.dtype != rule.dtype:
        raise UnfitError(f"{name} of type {array.dtype} instead of {rule.dtype}")
    if array.shape != rule.shape:
        raise UnfitError(f"{name} of shape {array.shape} instead of {rule.shape}")
    if array.size == 0 or (array.dtype == np.uint8 and rule.most >= 255):
        return
    with np.errstate(invalid="ignore"):  # NaN is least and most of what it is among, and fits no range
        least, most = array.min(), array.max()
    if not np.isfinite((least, most)).all():
        raise UnfitError(f"{name} with values that are not finite")
    if not (least >= rule.least and most <= rule.most):
        raise UnfitError(f"{name} with values from {least:g} to {most:g}, which must be in {rule.least}..{rule.most:g}")
