"""Where vectors come from: what a traverse of vectors holds instead of images, and the checks of an array of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.inputs.vectors import LARGEST_VALUE
from lava_vpr.positions.frames import Positions

REMEDY = "give one row of finite numbers for each image, as float32 (images, values)"
_BLOCK = 1 << 22
"""Numbers that are looked at together."""


class VectorSource(Protocol):
    """Vectors of one drive, by number from 0, each of as many values."""

    @property
    def values(self) -> int:
        """Values of each vector."""

    @property
    def names(self) -> tuple[str, ...] | None:
        """A name for each vector; None: nobody says."""

    def __len__(self) -> int:
        """The number of vectors."""

    def row(self, number: int) -> NDArray[np.float32]:
        """Vector ``number``, finite, float32 (values,)."""


@dataclass(frozen=True, eq=False)
class Vectors:
    """Vectors in memory, checked by `checked_vectors`.

    Attributes:
        array: One row for each image, any real type, (images, values).
        names: A name for each; None: nobody says.
        positions: Where each image was taken; None: nobody says.
        stamps: When each image was taken, in seconds, float64 (images,); None: nobody says.
    """

    array: NDArray[Any]
    names: tuple[str, ...] | None = None
    positions: Positions | None = None
    stamps: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.array)

    @property
    def values(self) -> int:
        """Values of each vector."""
        return int(self.array.shape[1])

    def row(self, number: int) -> NDArray[np.float32]:
        """Vector ``number``, float32 (values,)."""
        return np.ascontiguousarray(self.array[number], np.float32)


def checked_vectors(array: NDArray[Any], where: str, remedy: str = REMEDY) -> NDArray[Any]:
    """``array`` itself, seen to hold vectors: whole or real numbers (images, values), finite, of sizes that add up.

    Args:
        array: Vectors from wherever.
        where: What a message begins with, the file or argument.
        remedy: What a message ends with.
    Raises:
        InputError: it holds none; a row is named where one row is wrong.
    """
    if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
        raise InputError(f"{where}: holds {array.dtype}, not real numbers; {remedy}")
    if array.ndim != 2:
        raise InputError(f"{where}: has shape {array.shape}, not (images, values); {remedy}")
    if 0 in array.shape:
        raise InputError(f"{where}: is empty, of shape {array.shape}; {remedy}")
    rows = max(1, _BLOCK // array.shape[1])
    for start in range(0, len(array), rows):
        with np.errstate(invalid="ignore"):  # NaN compares as false
            fits = (np.abs(array[start : start + rows].astype(np.float64)) <= LARGEST_VALUE).all(axis=1)
        if not fits.all():
            row = start + int(np.flatnonzero(~fits)[0])
            finite = bool(np.isfinite(array[row]).all())
            cause = f"values beyond {LARGEST_VALUE:g}" if finite else "NaN or infinite values"
            raise InputError(f"{where}: row {row} holds {cause}; {'scale them' if finite else 'compute it again'}")
    return array
