"""From an image to what the encoder sees: VPRSNN's patch normalisation, and orientation channels.

Patch normalisation follows the released code of Hussaini et al. 2022 (bilinear resize of the colour image, then grey,
then a 7x7 sliding-window z-score). Orientation channels are the responses of complex cells: edge energy by direction,
blind to contrast sign, because snow turns dark into light while the direction of an edge stays.
"""

from __future__ import annotations

import math

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

PATCH_SIDE = 28
PATCH_WINDOW = 7


def grey(image: NDArray[np.uint8], side: int, interpolation: int) -> NDArray[np.uint8]:
    """``image`` (h, w) or (h, w, 3) BGR resized to (side, side) in colour, then turned grey, uint8."""
    small = cv2.resize(image, (side, side), interpolation=interpolation)
    return small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)


def window_z_score(image: NDArray[np.uint8], window: int = PATCH_WINDOW) -> NDArray[np.float64]:
    """Each pixel's z-score in the ``window`` x ``window`` square around it, shape (h, w).

    Squares are cut off at the border (the reference pads with NaN and ignores NaN); a square without contrast gives 0.
    Sums are exact integers: with n pixels, S their sum and Q their sum of squares, z = (n x - S) / sqrt(n Q - S^2),
    where the standard deviation is the population's.
    """
    half = window // 2
    values = image.astype(np.int64)
    padded = np.zeros((3, image.shape[0] + 2 * half + 1, image.shape[1] + 2 * half + 1), dtype=np.int64)
    inner = (slice(half + 1, half + 1 + image.shape[0]), slice(half + 1, half + 1 + image.shape[1]))
    padded[0][inner], padded[1][inner], padded[2][inner] = 1, values, values * values
    table = padded.cumsum(axis=1).cumsum(axis=2)
    box = table[:, window:, window:] - table[:, :-window, window:] - table[:, window:, :-window]
    count, total, squares = box + table[:, :-window, :-window]
    spread = np.sqrt((count * squares - total * total).astype(np.float64))
    difference = (count * values - total).astype(np.float64)
    return np.divide(difference, spread, out=np.zeros_like(difference), where=spread > 0)


def patch_normalised(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The paper's input: ``image`` (h, w) or (h, w, 3) BGR as patch-normalised uint8 (28, 28).

    Source: released code of VPRSNN; ``uint8(255 (1 + clip(z, -1, 1)) / 2)``, truncating.
    """
    z = np.clip(window_z_score(grey(image, PATCH_SIDE, cv2.INTER_LINEAR)), -1.0, 1.0)
    return (255.0 * (1.0 + z) / 2.0).astype(np.uint8)


def on_off(patches: NDArray[np.uint8]) -> NDArray[np.float32]:
    """ON and OFF channels of patch-normalised images (n, 28, 28): shape (n, 1568), in 0..127.5, ON first."""
    signed = patches.reshape(len(patches), -1).astype(np.float32) - np.float32(127.5)
    return np.concatenate([np.maximum(signed, 0), np.maximum(-signed, 0)], axis=1)


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


@nb.njit(cache=True, nogil=True)
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
    """
    energy, gx, gy = edge_energy(image, side, window, pool_floor, blur)
    channels = np.zeros((orientations, side // cell, side // cell), dtype=np.float32)
    _pool(energy, gx, gy, cell, channels)
    return channels.reshape(-1)
