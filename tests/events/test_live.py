"""Events on standard input, and recordings of them, watched."""

from __future__ import annotations

import math
import os
import threading

import numpy as np
import pytest
from support.common.eventfiles import EVENT, Made, made
from support.common.imagefiles import refused

from lava_vpr.events.camera import EventCamera, Sensor
from lava_vpr.events.files import EVENT_STREAM, event_samples
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
    assert EVENT_STREAM.fullmatch("events:346x260")
    assert not EVENT_STREAM.fullmatch("events:346")
    assert not EVENT_STREAM.fullmatch("events")


QUIET = Sensor(mismatch=0.0, refractory_us=0, noise_hz=0.0, hot=0.0)


def test_events_are_those_of_each_pixel_alone() -> None:
    rng = np.random.default_rng(3)
    pictures = rng.uniform(0, 255, (12, 5, 7)).astype(np.float32)
    camera = EventCamera(pictures[0], np.random.default_rng(0), QUIET)
    step = 1000
    found = set()
    for k, picture in enumerate(pictures[1:]):
        sent = camera.see(picture, k * step, (k + 1) * step)
        assert (np.diff(sent.t) >= 0).all()
        found |= set(zip(sent.t.tolist(), sent.x.tolist(), sent.y.tolist(), sent.p.tolist(), strict=True))
    wanted = set()
    for row in range(5):
        for column in range(7):
            light = [math.log(float(value) + 10) for value in pictures[:, row, column]]
            level = light[0]
            for k in range(11):
                before, now = light[k], light[k + 1]
                while abs(now - level) >= QUIET.threshold:
                    level += math.copysign(QUIET.threshold, now - level)
                    share = min(1.0, max(0.0, (level - before) / (now - before)))
                    wanted.add((k * step + math.floor(share * step), column, row, now > before))
    assert len(wanted) > 500
    close = {(t + off, x, y, p) for t, x, y, p in wanted for off in (-1, 0, 1)}  # rounding of a level's time
    assert found <= close
    assert len(found) == len(wanted)


def test_pixels_rest() -> None:
    pictures = [np.full((3, 3), level, np.float32) for level in (0, 250, 0)]
    sensor = Sensor(mismatch=0.0, refractory_us=400, noise_hz=0.0, hot=0.0)
    camera = EventCamera(pictures[0], np.random.default_rng(0), sensor)
    sent = [camera.see(picture, 1000 * k, 1000 * k + 1000) for k, picture in enumerate(pictures[1:])]
    one = np.concatenate([part.t[(part.x == 1) & (part.y == 1)] for part in sent])
    assert 2 <= len(one) <= 6
    assert (np.diff(one) >= 400).all()
    signs = np.concatenate([part.p[(part.x == 1) & (part.y == 1)] for part in sent])
    assert signs[0]
    assert not signs[-1]


def test_noise_has_its_rates_and_thresholds_differ() -> None:
    still = np.full((60, 60), 100, np.float32)
    sensor = Sensor(noise_hz=2.0, hot=0.002, hot_hz=300.0)
    camera = EventCamera(still, np.random.default_rng(1), sensor)
    sent = [camera.see(still, k * 100_000, (k + 1) * 100_000) for k in range(100)]
    counts = np.zeros((60, 60), np.int64)
    for part in sent:
        np.add.at(counts, (part.y, part.x), 1)
    hot = counts > 1000
    assert 1 <= hot.sum() <= 20
    assert counts[~hot].mean() / 10 == pytest.approx(2.0, rel=0.05)
    assert counts[hot].mean() / 10 == pytest.approx(300.0, rel=0.25)  # some come while the pixel rests
    brighter = still * 1.4
    first = camera.see(brighter, 10_000_000, 10_001_000)
    assert 0 < len({*zip(first.x.tolist(), first.y.tolist(), strict=True)}) <= 3600
    spread = np.std(first.t - 10_000_000)
    assert spread > 20  # with equal thresholds all would come at the same time


def test_equal_seeds_give_equal_events() -> None:
    rng = np.random.default_rng(5)
    pictures = rng.uniform(0, 255, (4, 8, 8)).astype(np.float32)
    runs = []
    for _ in range(2):
        camera = EventCamera(pictures[0], np.random.default_rng(7))
        runs.append([camera.see(picture, k * 10_000, (k + 1) * 10_000) for k, picture in enumerate(pictures[1:])])
    for one, other in zip(*runs, strict=True):
        for values, same in zip(one, other, strict=True):
            np.testing.assert_array_equal(values, same)
