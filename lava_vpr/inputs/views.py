"""Views: an image as a camera a little to the side, or a little nearer or farther, would have seen it.

A map of one view a place knows one lane. Views of the references become neurons of their own; or the query is presented
in several views. A sideways view is the image shifted by a share of its width, its edge repeated.

References changed at random, as they might look another day: what a network that learns by gradients is shown in place
of queries.

All changes are made to the activity of inputs and know nothing but the references: appearance (contrast, illumination,
noise, and things that are replaced by what stands elsewhere) and viewpoint (a shift sideways). Inputs of vectors have
no place in an image: they are neither shifted nor lit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.encoder import ChannelLayout
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


@dataclass(frozen=True)
class AugmentConfig:
    """How much references are changed; 0 leaves a change out.

    Attributes:
        shift: Most cells by which an image is shifted to either side, drawn evenly; its edge is repeated.
        contrast: Standard deviation of the natural logarithm of the power that responses are raised to.
        illumination: Standard deviation of the logarithm of a gain that grows along each side of the image.
        noise: Standard deviation of the logarithm of a gain of every input's own.
        altered: Share of the inputs that respond as they do to another reference: what a season replaces.
    """

    shift: Annotated[float, Range(0, 100)] = 1.0
    contrast: Annotated[float, Range(0, 10)] = 0.2
    illumination: Annotated[float, Range(0, 10)] = 0.3
    noise: Annotated[float, Range(0, 10)] = 0.5
    altered: Annotated[float, Range(0, 1)] = 0.8

    def __post_init__(self) -> None:
        check(self, "augment")


def augmented(
    activity: NDArray[np.float32], layout: ChannelLayout, config: AugmentConfig, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Every reference once, changed at random.

    Args:
        activity: Responses, float32 (n, inputs), at least 0.
        layout: How the inputs are arranged.
        config: How much is changed.
        rng: What is drawn.
    Returns:
        float32 (n, inputs), at least 0.
    """
    n, inputs = activity.shape
    cells = rng.uniform(-config.shift, config.shift, n)
    seen = (activity if layout.points else shifted(activity, layout, cells)).astype(np.float64)
    seen **= np.exp(rng.normal(0.0, config.contrast, (n, 1)))
    seen *= np.exp(rng.normal(0.0, config.noise, seen.shape))
    slope = rng.normal(0.0, config.illumination, (n, 2))
    if not layout.points:
        across = np.linspace(-1.0, 1.0, layout.grid)
        gain = np.exp(slope[:, :1, None] * across[:, None] + slope[:, 1:, None] * across)
        seen *= np.tile(gain.reshape(n, -1), layout.channels)
    replaced = rng.random((n, inputs)) < config.altered
    others = rng.integers(0, n, (n, inputs))
    return np.where(replaced, activity[others, np.arange(inputs)], seen).astype(np.float32)


def shifted(activity: NDArray[np.float32], layout: ChannelLayout, cells: NDArray[np.float64]) -> NDArray[np.float32]:
    """Responses ``cells`` columns of the grid to the right of where they are looked for, in between interpolated.

    Args:
        activity: float32 (n, inputs).
        layout: How the inputs are arranged.
        cells: The shift of each image, float64 (n,).
    """
    images = activity.reshape(len(activity), layout.channels, layout.grid, layout.grid)
    whole = np.floor(cells).astype(np.int64)
    part = (cells - whole).astype(np.float32)[:, None, None, None]
    columns, rows = np.arange(layout.grid), np.arange(len(activity))[:, None]
    left = np.clip(columns + whole[:, None], 0, layout.grid - 1)
    right = np.clip(columns + whole[:, None] + 1, 0, layout.grid - 1)
    by_column = images.transpose(0, 3, 1, 2)
    moved = (1 - part) * by_column[rows, left] + part * by_column[rows, right]
    return np.ascontiguousarray(moved.transpose(0, 2, 3, 1)).reshape(activity.shape)
