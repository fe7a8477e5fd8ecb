"""The gains that a season has taught: a picture over the image of a place, and the number of inputs by gain."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.gains import FULL, Season
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.model import Model
from lava_vpr.report.images import data_uri
from lava_vpr.show.numbers import percent
from lava_vpr.show.page import Section
from lava_vpr.show.table import Table

_PICTURE = (640, 480)
_BOUNDS = (0, 1, 4, 8, 12, FULL + 1)
_NOTE = (
    "Yellow: what the camera shows there tells at sure answers what it told when the place was learned. Blue: it "
    "does not, and counts less. Means over all directions of edges, over the image of the map's middle place."
)


class Trusted(NamedTuple):
    """The gains of a season, as pages show them.

    Attributes:
        gains: Table of the number of inputs by gain.
        picture: Gains over the image of a place (`trusted`); None if inputs see no image.
    """

    gains: Table
    picture: NDArray[np.uint8] | None

    @classmethod
    def of(cls, model: Model, season: Season | None) -> Trusted | None:
        """The gains of ``season`` for ``model``; None without a season."""
        if season is None:
            return None
        sees = INPUTS[model.config.encoder.kind].sees != "vector"
        return cls(gains_table(season), trusted(model, season.gains) if sees else None)


def trusted(model: Model, gains: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mean gains over the image of the model's middle place, uint8 (480, 640, 3) BGR.

    The image is grey; yellow covers it where gains are highest, and blue where they are lowest.

    Args:
        model: The model.
        gains: Gain of each input, uint8 (inputs,).
    Raises:
        ConfigError: the model's inputs see no image.
    """
    encoder = model.config.encoder
    if INPUTS[encoder.kind].sees == "vector":
        raise ConfigError("vectors show no image that gains could be drawn over")
    channels, grid, _ = encoder.layout
    means = gains.reshape(channels, grid, grid).mean(axis=0, dtype=np.float32)
    levels = np.rint(255 * (1 - (means.max() - means) / max(float(np.ptp(means)), 1.0))).astype(np.uint8)
    colours = cv2.applyColorMap(cv2.resize(levels, _PICTURE, interpolation=cv2.INTER_NEAREST), cv2.COLORMAP_CIVIDIS)
    image = cv2.resize(model.thumbnails[model.places // 2], _PICTURE, interpolation=cv2.INTER_LINEAR_EXACT)
    image = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(cv2.addWeighted(image, 0.4, colours, 0.6, 0), np.uint8)


def gains_table(season: Season) -> Table:
    """A table of the number of inputs by gain."""
    rows = []
    for first, end in itertools.pairwise(_BOUNDS):
        inputs = int(np.count_nonzero((season.gains >= first) & (season.gains < end)))
        name = f"{first}" if end == first + 1 else f"{first} to {end - 1}"
        rows.append((name, f"{inputs:,}", percent(inputs / season.gains.size)))
    notes = (f"{season.answered:,} answers, of which {season.taught:,} taught",)
    return Table((f"gain, of {FULL}", "inputs", "%"), rows, notes, "what survives the season")


def section(found: Trusted | None) -> Section:
    """The section of a page; without content if there is no season."""
    if found is None:
        return Section("season", "Season", [])
    parts: list[str | Table] = [found.gains]
    if found.picture is not None:
        alt = "The image of a place, yellow where inputs are trusted, blue where they are not"
        image = f'<img src="{data_uri(found.picture)}" width="640" height="480" alt="{alt}">'
        parts.insert(0, f'<div class="panel trusted">{image}</div>')
    return Section("season", "Season", parts, "What the map has learned to trust", _NOTE if len(parts) > 1 else "")
