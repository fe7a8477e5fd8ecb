"""Events on standard input, and recordings of them, watched."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest
from support.common.eventfiles import EVENT, Made, made
from support.common.imagefiles import refused

from lava_vpr.events.files import event_samples, is_event_stream
from lava_vpr.events.stream import Events
from lava_vpr.events.windows import Windows
from lava_vpr.inputs.windows import EventsConfig

CONFIG = EventsConfig(window_ms=80)


def as_bytes(events: Made) -> bytes:
    rows = zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True)
    return b"".join(EVENT.pack(*row) for row in rows)


def piped(parts: list[bytes]) -> int:
    """A pipe that gives these pieces, and ends."""
    read, write = os.pipe()

    def fill() -> None:
        with os.fdopen(write, "wb", buffering=0) as file:
            for part in parts:
                file.write(part)

    threading.Thread(target=fill, daemon=True).start()
    return read


@pytest.mark.parametrize("pieces", [[], [1, 16, 17, 4000], list(range(500, 48_000, 500))])
def test_events_on_a_pipe_are_cut_into_windows_whatever_pieces_come(pieces: list[int]) -> None:
    events = made(3000, 3.0)
    data = as_bytes(events)
    cuts = [0, *pieces, len(data)]
    handle = piped([data[a:b] for a, b in zip(cuts[:-1], cuts[1:], strict=True)])  # noqa: RUF007
    seen = [(*one[:2], one.read()) for one in event_samples("events:24x16", CONFIG, 0.2, handle)]
    whole = Events(events.t, events.x.astype(np.uint16), events.y.astype(np.uint16))
    wanted = [(*one[:2], one.read()) for one in Windows((24, 16), CONFIG, 0.2).all([whole])]
    assert len(seen) == len(wanted) == 15
    for (number, middle, image), (*same, other) in zip(seen, wanted, strict=True):
        assert [number, middle] == same
        np.testing.assert_array_equal(image, other)


def test_a_window_is_there_before_the_stream_ends() -> None:
    read, write = os.pipe()
    samples = event_samples("events:24x16", CONFIG, 0.1, read)
    events = made(500, 0.5)
    os.write(write, as_bytes(events))
    assert [next(samples).number for _ in range(4)] == [0, 1, 2, 3]
    os.close(write)
    assert [sample.number for sample in samples] == [4]


@pytest.mark.parametrize(
    ("source", "data", "words"),
    [
        ("events:24x16", as_bytes(made(9))[:-3], "ends within an event (13 of 16 bytes)"),
        ("events:24x16", bytes(range(256)) * 10, "outside the sensor of 24 x 16"),
        ("events:10x10", as_bytes(made(300)), "outside the sensor of 10 x 10"),
        ("events:0x10", b"", "a sensor of 0 x 10"),
        ("events:60000x60000", b"", "LAVA_VPR_MAX_SENSOR_PIXELS"),
    ],
)
def test_a_stream_that_is_none_is_refused(source: str, data: bytes, words: str) -> None:
    handle = piped([data])
    refused(lambda: list(event_samples(source, CONFIG, 0.1, handle)), words)


def test_names_of_streams() -> None:
    assert is_event_stream("events:346x260")
    assert not is_event_stream("events:346")
    assert not is_event_stream("events")
