"""Files of events, whatever their format: opened, searched for hot pixels and windows, and shown window by window; and
events as they come, from a program that writes them to standard input: ``events:346x260``.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, shown
from lava_vpr.events.aedat4 import AEDAT4_SUFFIXES, EVENT, open_aedat4
from lava_vpr.events.arrays import HDF5_SUFFIXES, NPZ_SUFFIXES, hdf5, holds, npz, open_arrays
from lava_vpr.events.stream import EventRecording, Raw, check_size, checked
from lava_vpr.events.windows import Windows, hot_pixels
from lava_vpr.images.sampling import Sample
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.storage.arrays import zeros_at_end

_NOTES = logging.getLogger("lava_vpr")


class EventFormat(NamedTuple):
    """A format of files of events.

    Attributes:
        suffixes: Of their names.
        holds: Whether a file is one of events; such suffixes may have others, too.
        open: Reads a file.
    """

    suffixes: tuple[str, ...]
    holds: Callable[[Path], bool]
    open: Callable[[Path], EventRecording]


FORMATS = (
    EventFormat(AEDAT4_SUFFIXES, lambda path: True, open_aedat4),
    EventFormat(HDF5_SUFFIXES, partial(holds, hdf5), partial(open_arrays, hdf5)),
    EventFormat(NPZ_SUFFIXES, partial(holds, npz), partial(open_arrays, npz)),
)
EVENT_SUFFIXES = tuple(suffix for one in FORMATS for suffix in one.suffixes)


def is_events(path: Path) -> bool:
    """Whether the file ``path`` looks like a file of events."""
    return any(path.suffix.lower() in one.suffixes and one.holds(path) for one in FORMATS)


def is_recording(source: str | Path) -> bool:
    """Whether ``source``, a name of any kind, is that of a file of events."""
    path = Path(source)
    return path.suffix.lower() in EVENT_SUFFIXES and "\0" not in str(path) and path.is_file() and is_events(path)


def open_events(path: Path) -> EventRecording:
    """The events of a file.

    Raises:
        InputError: it cannot be used.
    """
    return next(one for one in FORMATS if path.suffix.lower() in one.suffixes).open(path)


def windows_of(path: Path, config: EventsConfig, every: float) -> Callable[[], Iterator[Sample]]:
    """Go through a recording for its sensor and its hot pixels; what is returned walks over its windows.

    What was left out of them is logged at the end of a walk.

    Args:
        path: The file.
        config: How events become images.
        every: Seconds from the begin of one window to that of the next, at least.
    Raises:
        InputError: it cannot be used; from a walk, too, and there where it has no window.
    """
    recording = open_events(path)
    size = _size(recording) if recording.size is None else recording.size
    seen = np.zeros((size[1], size[0]), np.int64)
    last = {"column": 0, "row": 0}
    for events in recording.events():
        np.add.at(seen, (events.y, events.x), 1)
        for name, values in (("column", events.x), ("row", events.y)):
            last[name] = zeros_at_end(values, last[name])
    for name, zeros in last.items():
        if zeros > 1:  # a single one is normal
            _NOTES.warning(
                f"{shown(path)}: the last {zeros:,} events have the {name} 0; if they should not, copy it again"
            )
    if not seen.any():
        raise InputError(f"{shown(path)}: holds no event; record it again")
    return partial(_walk, recording, config, every, seen)


def _walk(recording: EventRecording, config: EventsConfig, every: float, seen: NDArray[np.int64]) -> Iterator[Sample]:
    """The windows of a recording of so many events a pixel; see `windows_of`."""
    hot = hot_pixels(seen, config.hot_pixels)
    windows, number = Windows((seen.shape[1], seen.shape[0]), config, every, hot), 0
    for sample in windows.all(recording.events()):
        number = sample.number + 1
        yield sample._replace(stamp=recording.start_s + (sample.stamp or 0.0))
    where, events = shown(recording.path), sum(windows.removed)
    if number == 0:
        span = f"{config.window_events:,} events" if config.window_events else f"{config.window_ms:g} ms"
        noise, spare = (
            ("", "")
            if not windows.removed.hot
            else (f", {windows.removed.hot:,} of them of hot pixels", ", or set events.hot_pixels to 0")
        )
        raise InputError(
            f"{where}: is shorter than half a window of {span} ({int(seen.sum()):,} events{noise}); use shorter windows"
            f"{spare}"
        )
    apart, soon = (f"{100 * count / max(1, events):.1f} %" for count in (windows.removed.hot, windows.removed.soon))
    _NOTES.info(
        f"{where}: {number} windows of {events:,} events, of which {apart} were of {int(hot.sum())} hot pixels and "
        f"{soon} too soon after another of their pixel, and are left out"
    )


def _size(recording: EventRecording) -> tuple[int, int]:
    """The smallest sensor size that has all pixels of a recording; for files that do not give the size."""
    width = height = 1
    for events in recording.events():
        if len(events.t):
            width, height = max(width, int(events.x.max()) + 1), max(height, int(events.y.max()) + 1)
    return check_size((width, height), shown(recording.path))


EVENT_STREAM = re.compile(r"events:(\d{1,5})x(\d{1,5})")
_MOST = 1 << 20
"""Most bytes that are read at a time."""


def event_samples(source: str, config: EventsConfig, every: float, handle: int = 0) -> Iterator[Sample]:
    """The windows of live events. Hot pixels are those that have been hot so far.

    One window is in memory, and at most a mebibyte of events, however long the stream.

    Args:
        source: ``events:WIDTHxHEIGHT``, the size of the sensor. Events follow each other as in an AEDAT4 packet: 16
            bytes, little-endian, of which the time in microseconds (int64), column and row (int16 each) and the sign (a
            byte) are reported, and the rest is not read.
        config: How events become images.
        every: Seconds from the begin of one window to that of the next, at least.
        handle: The descriptor that is read.
    Raises:
        InputError: the sensor is none; from the iterator: the stream holds what is no event, or ends within one.
    """
    found = EVENT_STREAM.fullmatch(source)
    if found is None:
        raise InputError(f"{source}: is no stream of events; write events:WIDTHxHEIGHT")
    size = check_size((int(found[1]), int(found[2])), source)
    return Windows(size, config, every).all(checked(_read(source, handle), source, size))


def _read(source: str, handle: int) -> Iterator[Raw]:
    """The events, as many as have come."""
    begun = b""
    while data := os.read(handle, _MOST):
        data = begun + data
        whole = len(data) // EVENT.itemsize
        begun = data[whole * EVENT.itemsize :]
        part: NDArray[Any] = np.frombuffer(data, EVENT, whole)
        yield Raw(part["t"], part["x"], part["y"])
    if begun:
        raise InputError(f"{source}: ends within an event ({len(begun)} of {EVENT.itemsize} bytes); write it whole")
