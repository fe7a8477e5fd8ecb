"""Events of a camera as they come, from a program that writes them to standard input: ``events:346x260``."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.events.aedat4 import EVENT
from lava_vpr.events.stream import Raw, check_size, checked
from lava_vpr.events.windows import Windows
from lava_vpr.images.sampling import Sample
from lava_vpr.inputs.windows import EventsConfig

_SOURCE = re.compile(r"events:(\d{1,5})x(\d{1,5})")
_MOST = 1 << 20
"""Bytes that are read at a time, at most."""


def is_event_stream(source: str) -> bool:
    """Whether ``source`` stands for events on standard input."""
    return _SOURCE.fullmatch(source) is not None


def event_samples(source: str, config: EventsConfig, every: float, handle: int = 0) -> Iterator[Sample]:
    """The windows of events as they come. Hot pixels are those that have been hot so far.

    One window is in memory, and at most a mebibyte of events, however long the stream.

    Args:
        source: ``events:WIDTHxHEIGHT``, the size of the sensor. Events follow each other as in an AEDAT4 packet: 16
            bytes, little-endian, of which the time in microseconds (int64), column and row (int16 each) and the sign (a
            byte) are told, and the rest is not looked at.
        config: How events become images.
        every: Seconds from the begin of one window to that of the next, at least.
        handle: The descriptor that is read.
    Raises:
        InputError: the sensor is none; from the iterator: the stream holds what is no event, or ends within one.
    """
    found = _SOURCE.fullmatch(source)
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
