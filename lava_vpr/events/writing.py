"""Events written: HDF5 in the layout of DSEC, and ``.npz`` with a structured array of tonic's fields."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from lava_vpr.events.camera import Sent
from lava_vpr.storage.writing import write_atomically

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
    import h5py  # here: see `lava_vpr.events.hdf5`

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
