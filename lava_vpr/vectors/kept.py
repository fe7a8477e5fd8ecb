"""What a model file keeps of the images or vectors that it learned, besides activity and thumbnails."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.inputs.patches import HOG_VALUES
from lava_vpr.inputs.vectors import LARGEST_VALUE, Standard, width_for
from lava_vpr.storage.arrays import ArrayRule, UnfitError

STANDARD = "standard."
"""What the names of the arrays begin with that vectors are measured by (`lava_vpr.inputs.vectors.Standard`)."""
_LEAST_SCALE = float(np.finfo(np.float32).tiny)


def seen_rules(encoder: EncoderConfig, images: int) -> dict[str, ArrayRule]:
    """What the arrays must be that are of images alone, or of vectors alone."""
    row, values = INPUTS[encoder.kind], encoder.vector_values
    if row.sees != "vector":
        return {
            "patches": ArrayRule("uint8", (images, 28, 28), most=255),
            "hog": ArrayRule("uint8", (images, HOG_VALUES), most=255),
        }
    rules = {"vectors": ArrayRule("float32", (images, values), least=-LARGEST_VALUE, most=LARGEST_VALUE)}
    if row.standardised:
        projects = values > encoder.vector_kept
        width, kept = (width_for(values), encoder.vector_kept) if projects else (0, 0)
        rules |= {
            f"{STANDARD}mean": ArrayRule("float32", (values,), least=-LARGEST_VALUE, most=LARGEST_VALUE),
            f"{STANDARD}scale": ArrayRule("float32", (values,), least=_LEAST_SCALE, most=LARGEST_VALUE),
            f"{STANDARD}signs": ArrayRule("int8", (width,), least=-1, most=1),
            f"{STANDARD}kept": ArrayRule("int32", (kept,), most=max(0, width - 1)),
        }
    return rules


def standard_of(arrays: Mapping[str, NDArray[Any]]) -> Standard | None:
    """What vectors are measured by, if the ``arrays`` of a model file hold it."""
    own = {name: array for name, array in arrays.items() if name.startswith(STANDARD)}
    return Standard(**{name.removeprefix(STANDARD): array for name, array in own.items()}) if own else None


def check_standard(arrays: Mapping[str, NDArray[Any]]) -> None:
    """Refuse signs that are none, and numbers of a transform that are not ascending.

    Raises:
        UnfitError: there are such.
    """
    standard = standard_of(arrays)
    if standard is not None and ((standard.signs == 0).any() or (np.diff(standard.kept) <= 0).any()):
        raise UnfitError("a projection with a sign of 0, or with numbers that do not ascend")
