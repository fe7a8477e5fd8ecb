"""Bars at the edges of images: where they end, by the pixels alone."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

FLAT, STEP, MOST_OF = 4.0, 3.0, 0.75
"""A bar's lines are this close to one grey level, on average over a line: a camera's noise of five levels leaves it. It
ends within three lines at one that is so many times as far from that level on average, and more than `FLAT` from it in
this share of its values: a straight edge, which neither the sky nor the night ends at."""
LEAST, MOST, LINES = 0.04, 0.45, 2
"""Shares of a side that a bar takes, least and most, and the fewest lines of pixels."""


class Border(NamedTuple):
    """Pixels of the bars at each edge of an image."""

    top: int = 0
    bottom: int = 0
    left: int = 0
    right: int = 0

    def inside(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What an image (h, w) or (h, w, 3) shows between its bars."""
        height, width = image.shape[:2]
        return np.ascontiguousarray(image[self.top : height - self.bottom, self.left : width - self.right])

    def replaced(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image with bars that repeat what is beside them."""
        return np.asarray(cv2.copyMakeBorder(self.inside(image), *self, cv2.BORDER_REPLICATE), np.uint8)

    def shows(self, image: NDArray[np.uint8], grid: int) -> NDArray[np.bool_]:
        """Which cells of a ``grid`` over an image are more inside than under bars, bool (grid, grid)."""
        inside: list[NDArray[np.bool_]] = []
        for side, first, last in ((image.shape[0], self.top, self.bottom), (image.shape[1], self.left, self.right)):
            middles = (np.arange(grid) + 0.5) * side / grid
            inside.append((middles > first) & (middles < side - last))
        return inside[0][:, None] & inside[1]

    def near(self, other: Border, image: NDArray[np.uint8], share: float) -> bool:
        """Whether no bar differs from another border's by more than a ``share`` of the image's side."""
        sides = np.repeat(image.shape[:2], 2)
        return bool((np.abs(np.subtract(self, other)) <= share * sides).all())


def border_of(image: NDArray[np.uint8]) -> Border:
    """The bars of an image, uint8 (h, w) or (h, w, 3): lines of one level that end at a straight, sharp edge."""
    turned = image.swapaxes(0, 1)
    return Border(*(_bar(lines) for lines in (image, image[::-1], turned, turned[::-1])))


def common_border(borders: Iterable[Border]) -> Border:
    """The bars that most of some images have; none on an edge where most have none."""
    found = np.sort(list(borders), axis=0)
    return Border(*found[(len(found) - 1) // 2].tolist())


def _bar(lines: NDArray[np.uint8]) -> int:
    """How many of ``lines``, from the first on, are a bar."""
    level, most = np.float32(np.median(lines[0])), int(MOST * len(lines))

    def apart(k: int) -> NDArray[np.float32]:
        return np.abs(lines[k].astype(np.float32) - level)

    found = next((k for k in range(most) if apart(k).mean() > FLAT), most)
    if found == most or found < max(LINES, LEAST * len(lines)):
        return 0
    ends = [apart(k) for k in range(found, min(found + 3, len(lines)))]
    straight = max((end > FLAT).mean() for end in ends) >= MOST_OF
    return found if straight and max(end.mean() for end in ends) > STEP * FLAT else 0
