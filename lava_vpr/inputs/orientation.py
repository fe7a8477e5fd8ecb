"""Orientation channels: the responses of complex cells, edge energy by direction.

The channels are blind to contrast sign, because snow turns dark into light while the direction of an edge stays.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.inputs.patches import grey
from lava_vpr.kernelcache import compiled


def edge_energy(
    image: NDArray[np.uint8], side: int, window: int, pool_floor: float, blur: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Divisively normalised gradient magnitude of ``image``, and the gradient (gx, gy) itself, each (side, side).

    The image is smoothed by a Gaussian of standard deviation ``blur`` pixels (0: not). The magnitude m of central
    differences becomes ``max(0, min(4, m / (box mean of m + pool_floor mean(m) + 1e-3)) - 0.3)``.
    """
    g = grey(image, side, cv2.INTER_AREA).astype(np.float32)
    if blur > 0:
        g = cv2.GaussianBlur(g, (0, 0), blur)
    gx = cv2.Sobel(g, cv2.CV_32F, 1, 0, ksize=1)
    gy = cv2.Sobel(g, cv2.CV_32F, 0, 1, ksize=1)
    magnitude = np.sqrt(gx * gx + gy * gy)
    pool = cv2.blur(magnitude, (window, window)) + np.float32(pool_floor) * magnitude.mean() + np.float32(1e-3)
    energy = np.maximum(np.minimum(magnitude / pool, np.float32(4)) - np.float32(0.3), np.float32(0))
    return energy, gx, gy


@compiled(nogil=True)
def _pool(
    energy: NDArray[np.float32], gx: NDArray[np.float32], gy: NDArray[np.float32], cell: int, out: NDArray[np.float32]
) -> None:
    """Share each pixel's energy between its two nearest directions; ``out`` (K, grid, grid) keeps cells' maxima."""
    orientations = out.shape[0]
    for row in range(energy.shape[0]):
        for column in range(energy.shape[1]):
            e = energy[row, column]
            if e <= 0:
                continue
            # float64: a last-bit difference between mathematical libraries then cannot reach a 16-bit rate.
            angle = math.atan2(np.float64(gy[row, column]), np.float64(gx[row, column]))
            position = (angle if angle >= 0 else angle + math.pi) * (orientations / math.pi)
            below = int(position)
            upper = np.float32(e * np.float32(position - below))
            y, x, k, above = row // cell, column // cell, below % orientations, (below + 1) % orientations
            out[k, y, x] = max(out[k, y, x], np.float32(e - upper))
            out[above, y, x] = max(out[above, y, x], upper)


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

    Each pixel's edge energy is shared linearly between the two nearest of ``orientations`` gradient directions modulo
    180 degrees (channel k: k 180 / orientations degrees), then each channel takes its maximum over ``cell`` x ``cell``
    pixels.

    Raises:
        ConfigError: ``side`` is no multiple of ``cell``.
    """
    if cell < 1 or side % cell:
        raise ConfigError(f"the side of {side} pixels is no multiple of the cell of {cell}; choose another")
    energy, gx, gy = edge_energy(image, side, window, pool_floor, blur)
    channels = np.zeros((orientations, side // cell, side // cell), dtype=np.float32)
    _pool(energy, gx, gy, cell, channels)
    return channels.reshape(-1)
