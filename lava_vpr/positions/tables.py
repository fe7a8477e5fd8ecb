"""Positions and stamps in CSV tables."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.positions.frames import LAT_LON, XY, Positions, columns, fits
from lava_vpr.positions.stamps import in_seconds, stamp_of
from lava_vpr.storage.tables import csv_rows
from lava_vpr.storage.text import shown

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
        stamps: When each was taken, in seconds that do not decrease, float64 (n,); None if nobody says.
        path: The file that they are from, for messages.
    """

    positions: Positions
    stamps: NDArray[np.float64] | None
    path: Path


def read_table(path: Path) -> Track:
    """The positions in a CSV file, and their times if it has a column of them.

    Columns x,y (or easting,northing) are metres, lat,lon (latitude,longitude) degrees; time (timestamp, stamp, t) is in
    seconds or a date (`lava_vpr.positions.stamps`). Without a header there are two columns, x and y. Other columns are
    ignored.

    Raises:
        InputError: unreadable, no such columns, a cell that is no number in its range, or a time before the one above;
            names file and line.
    """
    rows = csv_rows(path)
    chosen, frame, timed = (0, 1), XY, -1
    if rows and not all(_is_number(cell) for cell in rows[0][1]):
        line, header = rows[0][0], [cell.lower() for cell in rows[0][1]]
        pair = next((pair for pair in _PAIRS if set(pair) <= set(header)), None)
        if pair is None:
            raise InputError(f"{shown(path)} line {line}: no columns x,y or lat,lon among {_some(header)}; name them")
        names = [*pair, *(name for name in _TIMES if name in header)][:3]
        _refuse_twice(path, line, header, names)
        chosen, frame = (header.index(pair[0]), header.index(pair[1])), _PAIRS[pair]
        timed = header.index(names[2]) if len(names) > 2 else -1
        rows = rows[1:]
    elif rows and len(rows[0][1]) != 2:
        raise InputError(f"{shown(path)} line {rows[0][0]}: has {len(rows[0][1])} columns and no header; add one: x,y")
    if not rows:
        raise InputError(f"{shown(path)}: holds no positions; write one row an image, columns x,y or lat,lon")
    values = np.array([[_number(cells[column]) for column in chosen] for _, cells in rows], np.float64)
    good = fits(values, frame)
    if not good.all():
        k, axis = np.argwhere(~good)[0].tolist()
        line, cells = rows[k]
        what = _WORDS[columns(frame)[axis]]
        raise InputError(
            f"{shown(path)} line {line}: {what} is {brief(cells[chosen[axis]])}; give a number in its range"
        )
    return Track(Positions(values, frame), _times(path, rows, timed) if timed >= 0 else None, path)


def read_stamps(path: Path) -> NDArray[np.float64]:
    """The times in a CSV file, in seconds, float64 (rows,): its column of times, or its only one.

    Raises:
        InputError: unreadable, no such column, or a cell that is no time; names file and line.
    """
    rows, column = csv_rows(path), 0
    if rows and not any(math.isfinite(stamp_of(cell)) for cell in rows[0][1]):
        line, header = rows[0][0], [cell.lower() for cell in rows[0][1]]
        name = next((name for name in _TIMES if name in header), None)
        if name is None:
            raise InputError(f"{shown(path)} line {line}: no column time among {_some(header)}; name it")
        _refuse_twice(path, line, header, [name])
        rows, column = rows[1:], header.index(name)
    elif rows and len(rows[0][1]) != 1:
        raise InputError(
            f"{shown(path)} line {rows[0][0]}: has {len(rows[0][1])} columns and no header; name one: time"
        )
    if not rows:
        raise InputError(f"{shown(path)}: holds no times; write one row an image, column time")
    return _times(path, rows, column)


def _times(path: Path, rows: list[tuple[int, list[str]]], column: int) -> NDArray[np.float64]:
    """A column of times, none before the one above."""
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


def _refuse_twice(path: Path, line: int, header: list[str], names: list[str]) -> None:
    for name in names:
        if header.count(name) > 1:
            raise InputError(
                f"{shown(path)} line {line}: has {header.count(name)} columns {name!r}; rename all but one"
            )


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


def _number(cell: str) -> float:
    """The number in a cell, NaN if there is none."""
    return float(cell) if _is_number(cell) else math.nan
