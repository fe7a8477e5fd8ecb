"""Kinds of input, one row each: which channels look at an image, and how they respond.

Everything that belongs to a kind of input is in its row: how many channels there are, how they respond to an image, how
a report draws what a neuron has learned about them. A new kind is a function and a row in `INPUTS`: settings, commands,
files and reports ask for the row.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.inputs.filters import filter_channels, parsed
from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.inputs.patches import PATCH_SIDE, on_off
from lava_vpr.inputs.vectors import as_rates, signed_channels, without_weak
from lava_vpr.inputs.windows import saturated
from lava_vpr.rows.registry import Registry
from lava_vpr.settings.ranges import Range, check, need


@dataclass(frozen=True)
class EncoderConfig:
    """How an image becomes spike probabilities.

    Attributes:
        kind: Name of a row in `INPUTS`: ``orientation`` (complex-cell edge channels), ``onoff`` or ``pixels`` (the
            paper's patch-normalised ones), ``events`` (``orientation`` of images of events), or ``filters`` (a learned
            convolutional layer in place of orientations); or of descriptors in place of images ``vector`` or ``rates``.
        image_size: Side in pixels of the square image that the orientation channels are computed on.
        cell: Side in pixels of one pooling cell; ``image_size`` must be a multiple of it.
        orientations: Number of orientations, evenly spaced over 180 degrees.
        window: Side in pixels of the divisive-normalisation window, odd.
        blur: Standard deviation in pixels of the Gaussian that the resized image is smoothed with; 0: none.
        pool_floor: Share of the image's mean edge energy that is added to each window's.
        train_spikes: Expected input spikes per step while training ("tot"), all inputs together.
        query_spikes: Expected input spikes per step while answering a query.
        query_inputs: Only so many inputs, those that respond most, spike while answering a query; 0: all.
        filters: What the layer of ``filters`` has learned (`lava_vpr.inputs.filters.written`); empty: train learns it.
        saturation: ``events``: share of the pixels that are not 0 that keep their level; what is above is cut.
        max_rate_hz: ``pixels`` under the ``paper`` preset: rate of a white pixel, in Hz.
        vector_values: Values of a vector as it is given; training takes it from the references. 0: not known yet.
        vector_kept: Most values that ``vector`` has inputs for, two for each; longer vectors are projected on so many.
        vector_scale: What ``vector`` divides values by, once the mean of the references is off: one scale ``shared`` by
            all, or each by its ``own``.
        vector_dead_zone: What ``vector`` takes off the magnitude of each value, in units of the mean magnitude of the
            vector.
    """

    kind: str = "orientation"
    image_size: Annotated[int, Range(8, 512)] = 64
    cell: Annotated[int, Range(1, 512)] = 4
    orientations: Annotated[int, Range(2, 16)] = 8
    window: Annotated[int, Range(3, 255, only="odd")] = 17
    pool_floor: Annotated[float, Range(0, 100)] = 0.1
    blur: Annotated[float, Range(0, 50)] = 0.7
    train_spikes: Annotated[float, Range(0, 1000, "least")] = 12.0
    query_spikes: Annotated[float, Range(0, 1000, "least")] = 20.0
    query_inputs: Annotated[int, Range(0, 1_000_000)] = 520
    saturation: Annotated[float, Range(0, 1, "least")] = 0.8
    max_rate_hz: Annotated[float, Range(0, 1000, "least")] = 63.75
    vector_values: Annotated[int, Range(0, 1_000_000)] = 0
    vector_kept: Annotated[int, Range(1, 1_000_000)] = 1984
    vector_scale: Literal["shared", "own"] = "shared"
    vector_dead_zone: Annotated[float, Range(0, 10)] = 0.5
    filters: str = ""

    def __post_init__(self) -> None:
        check(self, "encoder")
        if self.kind not in INPUTS:
            need(False, "encoder.kind", self.kind, f"one of {', '.join(INPUTS.names())}{INPUTS.elsewhere}")
        need(self.cell <= self.image_size, "encoder.cell", self.cell, "in 1..image_size")
        need(self.image_size % self.cell == 0, "encoder.image_size", self.image_size, f"a multiple of {self.cell}")
        if self.filters:
            parsed(self.filters, self.orientations)

    @property
    def layout(self) -> ChannelLayout:
        """The arrangement of the inputs."""
        return INPUTS[self.kind].layout(self)

    @property
    def inputs(self) -> int:
        """The number of input neurons."""
        return self.layout.inputs


class ChannelLayout(NamedTuple):
    """Inputs as channels over a square grid, ordered channel, row, column.

    Attributes:
        channels: Channels at each point of the grid.
        grid: Side of the grid.
        points: Points that each channel has, where those fill the grid but for its end; 0: all of it.
    """

    channels: int
    grid: int
    points: int = 0

    @property
    def inputs(self) -> int:
        """The number of inputs, over all channels."""
        return self.channels * (self.points or self.grid**2)


@dataclass(frozen=True)
class Input:
    """A kind of input: its channels, how they respond, and how a report draws them.

    Attributes:
        name: How options and settings call it.
        layout: The channels under given settings.
        sees: What `activity` is given: the ``image`` as it was read, uint8 (h, w) or (h, w, 3) BGR, or its
            patch-normalised form, the ``patch``, uint8 (28, 28); or a ``vector``, float32 (values,).
        activity: Responses of the channels, float32 (inputs,), at least 0, ordered as in `ChannelLayout`.
        grey_levels: Whether responses are grey levels 0..255, which the conductance network takes as rates.
        drawing: How a report draws what a neuron has learned: ``strokes``, one for each channel along the edge that
            excites it, where channel k of K belongs to a gradient at 180 k / K degrees, the y axis pointing down; or
            ``grey`` levels of the only channel, or of the difference between the first and the second.
        legend: What the report says about these drawings, a sentence.
        standardised: Whether vectors are measured by what was fitted on the references
            (`lava_vpr.inputs.vectors.Standard`) before `activity` is given them.
    """

    name: str
    layout: Callable[[EncoderConfig], ChannelLayout]
    sees: Literal["image", "patch", "vector"]
    activity: Callable[[NDArray[Any], EncoderConfig], NDArray[np.float32]]
    grey_levels: bool
    drawing: Literal["strokes", "grey"]
    legend: str
    standardised: bool = False


INPUTS: Registry[Input] = Registry("kind of input", ConfigError, group="lava_vpr.inputs", row_class=Input)
"""All kinds of input by name, the default one first."""


def _orientation_layout(encoder: EncoderConfig) -> ChannelLayout:
    return ChannelLayout(encoder.orientations, encoder.image_size // encoder.cell)


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


def _line(channels: int, values: int) -> ChannelLayout:
    """So many channels of so many values, row by row in the smallest square that holds them."""
    return ChannelLayout(channels, math.isqrt(max(0, values - 1)) + 1 if values else 0, values)


for _row in (
    Input(
        "orientation",
        layout=_orientation_layout,
        sees="image",
        activity=_orientation_activity,
        grey_levels=False,
        drawing="strokes",
        legend="A stroke runs along the edge that excites the neuron; the longer and stronger, the larger the weight.",
    ),
    Input(
        "filters",
        layout=_orientation_layout,
        sees="image",
        activity=lambda image, encoder: filter_channels(
            image,
            encoder.image_size,
            encoder.cell,
            encoder.orientations,
            encoder.window,
            encoder.pool_floor,
            encoder.blur,
            encoder.filters,
        ),
        grey_levels=False,
        drawing="strokes",
        legend="A stroke stands for a learned filter, drawn along the edge that filters of its number start from; the "
        "longer and stronger, the larger the weight.",
    ),
    Input(
        "onoff",
        layout=lambda encoder: ChannelLayout(2, PATCH_SIDE),
        sees="patch",
        activity=lambda patch, encoder: on_off(patch[None])[0],
        grey_levels=False,
        drawing="grey",
        legend="White: the neuron expects a pixel brighter than its surroundings; black: a darker one; grey: it does "
        "not care.",
    ),
    Input(
        "pixels",
        layout=lambda encoder: ChannelLayout(1, PATCH_SIDE),
        sees="patch",
        activity=lambda patch, encoder: patch.reshape(-1).astype(np.float32),
        grey_levels=True,
        drawing="grey",
        legend="The whiter a pixel, the larger its weight.",
    ),
    Input(
        "events",
        layout=_orientation_layout,
        sees="image",
        activity=lambda image, encoder: _orientation_activity(saturated(image, encoder.saturation), encoder),
        grey_levels=False,
        drawing="strokes",
        legend="A stroke runs along the edge whose events excite the neuron; the longer and stronger, the larger the "
        "weight.",
    ),
    Input(
        "vector",
        layout=lambda encoder: _line(2, min(encoder.vector_values, encoder.vector_kept)),
        sees="vector",
        activity=lambda values, encoder: signed_channels(without_weak(values, encoder.vector_dead_zone)),
        grey_levels=False,
        drawing="grey",
        legend="The values of a vector, row by row. White: the neuron expects more than the mean of the references; "
        "black: less; grey: it does not care.",
        standardised=True,
    ),
    Input(
        "rates",
        layout=lambda encoder: _line(1, encoder.vector_values),
        sees="vector",
        activity=lambda values, encoder: as_rates(values),
        grey_levels=False,
        drawing="grey",
        legend="The values of a vector, row by row: the whiter, the larger the weight.",
    ),
):
    INPUTS.register(_row)
