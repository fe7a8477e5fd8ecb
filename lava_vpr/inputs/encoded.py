"""What is kept of images, or of vectors, once they are read and encoded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Flag, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.inputs.patches import HOG_VALUES, PATCH_SIDE

THUMBNAIL = (64, 48)
"""Width and height in pixels of the small colour images kept for reports."""


class Keep(Flag):
    """What is kept beside the activity: what SAD and HOG compare of images, vectors themselves, what reports show."""

    NOTHING = 0
    PATCHES = auto()
    THUMBNAILS = auto()
    HOG = auto()
    VECTORS = auto()
    ALL = PATCHES | THUMBNAILS | HOG | VECTORS


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
    """

    names: tuple[str, ...]
    indices: NDArray[np.int64]
    activity: NDArray[np.float32]
    patches: NDArray[np.uint8] | None = None
    thumbnails: NDArray[np.uint8] | None = None
    hog: NDArray[np.uint8] | None = None
    vectors: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.names)

    def take(self, chosen: slice | NDArray[np.int64]) -> EncodedTraverse:
        """Some of the images, in the order of ``chosen``, with their absolute indices."""
        arrays = ("patches", "thumbnails", "hog", "vectors")
        kept = {name: array[chosen] for name in arrays if (array := getattr(self, name)) is not None}
        order = np.arange(len(self))[chosen].tolist()
        names = tuple(self.names[k] for k in order)
        return replace(self, names=names, indices=self.indices[chosen], activity=self.activity[chosen], **kept)

    def kept(self, part: Keep, purpose: str) -> NDArray[Any]:
        """One part of what may be kept, seen to be there, as the attribute of its name holds it.

        Args:
            part: The part.
            purpose: Who needs it; the message begins with it.
        Raises:
            InputError: it was not kept.
        """
        found: NDArray[Any] | None = getattr(self, str(part.name).lower())
        if found is None:
            what = "HOG descriptors" if part is Keep.HOG else str(part.name).lower()
            raise InputError(f"{purpose}: needs the images' {what}, which were not kept; encode them with {part}")
        return found


def check_encoded(encoded: EncodedTraverse, encoder: EncoderConfig, what: str) -> None:
    """Refuse images that were not encoded with ``encoder``, or whose parts are not what `EncodedTraverse` says.

    Compiled code goes through these arrays without looking at their ends.

    Args:
        encoded: Images from wherever.
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
    for name, array, dtype, shape in parts:
        if array is not None and (array.dtype != dtype or array.shape != shape):
            raise InputError(
                f"{what} have {name} of type {array.dtype} and shape {array.shape}, not {np.dtype(dtype)} {shape}; "
                "encode them anew"
            )
    most = 255 if INPUTS[encoder.kind].grey_levels else np.finfo(np.float32).max
    with np.errstate(invalid="ignore"):  # NaN fits no range
        fits = activity.size == 0 or (activity.min() >= 0 and activity.max() <= most)
    if not fits or encoded.indices.min(initial=0) < 0:
        wrong = "indices below 0" if fits else f"activity that is not in 0..{most:g}"
        raise InputError(f"{what} have {wrong}; encode them anew")
