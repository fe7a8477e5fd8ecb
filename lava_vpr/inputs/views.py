"""Views: an image as a camera a little to the side, or a little nearer or farther, would have seen it.

A map of one view a place knows one lane. Views of the references become neurons of their own; or the query is presented
in several views. A sideways view is the image shifted by a share of its width, its edge repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.settings.ranges import Range, check, need


class View(NamedTuple):
    """One view: the ``shift`` to the right in widths of the image, and the ``scale``, above 1 for nearer."""

    shift: float = 0.0
    scale: float = 1.0


STRAIGHT = View()
"""The image as it is."""


@dataclass(frozen=True)
class ViewsConfig:
    """Views of every reference, which neurons of their own learn.

    Attributes:
        shifts: Number of sideways views, odd: the straight one, and as many on either side.
        shift: Widths of the image between neighbouring ones.
        scales: Number of scales, odd: the straight one, and as many nearer as farther.
        scale: Factor between neighbouring ones.
    """

    shifts: Annotated[int, Range(1, 99, only="odd")] = 1
    shift: Annotated[float, Range(0, 0.5)] = 0.142
    scales: Annotated[int, Range(1, 99, only="odd")] = 1
    scale: Annotated[float, Range(1, 2)] = 1.15

    def __post_init__(self) -> None:
        check(self, "views")
        need(self.shift * (self.shifts // 2) < 1, "views.shift", self.shift, "so small that views show the image")

    @property
    def views(self) -> tuple[View, ...]:
        """All views, the straight one first, then by scale, from left to right."""
        steps = range(-(self.shifts // 2), self.shifts // 2 + 1)
        powers = range(-(self.scales // 2), self.scales // 2 + 1)
        every = [View(step * self.shift, self.scale**power) for power in powers for step in steps]
        return (STRAIGHT, *(view for view in every if view != STRAIGHT))


def seen_as(image: NDArray[np.uint8], view: View) -> NDArray[np.uint8]:
    """The ``image`` (h, w) or (h, w, 3) in a view, of the same size and type; what lies beyond its edge repeats it."""
    if view == STRAIGHT:
        return image
    height, width = image.shape[:2]
    shift, scale = view
    matrix = np.array(
        [[scale, 0, (1 - scale) * width / 2 + shift * width], [0, scale, (1 - scale) * height / 2]], np.float64
    )
    return np.asarray(
        cv2.warpAffine(image, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        np.uint8,
    )
