"""Orientation channels: the responses of complex cells, edge energy by direction.

The channels are blind to contrast sign, because snow turns dark into light while the direction of an edge stays.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.inputs.kernels import channels
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
