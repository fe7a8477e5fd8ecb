"""Where a file keeps the parts of its events: a table of all, or an array for each, by the names that files use."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from lava_vpr.errors import InputError
from lava_vpr.events.stream import BLOCK, Raw

NAMES: dict[str, tuple[str, ...]] = {
    "t": ("t", "ts", "timestamp", "timestamps", "time"),
    "x": ("x", "xs"),
    "y": ("y", "ys"),
}
"""What files call the parts of an event."""

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
        raise InputError(f"{where}: has {lengths[0]} times, {lengths[1]} columns, {lengths[2]} rows")


def in_blocks(parts: Parts, length: int, take: Callable[[Any, int, int], Any]) -> Iterator[Raw]:
    """The events, some at a time; ``take`` gives so many elements of an array, from the one with this number on."""
    arrays = {id(array): array for array, _ in parts}
    for first in range(0, length, BLOCK):
        count = min(BLOCK, length - first)
        read = {key: take(array, first, count) for key, array in arrays.items()}
        yield Raw(*(read[id(array)][field] if field else read[id(array)] for array, field in parts))
