"""Files of events, whatever their format: opened, searched for hot pixels and windows, and shown window by window."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.events.aedat4 import AEDAT4_SUFFIXES, open_aedat4
from lava_vpr.events.hdf5 import HDF5_SUFFIXES, is_hdf5, open_hdf5
from lava_vpr.events.npz import NPZ_SUFFIXES, is_npz, open_npz
from lava_vpr.events.stream import Recording, check_size
from lava_vpr.events.windows import Removed, Shown, Windows, hot_pixels
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.storage.text import shown


class Format(NamedTuple):
    """A format of files of events.

    Attributes:
        suffixes: Of their names.
        holds: Whether a file is one of events; such suffixes may have others, too.
        open: Reads a file.
    """

    suffixes: tuple[str, ...]
    holds: Callable[[Path], bool]
    open: Callable[[Path], Recording]


FORMATS = (
    Format(AEDAT4_SUFFIXES, lambda path: True, open_aedat4),
    Format(HDF5_SUFFIXES, is_hdf5, open_hdf5),
    Format(NPZ_SUFFIXES, is_npz, open_npz),
)
EVENT_SUFFIXES = tuple(suffix for one in FORMATS for suffix in one.suffixes)


@dataclass(frozen=True, eq=False)
class Drive:
    """A recording and how it is cut into windows.

    Attributes:
        recording: The events.
        config: How they become images.
        every: Seconds from the begin of one window to that of the next, at least.
        size: Width and height of the sensor in pixels.
        hot: Pixels that are left out, bool (h, w).
        stamps: The middle of each window in seconds, float64 (windows,).
        removed: What was kept of the windows' events, and left out.
    """

    recording: Recording
    config: EventsConfig
    every: float
    size: tuple[int, int]
    hot: NDArray[np.bool_]
    stamps: NDArray[np.float64]
    removed: Removed

    def frames(self, numbers: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """The images of these windows: one pass over the file if they increase, a new pass at each step back.

        Raises:
            InputError: the file cannot be read, or has changed.
        """
        k = 0
        while k < len(numbers):
            at = -1
            for seen in _windows(self.recording, Windows(self.size, self.config, self.every, self.hot)):
                if seen.number < numbers[k]:
                    continue
                at = seen.number
                if at > numbers[k]:
                    break
                yield seen.image
                k += 1
                if k == len(numbers) or numbers[k] <= at:
                    break
            if k < len(numbers) and numbers[k] > at:
                where = shown(self.recording.path)
                raise InputError(f"{where}: has no window {numbers[k]} any more; was the file changed?")

    def told(self) -> str:
        """What was left out, in a line."""
        total = max(1, sum(self.removed))
        hot, soon = (f"{100 * count / total:.1f} %" for count in (self.removed.hot, self.removed.soon))
        return (
            f"{shown(self.recording.path)}: {len(self.stamps)} windows of {sum(self.removed):,} events, of which "
            f"{hot} were of {int(self.hot.sum())} hot pixels and {soon} too soon after another of their pixel, and are "
            "left out"
        )


def is_events(path: Path) -> bool:
    """Whether the file ``path`` holds events, as far as a look into it tells."""
    return any(path.suffix.lower() in one.suffixes and one.holds(path) for one in FORMATS)


def is_recording(source: str | Path) -> bool:
    """Whether ``source``, whatever it is, names a file of events."""
    path = Path(source)
    return path.suffix.lower() in EVENT_SUFFIXES and "\0" not in str(path) and path.is_file() and is_events(path)


def open_events(path: Path) -> Recording:
    """The events of a file.

    Raises:
        InputError: it cannot be used.
    """
    return next(one for one in FORMATS if path.suffix.lower() in one.suffixes).open(path)


def survey(path: Path, config: EventsConfig, every: float) -> Drive:
    """Go through a recording for its sensor, its hot pixels and its windows.

    Raises:
        InputError: it cannot be used, or has no window.
    """
    recording = open_events(path)
    size = _size(recording) if recording.size is None else recording.size
    seen = np.zeros((size[1], size[0]), np.int64)
    for events in recording.events():
        np.add.at(seen, (events.y, events.x), 1)
    if not seen.any():
        raise InputError(f"{shown(path)}: holds no event; record it again")
    hot = hot_pixels(seen, config.hot_pixels)
    windows = Windows(size, config, every, hot, draw=False)
    middles = [one.middle_us for one in _windows(recording, windows)]
    if not middles:
        span = f"{config.window_events:,} events" if config.window_events else f"{config.window_ms:g} ms"
        raise InputError(
            f"{shown(path)}: is shorter than half a window of {span} ({int(seen.sum()):,} events); use shorter windows"
        )
    stamps = recording.start_s + np.array(middles, np.float64) / 1e6
    return Drive(recording, config, every, size, hot, stamps, windows.removed)


def _windows(recording: Recording, windows: Windows) -> Iterator[Shown]:
    for events in recording.events():
        yield from windows.feed(events)
    yield from windows.rest()


def _size(recording: Recording) -> tuple[int, int]:
    """The least sensor that has all pixels of a recording whose file does not tell it."""
    width = height = 1
    for events in recording.events():
        if len(events.t):
            width, height = max(width, int(events.x.max()) + 1), max(height, int(events.y.max()) + 1)
    return check_size((width, height), shown(recording.path))
