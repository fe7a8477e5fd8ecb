"""Simulation of an event camera, and writing of events: HDF5 in the layout of DSEC, and ``.npz`` with a structured
array of tonic's fields.

A pixel remembers the logarithm of the light at its last event, and sends an event each time that the light has moved
away from it by its threshold. Between two pictures the logarithm is taken to change in a straight line. Thresholds
differ from pixel to pixel; after an event a pixel rests; and some events come from noise alone, more from hot pixels.
Source: Gallego et al. 2022, "Event-based vision: a survey", section 2 (doi 10.1109/TPAMI.2020.3008413); straight lines
between pictures as in ESIM (Rebecq, Gehrig, Scaramuzza, CoRL 2018).
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.events.windows import NEVER, rest
from lava_vpr.storage.writing import write_atomically

_DARK = 10.0  # grey levels that a pixel sees without light: its dark current


@dataclass(frozen=True)
class Sensor:
    """Properties of an event camera.

    Attributes:
        threshold: Change of the logarithm of light that makes an event, on average.
        mismatch: Standard deviation of the pixels' thresholds, as a share of ``threshold``.
        refractory_us: Refractory period of a pixel in microseconds, in which changes are lost.
        noise_hz: Noise events of a pixel per second.
        hot: Share of the pixels that are hot, and send ``hot_hz`` events a second.
        hot_hz: See ``hot``.
    """

    threshold: float = 0.25
    mismatch: float = 0.1
    refractory_us: int = 500
    noise_hz: float = 0.2
    hot: float = 0.0005
    hot_hz: float = 200.0


class Sent(NamedTuple):
    """Events in the order of their times: microseconds int64 (n,), column and row uint16 (n,), brighter bool (n,)."""

    t: NDArray[np.int64]
    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    p: NDArray[np.bool_]


class EventCamera:
    """The pixels of an event camera.

    Args:
        light: The first picture, grey levels of at least 0, float32 (h, w).
        rng: Draws thresholds, hot pixels and noise.
        sensor: Its properties.
    """

    def __init__(self, light: NDArray[np.float32], rng: np.random.Generator, sensor: Sensor | None = None) -> None:
        self._sensor = sensor or Sensor()
        self._rng, shape = rng, light.shape
        least = self._sensor.threshold / 3
        wanted = rng.normal(self._sensor.threshold, self._sensor.mismatch * self._sensor.threshold, shape)
        self._threshold = np.maximum(wanted, least)
        self._rates = np.where(rng.random(shape) < self._sensor.hot, self._sensor.hot_hz, self._sensor.noise_hz)
        self._before = self._at_event = _seen(light)
        self._last = np.full(shape, NEVER, np.int64)

    def see(self, light: NDArray[np.float32], begin_us: int, end_us: int) -> Sent:
        """The events until the next picture.

        Args:
            light: The next picture, float32 (h, w).
            begin_us, end_us: When the last picture was seen, and when this one is.
        """
        now = _seen(light)
        away = (now - self._at_event) / self._threshold
        number = np.abs(away).astype(np.int64)
        rows, columns = np.nonzero(number)
        counts = number[rows, columns]
        up = away[rows, columns] > 0
        self._at_event = self._at_event + np.sign(away) * number * self._threshold
        pixel = np.repeat(np.arange(len(rows)), counts)
        level = np.arange(len(pixel)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
        threshold = self._threshold[rows, columns]
        sign = np.where(up, 1.0, -1.0)
        # Times at which the line from the previous picture to this one crosses the level of each event.
        start = (self._before[rows, columns] - (self._at_event[rows, columns] - sign * counts * threshold)) * sign
        slope = (now[rows, columns] - self._before[rows, columns]) * sign
        share = (level * threshold[pixel] - start[pixel]) / np.maximum(slope[pixel], 1e-12)
        t = begin_us + np.floor(np.clip(share, 0, 1) * (end_us - begin_us)).astype(np.int64)
        self._before = now
        noise = self._noise(begin_us, end_us)
        sent = Sent(
            np.concatenate([t, noise.t]),
            np.concatenate([columns[pixel].astype(np.uint16), noise.x]),
            np.concatenate([rows[pixel].astype(np.uint16), noise.y]),
            np.concatenate([up[pixel], noise.p]),
        )
        return self._awake(sent, np.lexsort((sent.x, sent.y, sent.t)))

    def _noise(self, begin_us: int, end_us: int) -> Sent:
        """Noise events."""
        number = self._rng.poisson(self._rates * ((end_us - begin_us) / 1e6))
        rows, columns = np.nonzero(number)
        counts = number[rows, columns]
        total = int(counts.sum())
        t = self._rng.integers(begin_us, end_us, total)
        x, y = np.repeat(columns, counts).astype(np.uint16), np.repeat(rows, counts).astype(np.uint16)
        return Sent(t.astype(np.int64), x, y, self._rng.random(total) < 0.5)

    def _awake(self, sent: Sent, order: NDArray[np.int64]) -> Sent:
        """The events that do not fall into the refractory period of their pixel."""
        t, x, y, p = sent.t[order], sent.x[order], sent.y[order], sent.p[order]
        keep = np.empty(len(t), np.bool_)
        rest(t, x, y, self._sensor.refractory_us, self._last, keep)
        return Sent(t[keep], x[keep], y[keep], p[keep])


def _seen(light: NDArray[np.float32]) -> NDArray[np.float64]:
    """The logarithm of light that a pixel compares."""
    return np.log(light.astype(np.float64) + _DARK)


WRITTEN = (".h5", ".npz")
"""Ends of the names of files that are written."""
_CHUNK = 1 << 16
TONIC = np.dtype([("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "?")])
"""A row of the array ``events`` in an ``.npz`` file."""


def write_events(path: Path, events: Iterable[Sent], size: tuple[int, int], start_s: float = 0.0) -> int:
    """Write a new file of events; equal events give equal bytes.

    Args:
        path: Of one of the ends in `WRITTEN`. The file is made in memory and appears complete or not at all: the HDF5
            library ends the process when a disk is full.
        events: In the order of their times.
        size: Width and height of the sensor in pixels.
        start_s: The time at which theirs begin, seconds; an ``.npz`` file holds their sum.
    Returns:
        How many events there were.
    Raises:
        OSError: the file cannot be written.
    """
    buffer = io.BytesIO()
    count = (_hdf5 if path.suffix == ".h5" else _npz)(buffer, events, size, start_s)
    write_atomically(path, lambda file: file.write(buffer.getbuffer()))
    return count


def _hdf5(buffer: io.BytesIO, events: Iterable[Sent], size: tuple[int, int], start_s: float) -> int:
    import h5py  # here: see `lava_vpr.events.arrays`

    total, marks = 0, _Marks()
    with h5py.File("events", "w", driver="core", backing_store=False) as file:
        file.attrs["width"], file.attrs["height"] = size
        file["t_offset"] = np.int64(round(start_s * 1e6))
        kinds = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"}
        parts = {name: _growing(file, f"events/{name}", kind) for name, kind in kinds.items()}
        for some in events:
            for name, part in parts.items():
                part.resize(total + len(some.t), axis=0)
                part[total:] = getattr(some, name)
            marks.add(some, total)
            total += len(some.t)
        file["ms_to_idx"] = np.array(marks.first, "<u8")
        file.flush()
        buffer.write(file.id.get_file_image())
    return total


def _growing(file: Any, name: str, kind: str) -> Any:
    """An empty dataset that can grow, packed."""
    options = {"chunks": (_CHUNK,), "maxshape": (None,), "compression": "gzip", "compression_opts": 1}
    return file.create_dataset(name, shape=(0,), dtype=kind, shuffle=True, **options)


class _Marks:
    """DSEC's ``ms_to_idx``: the first event at or after each millisecond."""

    def __init__(self) -> None:
        self.first: list[int] = []

    def add(self, some: Sent, before: int) -> None:
        """Take note of some events, of which ``before`` came earlier."""
        if len(some.t):
            marks = np.arange(len(self.first), int(some.t[-1]) // 1000 + 1) * 1000
            self.first += (before + np.searchsorted(some.t, marks)).tolist()


def _npz(buffer: io.BytesIO, events: Iterable[Sent], size: tuple[int, int], start_s: float) -> int:
    rows = []
    for some in events:
        row = np.empty(len(some.t), TONIC)
        row["x"], row["y"], row["t"], row["p"] = some.x, some.y, some.t + round(start_s * 1e6), some.p
        rows.append(row)
    whole = np.concatenate(rows) if rows else np.empty(0, TONIC)
    np.savez_compressed(buffer, events=whole, size=np.array(size, np.int64))
    return len(whole)
