"""Positions of images from files: tables of positions and stamps, GPX (`lava_vpr.positions.gpx`), interpolated on a
track.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief, shown
from lava_vpr.positions.frames import (
    LAT_LON,
    XY,
    Positions,
    columns,
    fits,
    in_seconds,
    is_absolute,
    shown_stamp,
    stamp_of,
)
from lava_vpr.storage.tables import csv_rows

_PAIRS = {
    ("x", "y"): XY,
    ("easting", "northing"): XY,
    ("lat", "lon"): LAT_LON,
    ("latitude", "longitude"): LAT_LON,
    ("lat", "lng"): LAT_LON,
}
_TIMES = ("time", "timestamp", "stamp", "t")
_WORDS = {"lat": "latitude", "lon": "longitude", "x": "x", "y": "y"}


class Track(NamedTuple):
    """Positions in the order in which they were taken.

    Attributes:
        positions: The positions, n of them.
        stamps: Times in seconds, never decreasing, float64 (n,); None if unknown.
        path: The file that they are from, for messages.
    """

    positions: Positions
    stamps: NDArray[np.float64] | None
    path: Path


def read_table(path: Path) -> Track:
    """The positions in a CSV file, and their times if it has a column of them.

    Columns x,y (or easting,northing) are metres, lat,lon (latitude,longitude) degrees; time (timestamp, stamp, t) is in
    seconds or a date (`lava_vpr.positions.frames`). Without a header there are two columns, x and y. Other
    columns are ignored.

    Raises:
        InputError: unreadable, no such columns, a cell that is no number in its range, or a time before the one above;
            names file and line.
    """
    groups = [(*pair, *time) for pair in _PAIRS for time in (*((name,) for name in _TIMES), ())]
    needed = "columns x,y or lat,lon"
    rows, names, places = _taken(
        path, "positions", needed, groups, ("x", "y"), lambda cells: all(map(_is_number, cells))
    )
    frame = _PAIRS[names[0], names[1]]
    values = np.array([[_number(cells[place]) for place in places[:2]] for _, cells in rows], np.float64)
    good = fits(values, frame)
    if not good.all():
        k, axis = np.argwhere(~good)[0].tolist()
        line, cells = rows[k]
        what = _WORDS[columns(frame)[axis]]
        raise InputError(
            f"{shown(path)} line {line}: {what} is {brief(cells[places[axis]])}; give a number in its range"
        )
    return Track(Positions(values, frame), _times(path, rows, places[2]) if len(places) > 2 else None, path)


def read_stamps(path: Path) -> NDArray[np.float64]:
    """The times in a CSV file, in seconds, float64 (rows,): its column of times, or its only one.

    Raises:
        InputError: unreadable, no such column, or a cell that is no time; names file and line.
    """
    groups = [(name,) for name in _TIMES]
    rows, _, places = _taken(path, "times", "column time", groups, ("time",), lambda cells: any(map(_is_time, cells)))
    return _times(path, rows, places[0])


def _taken(
    path: Path,
    what: str,
    needed: str,
    groups: Sequence[tuple[str, ...]],
    plain: tuple[str, ...],
    is_plain: Callable[[list[str]], bool],
) -> tuple[list[tuple[int, list[str]]], tuple[str, ...], list[int]]:
    """The rows of a CSV table below its header, and the names and numbers of the columns in use.

    Args:
        path: The table.
        what, needed: What it holds, and the columns that it must have, for messages.
        groups: The names in a header of columns that can be taken together, the best first.
        plain: The names of the columns of a table without a header.
        is_plain: Whether the cells of the first row are no header.
    """
    rows, names, places = csv_rows(path), plain, list(range(len(plain)))
    where = f"{shown(path)} line {rows[0][0]}" if rows else ""
    if rows and not is_plain(rows[0][1]):
        header = [cell.lower() for cell in rows[0][1]]
        found = next((group for group in groups if set(group) <= set(header)), None)
        if found is None:
            them = "them" if len(plain) > 1 else "it"
            raise InputError(f"{where}: no {needed} among {_some(header)}; name {them}")
        for name in found:
            if header.count(name) > 1:
                raise InputError(f"{where}: has {header.count(name)} columns {name!r}; rename all but one")
        rows, names, places = rows[1:], found, [header.index(name) for name in found]
    elif rows and len(rows[0][1]) != len(plain):
        raise InputError(f"{where}: has {len(rows[0][1])} columns and no header; add one: {','.join(plain)}")
    if not rows:
        raise InputError(f"{shown(path)}: holds no {what}; write one row an image, {needed}")
    return rows, names, places


def _times(path: Path, rows: list[tuple[int, list[str]]], column: int) -> NDArray[np.float64]:
    """A column of times, each not before the previous one."""
    stamps = np.array([stamp_of(cells[column]) for _, cells in rows], np.float64)
    bad = np.flatnonzero(~np.isfinite(stamps))
    if len(bad):
        line, cells = rows[int(bad[0])]
        raise InputError(
            f"{shown(path)} line {line}: the time is {brief(cells[column])}; write seconds, or a date as in "
            "2024-05-01T12:00:00Z"
        )
    back = np.flatnonzero(np.diff(stamps) < 0)
    if len(back):
        line, cells = rows[int(back[0]) + 1]
        raise InputError(
            f"{shown(path)} line {line}: the time {brief(cells[column])} is before that above; sort the rows"
        )
    return in_seconds(stamps)


def _some(header: list[str]) -> str:
    """The first names of a header, for a message."""
    return ", ".join(map(brief, header[:8])) + (", ..." if len(header) > 8 else "")


def _is_number(cell: str) -> bool:
    """Whether the text of a cell reads as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _is_time(cell: str) -> bool:
    return math.isfinite(stamp_of(cell))


def _number(cell: str) -> float:
    """The number in a cell, NaN if there is none."""
    return float(cell) if _is_number(cell) else math.nan


SUFFIX = ".gpx"

MOST_GAP_S = 10.0
"""Longest time in seconds between two positions between which images are interpolated on a straight line."""


@dataclass(frozen=True)
class PositionRequest:
    """Images whose positions are wanted.

    Attributes:
        indices: The absolute index of each in its whole sequence, int64 (n,).
        whole: Images in the whole sequence.
        stamps: Times in seconds, float64 (n,); None if unknown.
    """

    indices: NDArray[np.int64]
    whole: int
    stamps: NDArray[np.float64] | None = None


def read_track(path: Path) -> Track:
    """The positions in a GPX file, or in any other as a CSV table.

    Raises:
        InputError: it cannot be used.
    """
    if path.suffix.lower() != SUFFIX:
        return read_table(path)
    from lava_vpr.positions.gpx import read_gpx  # who reads no GPX waits for no gpxpy

    return read_gpx(path)


def images_on(
    track: Track, asked: PositionRequest, gap: float = MOST_GAP_S
) -> tuple[Positions, NDArray[np.float64] | None]:
    """Positions of images, and their times if known.

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
    """The positions of images by number: row k of the track is the image with absolute index k, whatever its times are.

    Raises:
        InputError: an image has no row.
    """
    rows, last = len(track.positions), int(indices.max(initial=-1))
    if rows <= last:
        raise InputError(f"{shown(track.path)}: has {rows} positions, image {last} has none; give one a line")
    return track.positions.take(indices)


def _untimed(stamps: NDArray[np.float64] | None) -> str:
    """The reason why images cannot be placed by their times."""
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
