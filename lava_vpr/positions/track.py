"""From a track to where each image of a traverse was taken."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.positions.frames import LAT_LON, Positions
from lava_vpr.positions.gpx import SUFFIX, read_gpx
from lava_vpr.positions.stamps import is_absolute, shown_stamp
from lava_vpr.positions.tables import Track, read_table
from lava_vpr.storage.text import shown

MOST_GAP_S = 10.0
"""Seconds between two positions, at most, between which images are placed on a straight line."""


@dataclass(frozen=True)
class PositionRequest:
    """Images whose positions are asked for.

    Attributes:
        indices: The absolute index of each in its whole sequence, int64 (n,).
        whole: Images in the whole sequence.
        stamps: When each was taken, in seconds, float64 (n,); None if nobody says.
    """

    indices: NDArray[np.int64]
    whole: int
    stamps: NDArray[np.float64] | None = None


def read_track(path: Path) -> Track:
    """The positions in a GPX file, or in any other as a CSV table.

    Raises:
        InputError: it cannot be used.
    """
    return read_gpx(path) if path.suffix.lower() == SUFFIX else read_table(path)


def images_on(
    track: Track, asked: PositionRequest, gap: float = MOST_GAP_S
) -> tuple[Positions, NDArray[np.float64] | None]:
    """Where images were taken, and when, as far as that is known.

    If both track and images have times, both since 1970 or both since a start of their own, each image is placed on the
    straight line between the points before and after it. Otherwise row k of the track is the image with absolute index
    k: a track with times must then have one row for each image of the whole sequence, which tells their times, too; one
    without may also have more.

    Args:
        track: Positions.
        asked: The images.
        gap: Most seconds between the points before and after an image.
    Raises:
        InputError: an image has no row, was taken outside the track or in a longer gap of it, or nothing tells which
            row belongs to which image.
    """
    stamps = asked.stamps
    if track.stamps is not None and stamps is not None and is_absolute(stamps) == is_absolute(track.stamps):
        return Positions(_between(track, track.stamps, asked, stamps, gap), track.positions.frame), stamps
    rows, where = len(track.positions), shown(track.path)
    if track.stamps is not None and rows != asked.whole:
        raise InputError(
            f"{where}: has {rows} positions with times for {asked.whole} images, {_untimed(stamps)}; say with --stamps "
            "when they were taken, or give a row for each image"
        )
    found = rows_of(track, asked.indices)
    return found, stamps if track.stamps is None else track.stamps[asked.indices]


def rows_of(track: Track, indices: NDArray[np.int64]) -> Positions:
    """The positions of images where row k of a track is the image with absolute index k, whatever its times say.

    Raises:
        InputError: an image has no row.
    """
    rows, last = len(track.positions), int(indices.max(initial=-1))
    if rows <= last:
        raise InputError(f"{shown(track.path)}: has {rows} positions, image {last} has none; give one a line")
    return track.positions.take(indices)


def _untimed(stamps: NDArray[np.float64] | None) -> str:
    """Why images are not placed by their times."""
    if stamps is None:
        return "of which nobody says when they were taken"
    kind = "since 1970" if is_absolute(stamps) else "since their own start"
    return f"whose times are seconds {kind}, and the track's are not"


def _between(
    track: Track, times: NDArray[np.float64], asked: PositionRequest, stamps: NDArray[np.float64], gap: float
) -> NDArray[np.float64]:
    """Coordinates of images between the points of a track, float64 (n, 2)."""
    where = shown(track.path)
    outside = (stamps < times[0]) | (stamps > times[-1])
    if outside.any():
        k = int(outside.argmax())
        span = f"{shown_stamp(times[0])}..{shown_stamp(times[-1])}"
        raise InputError(
            f"{where}: image {asked.indices[k]} was taken at {shown_stamp(stamps[k])} s, outside the track ({span}); "
            f"leave out images without a position ({int(outside.sum())} of {len(stamps)}), or correct --stamps"
        )
    after = np.searchsorted(times, stamps)  # the first point that is not before the image
    before = np.maximum(after - (times[after] > stamps), 0)
    wide = times[after] - times[before] > gap
    if wide.any():
        k = int(wide.argmax())
        length = times[after[k]] - times[before[k]]
        raise InputError(
            f"{where}: image {asked.indices[k]} was taken in a gap of {length:.1f} s between two positions "
            f"({int(wide.sum())} of {len(stamps)} images were), longer than {gap:g} s; complete the track, leave the "
            "images out, or allow more with --gap"
        )
    values = track.positions.values
    step = values[after] - values[before]
    if track.positions.frame == LAT_LON:  # the short way around the date line
        step[:, 1] = (step[:, 1] + 180.0) % 360.0 - 180.0
    passed = times[after] - times[before]
    share = np.divide(stamps - times[before], passed, out=np.zeros_like(passed), where=passed > 0)
    return np.asarray(values[before] + share[:, None] * step)
