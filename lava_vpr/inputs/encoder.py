"""Kinds of input, one row each: which channels look at an image, and how they respond.

Everything that belongs to a kind of input is in its row: how many channels there are, how they respond to an image, how
a report draws what a neuron has learned about them. A new kind is a function and a row in `INPUTS`: settings, commands,
files and reports ask for the row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.inputs.patches import PATCH_SIDE, on_off
from lava_vpr.ranges import need, whole, within
from lava_vpr.registry import Registry


@dataclass(frozen=True)
class EncoderConfig:
    """How an image becomes spike probabilities.

    Attributes:
        kind: Name of a row in `INPUTS`: ``orientation`` (complex-cell edge channels), ``onoff`` or ``pixels`` (the
            paper's patch-normalised ones).
        image_size: Side in pixels of the square image that the orientation channels are computed on.
        cell: Side in pixels of one pooling cell; ``image_size`` must be a multiple of it.
        orientations: Number of orientations, evenly spaced over 180 degrees.
        window: Side in pixels of the divisive-normalisation window, odd.
        blur: Standard deviation in pixels of the Gaussian that the resized image is smoothed with; 0: none.
        pool_floor: Share of the image's mean edge energy that is added to each window's.
        train_spikes: Expected input spikes per step while training ("tot"), all inputs together.
        query_spikes: Expected input spikes per step while answering a query.
        query_inputs: Only so many inputs, those that respond most, spike while answering a query; 0: all.
        max_rate_hz: ``pixels`` under the ``paper`` preset: rate of a white pixel, in Hz.
    """

    kind: str = "orientation"
    image_size: int = 64
    cell: int = 4
    orientations: int = 8
    window: int = 17
    pool_floor: float = 0.1
    blur: float = 0.7
    train_spikes: float = 12.0
    query_spikes: float = 20.0
    query_inputs: int = 520
    max_rate_hz: float = 63.75

    def __post_init__(self) -> None:
        need(self.kind in INPUTS, "encoder.kind", self.kind, "one of " + ", ".join(INPUTS))
        within(self, "encoder", image_size="[8, 512]")
        need(whole(self.cell) and 1 <= self.cell <= self.image_size, "encoder.cell", self.cell, "in 1..image_size")
        need(self.image_size % self.cell == 0, "encoder.image_size", self.image_size, f"a multiple of {self.cell}")
        within(self, "encoder", orientations="[2, 16]")
        odd = whole(self.window) and 3 <= self.window <= 255 and self.window % 2 == 1
        need(odd, "encoder.window", self.window, "odd, in 3..255")
        within(
            self,
            "encoder",
            blur="[0, 50]",
            pool_floor="[0, 100]",
            train_spikes="(0, 1000]",
            query_spikes="(0, 1000]",
            query_inputs="[0, 1000000]",
            max_rate_hz="(0, 1000]",
        )

    @property
    def layout(self) -> Layout:
        """The arrangement of the inputs."""
        return INPUTS[self.kind].layout(self)

    @property
    def inputs(self) -> int:
        """The number of input neurons."""
        return self.layout.inputs


class Layout(NamedTuple):
    """Inputs as channels over a square grid, ordered channel, row, column.

    Attributes:
        channels: Channels at each point of the grid.
        grid: Side of the grid.
    """

    channels: int
    grid: int

    @property
    def inputs(self) -> int:
        """The number of inputs, over all channels."""
        return self.channels * self.grid**2


@dataclass(frozen=True)
class Input:
    """A kind of input: its channels, how they respond, and how a report draws them.

    Attributes:
        name: How options and settings call it.
        layout: The channels under given settings.
        sees: What `activity` is given: the ``image`` as it was read, uint8 (h, w) or (h, w, 3) BGR, or its
            patch-normalised form, the ``patch``, uint8 (28, 28).
        activity: Responses of the channels, float32 (inputs,), at least 0, ordered as in `Layout`.
        grey_levels: Whether responses are grey levels 0..255, which the conductance network takes as rates.
        drawing: How a report draws what a neuron has learned: ``strokes``, one for each channel along the edge that
            excites it, where channel k of K belongs to a gradient at 180 k / K degrees, the y axis pointing down; or
            ``grey`` levels of the only channel, or of the difference between the first and the second.
        legend: What the report says about these drawings, a sentence.
    """

    name: str
    layout: Callable[[EncoderConfig], Layout]
    sees: Literal["image", "patch"]
    activity: Callable[[NDArray[np.uint8], EncoderConfig], NDArray[np.float32]]
    grey_levels: bool
    drawing: Literal["strokes", "grey"]
    legend: str


INPUTS: Registry[Input] = Registry("kind of input", ConfigError)
"""All kinds of input by name, the default one first."""


def _orientation_layout(encoder: EncoderConfig) -> Layout:
    return Layout(encoder.orientations, encoder.image_size // encoder.cell)


def _orientation_activity(image: NDArray[np.uint8], encoder: EncoderConfig) -> NDArray[np.float32]:
    return orientation_channels(
        image,
        encoder.image_size,
        encoder.cell,
        encoder.orientations,
        encoder.window,
        encoder.pool_floor,
        encoder.blur,
    )


INPUTS.register(
    Input(
        "orientation",
        layout=_orientation_layout,
        sees="image",
        activity=_orientation_activity,
        grey_levels=False,
        drawing="strokes",
        legend="A stroke runs along the edge that excites the neuron; the longer and stronger, the larger the weight.",
    )
)
INPUTS.register(
    Input(
        "onoff",
        layout=lambda encoder: Layout(2, PATCH_SIDE),
        sees="patch",
        activity=lambda patch, encoder: on_off(patch[None])[0],
        grey_levels=False,
        drawing="grey",
        legend="White: the neuron expects a pixel brighter than its surroundings; black: a darker one; grey: it does "
        "not care.",
    )
)
INPUTS.register(
    Input(
        "pixels",
        layout=lambda encoder: Layout(1, PATCH_SIDE),
        sees="patch",
        activity=lambda patch, encoder: patch.reshape(-1).astype(np.float32),
        grey_levels=True,
        drawing="grey",
        legend="The whiter a pixel, the larger its weight.",
    )
)
