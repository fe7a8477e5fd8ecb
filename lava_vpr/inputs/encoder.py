"""Kinds of input, one row each: which channels look at an image, and how they respond.

Everything that belongs to a kind of input is in its row: the number of channels, their response to an image, and how a
report draws what a neuron has learned about them. A new kind is a function and a row in `INPUTS`: settings, commands,
files and reports use the row. `Keep` says what is kept of images, or of vectors, after they are encoded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Flag, auto
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_settings import EVENT_FRONT_END, front_end
from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.inputs.patches import HOG_VALUES, PATCH_SIDE, on_off
from lava_vpr.inputs.vectors import as_rates, signed_channels, without_weak
from lava_vpr.inputs.windows import saturated
from lava_vpr.rows.registry import Registry
from lava_vpr.settings.ranges import Range, check, need


@dataclass(frozen=True)
class EncoderConfig:
    """How an image becomes spike probabilities.

    Attributes:
        kind: Name of a row in `INPUTS`: ``orientation`` (complex-cell edge channels), ``frontend`` (the spiking front
            end, whose settings are the next two), ``frontend-direct`` (the same, whose cells' spikes reach the neurons
            of places as they come), ``frontend-events`` (``frontend`` of another length, which events drive), ``onoff``
            or ``pixels`` (the paper's patch-normalised ones), or ``events`` (``orientation`` of images of events); or
            of descriptors in place of images ``vector`` or ``rates``.
        pixel_levels: ``frontend``: levels of a pixel, one a step of a presentation.
        race_steps: ``frontend``: steps of a presentation in which filters spike.
        direct_levels, direct_race: The same of ``frontend-direct``.
        read_steps: ``frontend-direct``: steps after the cells' last spikes in which neurons spike.
        read_threshold, read_inhibition: ``frontend-direct``: threshold of the neurons, in steps of the drive, and what
            the root takes, in thresholds; of `LifNetwork` they are for inputs that have rates.
        image_size: Side in pixels of the square image that the orientation channels are computed on.
        cell: Side in pixels of one pooling cell; ``image_size`` must be a multiple of it.
        orientations: Number of orientations, evenly spaced over 180 degrees.
        window: Side in pixels of the divisive-normalisation window, odd.
        blur: Standard deviation in pixels of the Gaussian that the resized image is smoothed with; 0: none.
        pool_floor: Share of the image's mean edge energy that is added to that of each window.
        train_spikes: Expected input spikes per step while training ("tot"), all inputs together; see `learning_spikes`.
        query_spikes: Expected input spikes per step while answering a query.
        query_inputs: Number of inputs that may spike while answering a query, those that respond most; 0: all.
        saturation: ``events``: share of the pixels that are not 0 that keep their level; what is above is cut.
        max_rate_hz: ``pixels`` under the ``paper`` preset: rate of a white pixel, in Hz.
        vector_values: Number of values of a given vector; training takes it from the references. 0: not known yet.
        vector_kept: Maximum number of values for which ``vector`` has inputs, two for each; longer vectors are
            projected on that many.
        vector_scale: Scale by which ``vector`` divides values after subtracting the mean of the references: one
            ``shared`` by all, or each value's ``own``.
        vector_dead_zone: Amount that ``vector`` subtracts from the magnitude of each value, in units of the vector's
            mean magnitude.
    """

    kind: str = "orientation"
    pixel_levels: Annotated[int, Range(2, 40)] = FrontEnd.levels
    race_steps: Annotated[int, Range(2, 16)] = FrontEnd.race
    direct_levels: Annotated[int, Range(2, 40)] = 22
    direct_race: Annotated[int, Range(2, 16)] = 14
    read_steps: Annotated[int, Range(1, 32)] = 8
    read_threshold: Annotated[float, Range(0, 1000, "least")] = 4.2
    read_inhibition: Annotated[float, Range(0, 10)] = 0.17
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

    def __post_init__(self) -> None:
        check(self, "encoder")
        if self.kind not in INPUTS:
            need(False, "encoder.kind", self.kind, f"one of {', '.join(INPUTS.names())}{INPUTS.elsewhere}")
        need(self.cell <= self.image_size, "encoder.cell", self.cell, "in 1..image_size")
        need(self.image_size % self.cell == 0, "encoder.image_size", self.image_size, f"a multiple of {self.cell}")

    @property
    def layout(self) -> ChannelLayout:
        """The arrangement of the inputs."""
        return INPUTS[self.kind].layout(self)

    @property
    def inputs(self) -> int:
        """The number of input neurons."""
        return self.layout.inputs

    @property
    def direct(self) -> FrontEnd | None:
        """The front end whose cells the neurons of places hear themselves; None: inputs have rates."""
        before = self.front_end
        return before if before is not None and before.reading else None

    @property
    def front_end(self) -> FrontEnd | None:
        """The spiking front end whose cells' spikes are the activity; None: nothing spikes before the inputs."""
        made = INPUTS[self.kind].front_end
        return None if made is None else made(self)

    @property
    def learning_spikes(self) -> float:
        """Expected input spikes per step while training: `train_spikes`, for the orientations that a front end has."""
        return self.train_spikes * (self.front_end.orientations / self.orientations if self.front_end else 1.0)


class ChannelLayout(NamedTuple):
    """Inputs as channels over a square grid, ordered channel, row, column.

    Attributes:
        channels: Channels at each point of the grid.
        grid: Side of the grid.
        points: Points of each channel, if they fill all of the grid except its end; 0: all of it.
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
        name: Its name in options and settings.
        layout: The channels under given settings.
        sees: What `activity` is given: the ``image`` as it was read, uint8 (h, w) or (h, w, 3) BGR, or its
            patch-normalised form, the ``patch``, uint8 (28, 28); or a ``vector``, float32 (values,).
        activity: Responses of the channels, float32 (inputs,), at least 0, ordered as in `ChannelLayout`.
        grey_levels: Whether responses are grey levels 0..255, which the conductance network takes as rates.
        drawing: How a report draws what a neuron has learned: ``strokes``, one for each channel along the edge that
            excites it, where channel k of K belongs to a gradient at 180 k / K degrees, the y axis pointing down; or
            ``grey`` levels of the only channel, or of the difference between the first and the second.
        legend: What the report says about these drawings, a sentence.
        oriented: Whether channel k of K responds to gradients at 180 k / K degrees and to nothing where there are none,
            as `lava_vpr.inputs.likeness` takes for granted.
        standardised: Whether vectors are measured by what was fitted on the references
            (`lava_vpr.inputs.vectors.Standard`) before `activity` is given them.
        front_end: Makes the spiking front end whose cells' spikes are the activity; None: there is none.
    """

    name: str
    layout: Callable[[EncoderConfig], ChannelLayout]
    sees: Literal["image", "patch", "vector"]
    activity: Callable[[NDArray[Any], EncoderConfig], NDArray[np.float32]]
    grey_levels: bool
    drawing: Literal["strokes", "grey"]
    legend: str
    standardised: bool = False
    oriented: bool = False
    front_end: Callable[[EncoderConfig], FrontEnd] | None = None


INPUTS: Registry[Input] = Registry("kind of input", ConfigError, group="lava_vpr.inputs", row_class=Input)
"""All kinds of input by name, the default one first."""


def _orientation_layout(encoder: EncoderConfig) -> ChannelLayout:
    return ChannelLayout(encoder.orientations, encoder.image_size // encoder.cell)


def _orientation_activity(image: NDArray[np.uint8], encoder: EncoderConfig) -> NDArray[np.float32]:
    return orientation_channels(
        image, encoder.image_size, encoder.cell, encoder.orientations, encoder.window, encoder.pool_floor, encoder.blur
    )


def _line(channels: int, values: int) -> ChannelLayout:
    """So many channels of so many values, row by row in the smallest square that holds them."""
    return ChannelLayout(channels, math.isqrt(max(0, values - 1)) + 1 if values else 0, values)


def spiking_input(name: str, made: Callable[[EncoderConfig], FrontEnd], legend: str) -> Input:
    """The kind of input whose activity is the spikes of the cells of the front end that settings make."""
    return Input(
        name,
        layout=lambda encoder: ChannelLayout(made(encoder).orientations, made(encoder).grid),
        sees="image",
        activity=lambda image, encoder: _cells(made(encoder), image),
        grey_levels=False,
        drawing="strokes",
        legend=legend,
        oriented=True,
        front_end=made,
    )


def _cells(spec: FrontEnd, image: NDArray[np.uint8]) -> NDArray[np.float32]:
    return (spec.bursts(image) if spec.reading else spec.spikes(image)[0].astype(np.float32)).reshape(-1)


STROKES = "A stroke runs along the edge that excites the neuron; the longer and stronger, the larger the weight."
EVENT_STROKES = STROKES.replace("the edge that excites", "the edge whose events excite")

for _row in (
    Input(
        "orientation",
        layout=_orientation_layout,
        sees="image",
        activity=_orientation_activity,
        grey_levels=False,
        drawing="strokes",
        legend=STROKES,
        oriented=True,
    ),
    spiking_input("frontend", lambda encoder: front_end(encoder.pixel_levels, encoder.race_steps), STROKES),
    spiking_input(
        "frontend-direct",
        lambda encoder: front_end(encoder.direct_levels, encoder.direct_race, encoder.read_steps),
        STROKES,
    ),
    spiking_input("frontend-events", lambda encoder: EVENT_FRONT_END, EVENT_STROKES),
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
        legend=EVENT_STROKES,
        oriented=True,
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


THUMBNAIL = (64, 48)
"""Width and height in pixels of the small colour images kept for reports."""


class Keep(Flag):
    """What is kept beside the activity: what SAD and HOG compare of images, vectors themselves, what reports show, what
    the pixels of a spiking front end take."""

    NOTHING = 0
    PATCHES = auto()
    THUMBNAILS = auto()
    HOG = auto()
    VECTORS = auto()
    GREY = auto()
    ALL = PATCHES | THUMBNAILS | HOG | VECTORS | GREY


@dataclass(frozen=True)
class EncodedTraverse:
    """What is kept of images once they are read; of vectors, there are neither patches nor HOG descriptors.

    Attributes:
        names: File name of each image.
        indices: Absolute index of each image in its sequence, int64 (n,).
        activity: Responses of the input channels, float32 (n, inputs), at least 0.
        patches: Patch-normalised images, uint8 (n, 28, 28); None unless they were to be kept.
        thumbnails: Small BGR images for reports, uint8 (n, 48, 64, 3); None unless they were to be kept.
        hog: HOG descriptors, uint8 (n, 1764); None unless they were to be kept.
        vectors: The vectors as they were given, float32 (n, values); None of images, or unless they were to be kept.
        grey: What the pixels of a spiking front end take, uint8 (n, height, width); None where there is none, or unless
            they were to be kept.
    """

    names: tuple[str, ...]
    indices: NDArray[np.int64]
    activity: NDArray[np.float32]
    patches: NDArray[np.uint8] | None = None
    thumbnails: NDArray[np.uint8] | None = None
    hog: NDArray[np.uint8] | None = None
    vectors: NDArray[np.float32] | None = None
    grey: NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        return len(self.names)

    def take(self, chosen: slice | NDArray[np.int64]) -> EncodedTraverse:
        """Some of the images, in the order of ``chosen``, with their absolute indices."""
        arrays = ("patches", "thumbnails", "hog", "vectors", "grey")
        kept = {name: array[chosen] for name in arrays if (array := getattr(self, name)) is not None}
        order = np.arange(len(self))[chosen].tolist()
        names = tuple(self.names[k] for k in order)
        return replace(self, names=names, indices=self.indices[chosen], activity=self.activity[chosen], **kept)

    def kept(self, part: Keep, purpose: str) -> NDArray[Any]:
        """One of the optional parts, checked to be there.

        Args:
            part: The part.
            purpose: Who needs it; the message begins with it.
        Raises:
            InputError: it was not kept.
        """
        found: NDArray[Any] | None = getattr(self, str(part.name).lower())
        if found is None:
            words = {Keep.HOG: "HOG descriptors", Keep.GREY: "grey pixels"}
            what = words.get(part, str(part.name).lower())
            raise InputError(f"{purpose}: needs the images' {what}, which were not kept; encode them with {part}")
        return found


def check_encoded(encoded: EncodedTraverse, encoder: EncoderConfig, what: str) -> None:
    """Refuse images that were not encoded with ``encoder``, or whose parts are not what `EncodedTraverse` says.

    Compiled code goes through these arrays without looking at their ends.

    Args:
        encoded: Images from any source.
        encoder: The settings of the model.
        what: The images in a word, which the message begins with.
    Raises:
        InputError: naming the first part that does not fit.
    """
    n, inputs = len(encoded), encoder.inputs
    activity = encoded.activity
    if activity.ndim == 2 and activity.shape[1] != inputs:
        raise InputError(
            f"{what} have {activity.shape[1]} inputs, the model {inputs}; encode them with the model's own settings"
        )
    parts: list[tuple[str, NDArray[Any] | None, type, tuple[int, ...]]] = [
        ("activity", activity, np.float32, (n, inputs)),
        ("indices", encoded.indices, np.int64, (n,)),
        ("patches", encoded.patches, np.uint8, (n, PATCH_SIDE, PATCH_SIDE)),
        ("thumbnails", encoded.thumbnails, np.uint8, (n, THUMBNAIL[1], THUMBNAIL[0], 3)),
        ("hog", encoded.hog, np.uint8, (n, HOG_VALUES)),
        ("vectors", encoded.vectors, np.float32, (n, encoder.vector_values)),
    ]
    if (before := encoder.front_end) is not None:
        parts.append(("grey", encoded.grey, np.uint8, (n, *before.shape)))
    for name, array, dtype, shape in parts:
        if array is not None and (array.dtype != dtype or array.shape != shape):
            raise InputError(
                f"{what} have {name} of type {array.dtype} and shape {array.shape}, not {np.dtype(dtype)} {shape}; "
                "encode them again"
            )
    most = 255 if INPUTS[encoder.kind].grey_levels else np.finfo(np.float32).max
    with np.errstate(invalid="ignore"):  # NaN fits no range
        fits = activity.size == 0 or (activity.min() >= 0 and activity.max() <= most)
    if not fits or encoded.indices.min(initial=0) < 0:
        wrong = "indices below 0" if fits else f"activity that is not in 0..{most:g}"
        raise InputError(f"{what} have {wrong}; encode them again")
