"""Detection of bars at the edges of images, from the pixels only."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

FLAT, STEP, MOST_OF = 4.0, 3.0, 0.75
"""Limits of a bar. The mean deviation of its lines from one grey level is at most `FLAT`, which a camera's noise of
five levels stays below. Within three lines it ends at a line whose mean deviation is `STEP` times as large, and where a
share `MOST_OF` of the values deviates by more than `FLAT`: a straight edge, unlike that of a sky or a night."""
LEAST, MOST, LINES = 0.04, 0.45, 2
"""Smallest and largest share of a side that a bar covers, and its fewest lines of pixels."""


class Border(NamedTuple):
    """Pixels of the bars at each edge of an image."""

    top: int = 0
    bottom: int = 0
    left: int = 0
    right: int = 0

    def inside(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part of an image (h, w) or (h, w, 3) between its bars."""
        height, width = image.shape[:2]
        return np.ascontiguousarray(image[self.top : height - self.bottom, self.left : width - self.right])

    def replaced(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image with its bars painted over by the lines beside them."""
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
    """The bars that the majority of images have, edge by edge."""
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
