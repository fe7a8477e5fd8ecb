"""What was learned of a season, and its file (``.lvps``), apart from the model: no query changes a map."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.engine.gains import FULL, MARGINS, RECENT, Season
from lava_vpr.errors import ConfigError, ModelFileError, shown
from lava_vpr.model import IntegerModel
from lava_vpr.modelfile import count
from lava_vpr.season.table import inputs_of
from lava_vpr.storage import container
from lava_vpr.storage.arrays import ArrayRule, UnfitError, check_arrays, check_keys

_MOST_RATE = 65535.0
_MOST_SUM = 1 << 50
"""More than rates of 16 bits can add up to while sums forget."""
_HASH = re.compile("[0-9a-f]{64}")


def unlearned(model: IntegerModel) -> Season:
    """The season of which nothing is known."""
    return Season.start(model.config.encoder.inputs, inputs_of(model))


def check_season(season: Season, model: IntegerModel) -> None:
    """Refuse a season of other inputs than those of ``model``.

    Raises:
        ConfigError: it is one.
    """
    if season.inputs_of != inputs_of(model):
        raise ConfigError(
            "the season was learned with other inputs than the model has (its encoder settings differ); "
            "learn it with this model"
        )


def save(season: Season, path: Path) -> None:
    """Write ``season`` to ``path``; the file appears complete or not at all.

    Raises:
        ModelFileError: it cannot be written; what stood at ``path`` still does.
    """
    header: dict[str, object] = {
        "version": __version__,
        "inputs_of": season.inputs_of,
        "answered": season.answered,
        "taught": season.taught,
    }
    arrays: dict[str, NDArray[Any]] = {
        "gains": season.gains,
        "sums": season.sums,
        "mean": season.mean,
        "margins": season.margins,
        "sure": season.sure,
    }
    container.save(path, "season", header, arrays)


def load(path: Path | str) -> Season:
    """The season in the file at ``path``.

    Raises:
        ModelFileError: missing, foreign, damaged, or inconsistent.
    """
    header, arrays = container.load(Path(path), "season")
    try:
        check_keys(header, ("version", "inputs_of", "answered", "taught"), (), "key {} in its header")
        known = header["inputs_of"]
        if not (isinstance(known, str) and _HASH.fullmatch(known)):
            raise UnfitError("inputs_of")
        answered = count(header["answered"], "answered", 0)
        taught = count(header["taught"], "taught", 0, answered)
        inputs, margins = arrays["gains"].size if "gains" in arrays else 0, min(answered, MARGINS)
        rules = {
            "gains": ArrayRule("uint8", (inputs,), 0, FULL),
            "sums": ArrayRule("int64", (3, inputs), -_MOST_SUM, _MOST_SUM),
            "mean": ArrayRule("float64", (inputs + 1,), 0, _MOST_RATE),
            "margins": ArrayRule("float64", (margins,), -1, _MOST_RATE),
            "sure": ArrayRule("uint8", (min(answered, RECENT),), 0, 1),
        }
        check_arrays(arrays, rules)
        if arrays["mean"][-1] > 1 or (arrays["sums"][:2] < 0).any():
            raise UnfitError("mean or sums")
    except UnfitError as error:
        remedy = container.REMEDIES["season"]
        raise ModelFileError(f"{shown(Path(path))}: the season {error.how} {error}; {remedy}") from None
    return Season(
        **{name: np.asarray(array) for name, array in arrays.items()}, inputs_of=known, answered=answered, taught=taught
    )
