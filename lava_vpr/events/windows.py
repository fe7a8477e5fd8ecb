"""Windows of events: selection of an image's events, removal of noise, and the image itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.events.stream import Events
from lava_vpr.images.sampling import Sample
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.kernelcache import compiled

_EVER = 1 << 62
NEVER = -(1 << 62)
"""The time of the last event of a pixel that has had none, microseconds."""
_AROUND = 5  # pixels of the side of a pixel's surroundings


@compiled(nogil=True)
def gather(
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    begin: int,
    stop: int,
    quota: int,
    refractory: int,
    hot: NDArray[np.bool_],
    last: NDArray[np.int64],
    counts: NDArray[np.uint32],
    seen: NDArray[np.int64],
    totals: NDArray[np.int64],
) -> int:
    """Count events into ``counts`` until one comes at ``stop`` or ``quota`` of them are kept.

    Args:
        t, x, y: The events, each (n,), microseconds and pixels.
        begin: The first event that is taken.
        stop: Microseconds; events from there on are left.
        quota: Events that may still be kept.
        refractory: An event that comes less than so many microseconds after the last one kept of its pixel is left out.
        hot: Pixels whose events are left out, (h, w).
        last: Time of the last event kept of each pixel, (h, w); written.
        counts: Events of each pixel in the window, (h, w); written.
        seen: Events of each pixel, whatever becomes of them, (h, w); added to.
        totals: Events kept, of hot pixels, and too soon, (3,); added to.
    Returns:
        The first event that was not taken.
    """
    i, kept, of_hot, soon = begin, 0, 0, 0
    while i < len(t) and t[i] < stop and kept < quota:
        row, column = y[i], x[i]
        seen[row, column] += 1
        if hot[row, column]:
            of_hot += 1
        elif t[i] - last[row, column] < refractory:
            soon += 1
        else:
            last[row, column] = t[i]
            counts[row, column] += np.uint32(1)
            kept += 1
        i += 1
    totals[0] += kept
    totals[1] += of_hot
    totals[2] += soon
    return i


@compiled(nogil=True)
def rest(
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    refractory: int,
    last: NDArray[np.int64],
    keep: NDArray[np.bool_],
) -> None:
    """Mark the events that come ``refractory`` microseconds or more after the last one kept of their pixel.

    Args:
        t, x, y: The events, each (n,), microseconds and pixels.
        refractory: Microseconds.
        last: Time of the last event kept of each pixel, (h, w); written.
        keep: Whether an event is kept, (n,); written.
    """
    for i in range(len(t)):
        keep[i] = t[i] - last[y[i], x[i]] >= refractory
        if keep[i]:
            last[y[i], x[i]] = t[i]


class Removed(NamedTuple):
    """Numbers of events kept, and of events left out as noise: of hot pixels, and too soon after another of their
    pixel."""

    kept: int
    hot: int
    soon: int


def hot_pixels(counts: NDArray[np.int64], times: float) -> NDArray[np.bool_]:
    """Pixels with more events than a scene can cause, bool (h, w).

    Args:
        counts: Events of each pixel, int64 (h, w).
        times: A pixel is hot that has had more than so many times the median of the 5 x 5 pixels around it, and of the
            mean of all; 0: none is.
    """
    if times == 0:
        return np.zeros(counts.shape, np.bool_)
    values = counts.astype(np.float32)
    around = cv2.medianBlur(values, _AROUND)
    return np.asarray(values > times * np.maximum(around, values.mean()))


class Windows:
    """Cuts a stream of events into windows, and makes an image of each; only the current window is in memory, no event.

    A window begins with the first event, and then at the first multiple of ``every`` seconds after that which is not
    before the end of the window before. It lasts ``window_ms``, or until ``window_events`` events are kept. One without
    events is left out; of the last one, half is enough.

    Args:
        size: Width and height of the sensor in pixels.
        config: How events become images.
        every: Seconds from the begin of one window to that of the next, at least.
        hot: Pixels that are left out, bool (h, w); None: those that have been hot so far, when a window begins.
    """

    def __init__(
        self,
        size: tuple[int, int],
        config: EventsConfig,
        every: float,
        hot: NDArray[np.bool_] | None = None,
    ) -> None:
        width, height = size
        self._config = config
        self._every_us = max(1, round(every * 1e6))
        self._span_us = round(config.window_ms * 1e3)
        self._follows, self._seen = hot is None, np.zeros((height, width), np.int64)
        self._hot = np.zeros((height, width), np.bool_) if hot is None else hot
        self._last = np.full((height, width), NEVER, np.int64)
        self._counts = np.zeros((height, width), np.uint32)
        self._totals = np.zeros(3, np.int64)
        self._origin: int | None = None
        self._start = self._latest = self._number = self._kept = 0

    @property
    def removed(self) -> Removed:
        """Numbers of events kept and left out so far, in windows."""
        return Removed(*self._totals.tolist())

    def all(self, parts: Iterable[Events]) -> Iterator[Sample]:
        """The windows of events that come in ``parts``, from the first to the last."""
        for events in parts:
            yield from self.feed(events)
        yield from self.rest()

    def feed(self, events: Events) -> Iterator[Sample]:
        """Take the next events; the windows that they end, as images uint8 (h, w), each stamped with its middle."""
        t, x, y = events
        if self._origin is None and len(t):
            self._origin = self._start = int(t[0])
        by_count = self._config.window_events
        i = 0
        while i < len(t):
            i = max(i, int(np.searchsorted(t, self._start)))
            stop, quota = (_EVER, by_count - self._kept) if by_count else (self._start + self._span_us, _EVER)
            before = int(self._totals[0])
            pixels = (self._hot, self._last, self._counts, self._seen)
            begin, i = i, gather(t, x, y, i, stop, quota, self._config.refractory_us, *pixels, self._totals)
            self._kept += int(self._totals[0]) - before
            self._latest = int(t[i - 1]) if i > begin else self._latest
            if (by_count and self._kept == by_count) or i < len(t):
                end = self._latest if by_count else stop
                yield from self._ended(end)
                self._begin(end + (1 if by_count else 0), int(t[i]) if i < len(t) else end)

    def rest(self) -> Iterator[Sample]:
        """The last window, if it is at least half complete; call it once, after the last event."""
        by_count = self._config.window_events
        if by_count and self._kept >= by_count / 2:
            yield from self._ended(self._latest)
        elif not by_count and self._latest - self._start >= self._span_us / 2:
            yield from self._ended(self._start + self._span_us)

    def _begin(self, end: int, following: int) -> None:
        """Begin the next window, not before ``end``; empty ones before the ``following`` event are passed over."""
        origin = self._start if self._origin is None else self._origin
        self._start = origin - (origin - end) // self._every_us * self._every_us
        if not self._config.window_events:
            apart = -(-self._span_us // self._every_us) * self._every_us
            self._start += max(0, (following - self._start) // apart) * apart
        if self._follows:
            self._hot = hot_pixels(self._seen, self._config.hot_pixels)

    def _ended(self, end: int) -> Iterator[Sample]:
        """The window that has ended, if it has an event; the next one is empty."""
        if self._kept:
            yield Sample(self._number, (self._start + end) / 2 / 1e6, partial(self._image, end))
            self._number += 1
        self._kept = 0
        self._counts[:] = 0

    def _image(self, end: int) -> NDArray[np.uint8]:
        """The image of the window's events, uint8 (h, w)."""
        values = self._counts.astype(np.float32)
        if self._config.image == "surface":
            fall = max(1.0, (end - self._start) / 2)
            age = np.minimum((end - self._last) / fall, 80.0)
            values = np.where(self._counts > 0, np.exp(-age), 0.0).astype(np.float32)
        height, width = values.shape
        share = self._config.side / max(height, width)
        if share < 1:
            small = max(1, round(width * share)), max(1, round(height * share))
            values = cv2.resize(values, small, interpolation=cv2.INTER_AREA)
        return levels(values)


def levels(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Values of at least 0 as grey levels, uint8: the largest hundredth of those that are not 0 become white."""
    top = float(np.quantile(values[values > 0], 0.99))
    return np.rint(np.minimum(values * (255.0 / top), 255.0)).astype(np.uint8)
