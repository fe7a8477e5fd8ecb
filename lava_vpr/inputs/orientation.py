"""Orientation channels: the responses of complex cells, edge energy by direction.

The channels are blind to contrast sign, because snow turns dark into light while the direction of an edge stays.

In their place: a convolutional layer of spiking neurons, whose filters are learned.
Every filter has two neurons at every pixel, of opposite sign, so that the layer is blind to contrast sign: their
current is |filter * image|, the filter less its mean. Two things compete, as in the fixed channels: `RIVALRY` times
the mean current of all filters at the pixel is taken off, and what is left is divided by the mean current around (a
window, and a share of the whole image's mean), in units of 1 / `UNIT`. Of a cell only the neuron with the most left, c,
spikes. It integrates c in each of `STEPS` steps, spikes above `THRESHOLD`, and starts again at 0:
``STEPS // (THRESHOLD // c + 1)`` spikes, the activity. All sums are of whole numbers that float64 holds: the same bits
on every machine.
"""

from __future__ import annotations

import base64
import binascii
import math
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.inputs.kernels import channels, smoothed
from lava_vpr.inputs.patches import grey


@cache
def _taps(blur: float) -> NDArray[np.float32]:
    """The weights that OpenCV's ``GaussianBlur`` smooths with: a standard deviation of ``blur`` pixels; 0: not."""
    if blur == 0:
        return np.ones(1, np.float32)
    return np.asarray(cv2.getGaussianKernel(round(8 * blur + 1) | 1, blur, cv2.CV_32F), np.float32).ravel()


def orientation_channels(
    image: NDArray[np.uint8],
    side: int = 56,
    cell: int = 4,
    orientations: int = 8,
    window: int = 15,
    pool_floor: float = 0.1,
    blur: float = 0.7,
) -> NDArray[np.float32]:
    """Complex-cell responses of ``image``, shape (orientations * (side / cell)^2,), channel-major, at least 0.

    The grey image is smoothed by a Gaussian of standard deviation ``blur`` pixels (0: not). The magnitude m of its
    central differences becomes the edge energy ``max(0, min(4, m / (box mean of m + pool_floor mean(m) + 1e-3)) -
    0.3)``, which is shared linearly between the two nearest of ``orientations`` gradient directions modulo 180 degrees
    (channel k: k 180 / orientations degrees); then each channel takes its maximum over ``cell`` x ``cell`` pixels.

    Raises:
        ConfigError: ``side`` is no multiple of ``cell``.
    """
    if cell < 1 or side % cell:
        raise ConfigError(f"the side of {side} pixels is no multiple of the cell of {cell}; choose another")
    small = grey(image, side, cv2.INTER_AREA)
    found: NDArray[np.float32] = channels(small, _taps(blur), cell, orientations, window, np.float32(pool_floor))
    return found.reshape(-1)


STEPS = 32
UNIT = 1 << 12
THRESHOLD = UNIT
RIVALRY = 1.25
TOP = 127
"""The largest weight of a filter."""
FINER = 8
"""Grey levels are whole numbers of 1 / `FINER`."""
MOST_SIDE = 7
"""Most pixels of a filter's side."""


def seen_by(image: NDArray[np.uint8], side: int, blur: float) -> NDArray[np.float64]:
    """``image`` (h, w) or (h, w, 3) BGR as the layer sees it, whole numbers 0..2040, float64 (side, side)."""
    smooth = smoothed(grey(image, side, cv2.INTER_AREA), _taps(blur))
    return np.rint(smooth * np.float32(FINER)).astype(np.float64)


def written(filters: NDArray[np.int8]) -> str:
    """``filters`` (channels, side, side) as the text of a setting."""
    return base64.b64encode(np.ascontiguousarray(filters, np.int8).tobytes()).decode()


def parsed(text: str, channels: int) -> NDArray[np.int8]:
    """The filters that a setting says, int8 (channels, side, side).

    Raises:
        ConfigError: the text is none of so many square filters with an odd side.
    """
    try:
        values = np.frombuffer(base64.b64decode(text, validate=True), np.int8)
    except (binascii.Error, ValueError):
        values = np.zeros(0, np.int8)
    side = math.isqrt(len(values) // channels)
    if not values.any() or side * side * channels != len(values) or side % 2 == 0 or side > MOST_SIDE:
        raise ConfigError(
            f"encoder.filters holds no {channels} square filters of an odd side up to {MOST_SIDE}; leave it out, and "
            "lava-vpr train --input filters learns them"
        )
    return values.reshape(channels, side, side)


def balanced(filters: NDArray[np.int8]) -> NDArray[np.float64]:
    """``filters`` less their means, times the pixels of one: whole numbers, blind to what all pixels have in common."""
    whole = filters.astype(np.float64)
    return filters[0].size * whole - whole.sum(axis=(1, 2), keepdims=True)


def currents(
    seen: NDArray[np.float64], filters: NDArray[np.int8], cell: int, window: int, floor: float
) -> NDArray[np.int64]:
    """The largest normalised current of each cell, int64 (channels, grid, grid).

    Args:
        seen: From `seen_by`.
        filters: int8 (channels, side, side).
        cell: Pixels of a cell's side.
        window: Pixels of the side of the window around.
        floor: Share of the whole image's mean current that is added to the window's.
    """
    grid, channels = len(seen) // cell, len(filters)
    large = np.abs(np.array([cv2.filter2D(seen, cv2.CV_64F, one) for one in balanced(filters)]))
    total = large.sum(axis=0)
    around = cv2.blur(total, (window, window)) + floor * (total.sum() / total.size) + 1.0
    left = np.maximum(channels * large - RIVALRY * total, 0) / around
    cells = left.reshape(channels, grid, cell, grid, cell).max(axis=(2, 4))
    return np.floor(cells * UNIT).astype(np.int64)


def spikes(current: NDArray[np.int64]) -> NDArray[np.int64]:
    """How often neurons with such currents spike, of the same shape."""
    interval = THRESHOLD // np.maximum(current, 1) + 1
    return np.where(current > 0, STEPS // interval, 0)


def filter_channels(
    image: NDArray[np.uint8], side: int, cell: int, channels: int, window: int, floor: float, blur: float, text: str
) -> NDArray[np.float32]:
    """Spikes of the layer, float32 (channels * (side / cell)^2,), channel-major.

    Raises:
        ConfigError: as `parsed`.
    """
    found = currents(seen_by(image, side, blur), parsed(text, channels), cell, window, floor)
    return spikes(found).astype(np.float32).reshape(-1)
