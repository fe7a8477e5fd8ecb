"""Vectors as inputs: descriptors that another program made of images, standardised and, if they are long, projected.

A vector x becomes s o (x - m), where m is the mean of the references and s one scale for all values, or one for each.
More values than the network has inputs for are projected on fewer: their signs are flipped at random, a Walsh-Hadamard
transform mixes them, and some of what comes out is kept (the subsampled randomised Hadamard transform: Ailon and
Chazelle, STOC 2006, doi 10.1145/1132516.1132597; Tropp, 2011, doi 10.1142/S1793536911000787). Angles between vectors
stay nearly what they are, nothing is fitted, and additions in a fixed order give the same bits on every machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError

LARGEST_VALUE = 1e18
"""No value of a vector is larger, so that no sum of squares overflows."""
_LARGEST_STANDARD = np.float32(1e6)


@dataclass(frozen=True, eq=False)
class Standard:
    """What vectors are measured by: fitted on references, kept with what was learned from them.

    Attributes:
        mean: Mean of each value over the references, float32 (values,).
        scale: What each value is divided by once the mean is off, float32 (values,), above 0.
        signs: 1 or -1 for each value and for the zeros behind them that make their number a power of two, int8
            (width,); none, if vectors are not projected.
        kept: Which numbers of the transform are kept, ascending, int32 (kept,); none, if vectors are not projected.
    """

    mean: NDArray[np.float32]
    scale: NDArray[np.float32]
    signs: NDArray[np.int8]
    kept: NDArray[np.int32]

    @property
    def values(self) -> int:
        """Values of a vector as it is given."""
        return len(self.mean)

    @property
    def projects(self) -> bool:
        """Whether vectors are projected on fewer values."""
        return len(self.kept) > 0

    def standardised(self, vectors: NDArray[np.float32]) -> NDArray[np.float32]:
        """``vectors`` (..., values) less the mean, divided by the scale, within +-1e6, float32."""
        off = (vectors - self.mean) / self.scale
        return np.clip(off, -_LARGEST_STANDARD, _LARGEST_STANDARD).astype(np.float32)

    def seen(self, vectors: NDArray[np.float32]) -> NDArray[np.float32]:
        """What inputs see of ``vectors`` (n, values): standardised, projected if they are long, float32 (n, seen)."""
        own = self.standardised(vectors)
        if not self.projects:
            return own
        wide = np.zeros((len(own), len(self.signs)), np.float32)
        wide[:, : self.values] = own
        return np.ascontiguousarray(hadamard(wide * self.signs)[:, self.kept])

    def same(self, other: Standard) -> bool:
        """Whether ``other`` measures alike, bit for bit."""
        pairs = zip(self.arrays.values(), other.arrays.values(), strict=True)
        return all(np.array_equal(own, their) for own, their in pairs)

    @property
    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Its arrays by the names of its attributes."""
        return {"mean": self.mean, "scale": self.scale, "signs": self.signs, "kept": self.kept}


def width_for(values: int) -> int:
    """The smallest power of two that is at least ``values``: how many numbers a transform takes."""
    return 1 << (values - 1).bit_length()


def hadamard(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """The Walsh-Hadamard transform of each of ``rows`` (n, width), width a power of two, divided by sqrt(width).

    Every row is transformed by itself, in the order of the butterflies, whatever n is.
    """
    n, width = rows.shape
    mixed, half = rows, 1
    while half < width:
        pairs = mixed.reshape(n, width // (2 * half), 2, half)
        mixed = np.stack([pairs[:, :, 0] + pairs[:, :, 1], pairs[:, :, 0] - pairs[:, :, 1]], axis=2)
        half *= 2
    return (mixed.reshape(n, width) / np.float32(width**0.5)).astype(np.float32)


def without_weak(values: NDArray[np.float32], dead_zone: float) -> NDArray[np.float32]:
    """Signed values (n,), each moved towards 0 by ``dead_zone`` times their mean magnitude, or to 0, float32 (n,).

    What is about the mean of the references says little; without it, spikes go to what stands out.
    """
    magnitude = np.abs(values)
    # An exact sum: the mean is the same on every machine, in whatever order it adds.
    least = np.float32(dead_zone * math.fsum(magnitude.tolist()) / len(values))
    return np.copysign(np.maximum(magnitude - least, np.float32(0)), values)


def signed_channels(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """ON and OFF channels of signed values (n,): what is above 0, then what is below, float32 (2 n,), at least 0."""
    return np.concatenate([np.maximum(values, 0), np.maximum(-values, 0)])


def as_rates(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """``values`` (n,) themselves, seen to be at least 0.

    Raises:
        InputError: one is below 0.
    """
    if (values < 0).any():
        raise InputError(
            f"value {int(np.argmax(values < 0))} is {float(values.min()):g}, but rates are at least 0; use the input "
            "'vector', which takes signed values"
        )
    return values


def picture_of(vector: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.uint8]:
    """A vector as a picture for reports: its values row by row in a rectangle, dark for the least, light for the most.

    Args:
        vector: Its values, (values,), at least one.
        size: Width and height of the picture in pixels.
    Returns:
        uint8 (height, width, 3) BGR; grey where all values are equal.
    """
    values = vector.astype(np.float64)
    spread = float(values.max() - values.min())
    levels = np.full(len(values), 0.5) if spread == 0 else (values - values.min()) / spread
    columns = max(1, round((len(values) * size[0] / size[1]) ** 0.5))
    rows = -(-len(values) // columns)
    sheet = np.zeros(rows * columns, np.uint8)
    sheet[: len(values)] = np.round(255 * levels)
    coloured = cv2.applyColorMap(sheet.reshape(rows, columns), cv2.COLORMAP_VIRIDIS)
    shrinks = columns > size[0] or rows > size[1]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(coloured, size, interpolation=how), np.uint8)
