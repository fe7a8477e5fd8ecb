"""The events that all readers return, the checks that all of them pass, and the arrays that hold them in files: one
table, or an array for each part, by the names in use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, shown
from lava_vpr.storage.limits import within

BLOCK = 1 << 18
"""Number of events that are read, and held in memory, at a time."""
_MOST_US = 1 << 61


class Events(NamedTuple):
    """Some events in the order of their times; their signs are not used (`lava_vpr.inputs.windows`).

    Attributes:
        t: Microseconds, int64 (n,).
        x, y: Column and row of the pixel, from the upper left, uint16 (n,).
    """

    t: NDArray[np.int64]
    x: NDArray[np.uint16]
    y: NDArray[np.uint16]


class Raw(NamedTuple):
    """Some events as they stand in a file: one-dimensional arrays of any whole or real numbers.

    Attributes:
        t: Times, whole numbers of microseconds or real numbers of seconds.
        x, y: Column and row of the pixel.
    """

    t: NDArray[Any]
    x: NDArray[Any]
    y: NDArray[Any]


@dataclass(frozen=True)
class EventRecording:
    """A file of events.

    Attributes:
        path: The file.
        raw: Reads it from the start, at most `BLOCK` events at a time.
        size: Width and height of the sensor in pixels, if the file tells them.
        start_s: Offset that is added to the times, in seconds.
    """

    path: Path
    raw: Callable[[], Iterator[Raw]]
    size: tuple[int, int] | None = None
    start_s: float = 0.0

    def events(self) -> Iterator[Events]:
        """All events, checked.

        Raises:
            InputError: the file is damaged, times go back, a pixel is none of the sensor's, or there are too many.
        """
        return checked(self.raw(), shown(self.path), self.size)


def check_size(size: tuple[int, int], where: str) -> tuple[int, int]:
    """The width and height of a sensor, within the limit ``sensor_pixels``.

    Raises:
        InputError: it is larger, or no sensor.
    """
    width, height = size
    if not 1 <= min(size) <= max(size) <= 1 << 16:
        raise InputError(f"{where}: has a sensor of {width} x {height} pixels; correct it")
    within("sensor_pixels", width * height, f"{where}: has a sensor of {width} x {height},")
    return size


def checked(raw: Iterable[Raw], where: str, size: tuple[int, int] | None) -> Iterator[Events]:
    """Check the events of a file or a stream, block by block.

    Args:
        raw: The events.
        where: Their source, which messages begin with.
        size: Width and height of the sensor; None: unknown, each at most 65,536.
    Raises:
        InputError: naming the first event that is wrong, counted from 0.
    """
    width, height = (1 << 16, 1 << 16) if size is None else size
    total, last = 0, -_MOST_US
    for t, x, y in raw:
        total += len(t)
        within("events", total, f"{where}: has")
        times = _whole(t, where, "time", total - len(t), 1e6 if t.dtype.kind == "f" else 1)
        columns, rows = (_whole(values, where, name, total - len(t), 1) for values, name in ((x, "column"), (y, "row")))
        if not len(times):
            continue
        back = np.diff(times, prepend=last) < 0
        wrong = (columns < 0) | (columns >= width) | (rows < 0) | (rows >= height)
        if back.any():
            k = int(back.argmax())
            before = last if k == 0 else int(times[k - 1])
            raise InputError(
                f"{where}: event {total - len(t) + k} goes back by {before - int(times[k]):,} us; sort the events by "
                "their times"
            )
        if wrong.any():
            k = int(wrong.argmax())
            raise InputError(
                f"{where}: event {total - len(t) + k} is at column {columns[k]}, row {rows[k]}, outside the sensor of "
                f"{width} x {height} pixels; correct the events or the sensor's size"
            )
        last = int(times[-1])
        yield Events(times, columns.astype(np.uint16), rows.astype(np.uint16))


def _whole(values: NDArray[Any], where: str, name: str, first: int, factor: float) -> NDArray[np.int64]:
    """Numbers of a file times a factor as whole numbers, int64 (n,)."""
    if values.dtype.kind in "iu" and values.dtype != np.uint64:
        return values.astype(np.int64)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow and values that are no numbers are refused
        numbers = values.astype(np.float64) * factor
    bad = ~(np.abs(numbers) < _MOST_US)
    if factor == 1:
        bad |= numbers != np.rint(numbers)
    if bad.any():
        k = int(bad.argmax())
        raise InputError(f"{where}: event {first + k} has the {name} {values[k]}; write whole numbers, or remove it")
    return np.rint(numbers).astype(np.int64) if values.dtype.kind == "f" else values.astype(np.int64)


NAMES: dict[str, tuple[str, ...]] = {
    "t": ("t", "ts", "timestamp", "timestamps", "time"),
    "x": ("x", "xs"),
    "y": ("y", "ys"),
}
"""Names that files use for the parts of an event."""

Parts = list[tuple[Any, str]]
"""The array of times, of columns and of rows, and the field of each in it; "": all of it. Arrays have a ``dtype``."""


def in_tables(tables: Iterable[Any]) -> Parts | None:
    """The parts in the first of these one-dimensional arrays that has them all as numbers; None: none has."""
    for table in tables:
        names = table.dtype.names or ()
        fields = [next((name for name in known if name in names), "") for known in NAMES.values()]
        good = all(name and table.dtype[name].kind in "iuf" and table.dtype[name].shape == () for name in fields)
        if good and not table.dtype.hasobject:
            return [(table, name) for name in fields]
    return None


def apart(named: Callable[[str], Any]) -> Parts | None:
    """The parts as arrays of numbers of their own, by what ``named`` gives of a name, or None; None: some lack."""
    arrays = [next((one for name in known if (one := named(name)) is not None), None) for known in NAMES.values()]
    good = all(one is not None and one.dtype.kind in "iuf" for one in arrays)
    return [(one, "") for one in arrays] if good else None


def check_lengths(lengths: list[int], where: str) -> None:
    """Refuse parts of different ``lengths``; ``where`` is what the message begins with."""
    if len(set(lengths)) > 1:
        raise InputError(
            f"{where}: has {lengths[0]} times, {lengths[1]} columns, {lengths[2]} rows; give as many of each"
        )


def in_blocks(parts: Parts, length: int, take: Callable[[Any, int, int], Any]) -> Iterator[Raw]:
    """The events, some at a time; ``take`` gives so many elements of an array, from the one with this number on."""
    arrays = {id(array): array for array, _ in parts}
    for first in range(0, length, BLOCK):
        count = min(BLOCK, length - first)
        read = {key: take(array, first, count) for key, array in arrays.items()}
        yield Raw(*(read[id(array)][field] if field else read[id(array)] for array, field in parts))
