"""Keyframes: which images of the references become places, where not every image does.

A robot that waits at a red light sees one place many times. By distance, an image becomes a place once the robot has
moved far enough from the place before; by change, once its input differs enough. Only the first traverse is thinned: of
every other, the images that show the same places are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import activity_of
from lava_vpr.errors import InputError
from lava_vpr.images.sampling import changed, spaced
from lava_vpr.inputs.vectors import Standard
from lava_vpr.positions.frames import Positions
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import NEAR_M


def nearest(places: Positions, images: Positions) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The image taken nearest to each place, int64 (places,), and how many metres away, float64 (places,).

    Raises:
        InputError: the frames of the two cannot be compared.
    """
    metres, found = cKDTree(images.to(places.frame).points()).query(places.points())
    return np.asarray(found, np.int64), np.asarray(metres, np.float64)


def choose_places(
    traverses: Sequence[Traverse],
    encoder: EncoderConfig,
    *,
    standard: Standard | None = None,
    spacing: float | None = None,
    change: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Traverse]:
    """The images of each traverse that show the places to be learned, equally many of each.

    Without ``spacing`` and ``change`` every image of the first traverse is a place. Of another traverse, the images
    with the same numbers are taken if every image is a place and both have equally many; else those nearest by
    position, where both have positions; else, again, those with the same numbers if both have equally many images.

    Args:
        traverses: Of one route.
        encoder: Settings, for the change of the input.
        standard: What vectors are measured by, for the same.
        spacing: Least metres between two places.
        change: Least change of the input between two places (`changed`); all images of the first traverse are read.
        progress: Called with 1 after every image that is read.
    Raises:
        InputError: positions are needed and missing, one place alone is left, another traverse was nowhere near a
            place, or nothing tells which of its images show the places.
    """
    first = traverses[0]
    kept: NDArray[np.int64] | None = None
    if spacing is not None:
        if first.positions is None:
            raise InputError(f"{shown(first.source)}: --spacing needs positions of its images; give --positions FILE")
        kept = spaced(first.positions.points(), spacing)
    elif change is not None:
        kept = changed(_activities(first, encoder, standard, progress), change)
    if kept is not None and len(kept) < 2:
        option = "--spacing" if spacing is not None else "--keyframes"
        raise InputError(f"{shown(first.source)}: with this {option} all {len(first)} images are one place; lower it")
    places = first if kept is None else first.take(kept.tolist())
    return [places, *(_showing(places, len(first), kept, other) for other in traverses[1:])]


def _activities(
    traverse: Traverse, encoder: EncoderConfig, standard: Standard | None, progress: Callable[[int], None] | None
) -> Iterable[NDArray[np.float32]]:
    """The activity of each image in turn."""
    for image in traverse.images():
        yield activity_of(image, encoder, standard=standard)
        if progress is not None:
            progress(1)


def _showing(places: Traverse, images: int, kept: NDArray[np.int64] | None, other: Traverse) -> Traverse:
    """The images of another traverse that show ``places``, ``kept`` of the ``images`` of the first."""
    if kept is None and len(other) == images:
        return other
    if places.positions is not None and other.positions is not None:
        try:
            found, metres = nearest(places.positions, other.positions)
        except InputError as error:
            raise InputError(f"{shown(other.source)}: {error}") from None
        k = int(metres.argmax())
        if metres[k] > NEAR_M:
            far = f"{int((metres > NEAR_M).sum())} of {len(metres)} places"
            raise InputError(
                f"{shown(other.source)}: no image was taken within {NEAR_M:g} m of {far} (image {places.indices[k]} of "
                f"{shown(places.source)}: {metres[k]:.1f} m); choose the part of the route that both show, with "
                "--places A:B or lists of images"
            )
        return other.take(found.tolist())
    if kept is None:
        return other  # as many as it has: `check_references` tells
    if len(other) == images:
        return other.take(kept.tolist())
    raise InputError(
        f"{shown(other.source)}: has {len(other)} images, {shown(places.source)} has {images}: nothing tells which of "
        "them show the places; give --positions for each reference, or lists of matching images"
    )
