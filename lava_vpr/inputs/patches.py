"""Patch normalisation: what the paper's network sees of an image, what the baseline SAD compares; and HOG, histograms
of oriented gradients, the classical descriptor that the baseline ``hog`` compares.

The normalisation follows the released code of Hussaini et al. 2022 (VPRSNN): bilinear resize of the colour image,
then grey, then a 7x7 sliding-window z-score.

Source of HOG: Dalal and Triggs, CVPR 2005 (doi 10.1109/CVPR.2005.177), as OpenCV computes it with the settings that it
comes with: 9 directions, cells of 8 x 8 pixels, blocks of 2 x 2 cells a cell apart, no gamma correction. Nothing
is tuned.
"""

from __future__ import annotations

import sys

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.kernels import area_means

PATCH_SIDE = 28
PATCH_WINDOW = 7


def grey_levels(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Grey levels of ``image`` (h, w) or (h, w, 3) BGR, uint8 (h, w)."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def averaged(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """``image`` (h, w) or (h, w, 3) resized by OpenCV's ``INTER_AREA``, the means of areas where it becomes smaller."""
    scales = 1.0 / (height / image.shape[0]), 1.0 / (width / image.shape[1])
    if min(scales) < 1 or all(abs(scale - round(scale)) < sys.float_info.epsilon for scale in scales):
        return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    whole = np.ascontiguousarray(image).reshape(*image.shape[:2], -1)
    means: NDArray[np.uint8] = area_means(whole, height, width)
    return means.reshape(height, width, *image.shape[2:])


def grey(image: NDArray[np.uint8], side: int, interpolation: int) -> NDArray[np.uint8]:
    """``image`` (h, w) or (h, w, 3) BGR resized to (side, side) in colour, then turned grey, uint8."""
    if interpolation == cv2.INTER_AREA:
        small = averaged(image, side, side)
    else:
        small = cv2.resize(image, (side, side), interpolation=interpolation)
    return grey_levels(small)


def window_z_score(image: NDArray[np.uint8], window: int = PATCH_WINDOW) -> NDArray[np.float64]:
    """Each pixel's z-score in the ``window`` x ``window`` square around it, shape (h, w).

    Squares are cut off at the border (the released code pads with NaN and ignores NaN). One without contrast gives 0.
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


HOG_SIDE = 64
"""Side in pixels of the square grey image that is described; VPRSNN, VPRTempo and ours see 28, 56 and 64."""
HOG_VALUES = 1764
"""Values of a descriptor: 7 x 7 blocks of 4 cells with 9 directions."""

_HOG = cv2.HOGDescriptor((HOG_SIDE, HOG_SIDE), (16, 16), (8, 8), (8, 8), 9)


def hog(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The descriptor of an ``image`` (h, w) or (h, w, 3) BGR, uint8 (1764,).

    The image is resized as the paper's input is (bilinear, then grey). Values, which OpenCV gives in 0..1, are rounded
    to 1/255, so that a model file keeps a byte of each and cosines are the same bits on every machine.
    """
    values = np.asarray(_HOG.compute(grey(image, HOG_SIDE, cv2.INTER_LINEAR))).ravel()
    return np.rint(np.float32(255) * values).astype(np.uint8)
