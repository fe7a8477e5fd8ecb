"""Windows of events: against a plain loop, whatever pieces the events come in; noise; images."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.common.eventfiles import Made, made

from lava_vpr.errors import ConfigError
from lava_vpr.events.stream import Events
from lava_vpr.events.windows import Removed, Windows, hot_pixels, levels
from lava_vpr.inputs.windows import EventsConfig

SIZE = (6, 4)
NONE_HOT = np.zeros((4, 6), np.bool_)


def as_events(events: Made, cuts: list[int]) -> list[Events]:
    """The events in pieces."""
    ends = sorted({0, len(events.t), *(cut for cut in cuts if cut < len(events.t))})
    return [
        Events(events.t[a:b], events.x[a:b].astype(np.uint16), events.y[a:b].astype(np.uint16))
        for a, b in pairwise(ends)
    ]


def shown(windows: Windows, pieces: list[Events]) -> list[tuple[float, NDArray[np.uint8]]]:
    """Middle in seconds and image of every window."""
    found = [(one, one.read()) for one in windows.all(pieces)]
    assert [one.number for one, _ in found] == list(range(len(found)))
    return [(one.stamp or 0.0, image) for one, image in found]


def plainly(events: Made, config: EventsConfig, every_us: int) -> list[tuple[float, NDArray[np.int64]]]:
    """Middle and counts of every window, by a loop over events as the words of `Windows` say it."""
    found: list[tuple[float, NDArray[np.int64]]] = []
    last: dict[tuple[int, int], int] = {}
    origin = start = int(events.t[0])
    span = round(config.window_ms * 1000)
    counts, kept, latest = np.zeros((4, 6), np.int64), 0, 0

    def end(at: int) -> None:
        nonlocal counts, kept
        if kept:
            found.append(((start + at) / 2, counts))
        counts, kept = np.zeros((4, 6), np.int64), 0

    for t, x, y in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), strict=True):
        while not config.window_events and t >= start + span:
            end(start + span)
            start = origin + math.ceil((start + span - origin) / every_us) * every_us
        if t < start:
            continue
        latest = t
        if t - last.get((x, y), -(10**15)) < config.refractory_us:
            continue
        last[x, y] = t
        counts[y, x] += 1
        kept += 1
        if config.window_events and kept == config.window_events:
            end(t)
            start = origin + math.ceil((t + 1 - origin) / every_us) * every_us
    if config.window_events and kept >= config.window_events / 2:
        end(latest)
    elif not config.window_events and latest - start >= span / 2:
        end(start + span)
    return found


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.integers(0, 400), min_size=1, max_size=60),
    st.integers(0, 2**32 - 1),
    st.integers(0, 30),
    st.integers(1, 300),
    st.integers(0, 5),
    st.integers(0, 50),
    st.lists(st.integers(0, 60), max_size=4),
)
def test_windows_are_those_of_a_plain_loop(
    gaps: list[int], seed: int, count: int, span_10us: int, every_ms: int, refractory: int, cuts: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    n = len(gaps)
    events = Made(np.cumsum(gaps) * 7, rng.integers(0, 6, n), rng.integers(0, 4, n), rng.random(n) < 0.5, SIZE)
    config = EventsConfig(
        window_ms=max(0.1, span_10us / 100), window_events=count, refractory_us=refractory, hot_pixels=0.0
    )
    every = max(every_ms / 1000, 0.001)
    found = shown(Windows(SIZE, config, every, NONE_HOT), as_events(events, cuts))
    wanted = plainly(events, config, round(every * 1e6))
    assert [middle for middle, _ in found] == [middle / 1e6 for middle, _ in wanted]
    for (_, image), (_, counts) in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(image, levels(counts.astype(np.float32)))


@pytest.mark.parametrize("image", ["counts", "surface"])
@pytest.mark.parametrize("count", [0, 200])
def test_pieces_do_not_matter_where_hot_pixels_are_found_on_the_way(image: Any, count: int) -> None:
    events, config = made(4000, 2.0), EventsConfig(window_ms=50, window_events=count, image=image, hot_pixels=1.5)
    whole, cut = (
        shown(Windows(events.size, config, 0.1), as_events(events, cuts)) for cuts in ([], [1, 2, 700, 1999, 3998])
    )
    assert len(whole) == len(cut) > 8
    for (middle, picture), (other, same) in zip(whole, cut, strict=True):
        assert middle == other
        np.testing.assert_array_equal(picture, same)


def test_hot_pixels_stand_out_of_their_surroundings_and_of_the_sensor() -> None:
    counts = np.zeros((20, 30), np.int64)
    counts[5:15] = 100  # a lively band, whose edge is no hot pixel
    counts[2, 3] = 2000
    counts[10, 20] = 2000
    counts[18, 8] = 90  # more than all around it, but no more than the sensor has
    hot = hot_pixels(counts, 8.0)
    assert np.argwhere(hot).tolist() == [[2, 3], [10, 20]]
    assert not hot_pixels(counts, 0).any()


def test_what_is_left_out_is_counted() -> None:
    t = np.array([0, 10, 500, 1200, 1300, 1301], np.int64)
    x = np.array([0, 0, 0, 0, 1, 2], np.uint16)
    hot = NONE_HOT.copy()
    hot[0, 2] = True
    windows = Windows(SIZE, EventsConfig(window_ms=1.0, refractory_us=1000), 0.001, hot)
    found = shown(windows, [Events(t, x, x * 0)])
    assert windows.removed == Removed(kept=3, hot=1, soon=2)
    assert [middle for middle, _ in found] == [500e-6]  # of the second window only 301 of 1000 us are there


def test_a_surface_is_brighter_the_later_the_event() -> None:
    t = np.array([0, 4000, 8000, 10_000], np.int64)
    x = np.array([0, 1, 2, 0], np.uint16)
    windows = Windows(SIZE, EventsConfig(window_ms=10.0, image="surface", hot_pixels=0.0), 0.01)
    (_, image), *_ = shown(windows, [Events(t, x, x * 0)])
    ages = np.array([10_000, 6000, 2000]) / 5000
    wanted = np.exp(-ages)
    np.testing.assert_allclose(image[0, :3] / image[0, 2], wanted / wanted[2], atol=0.01)
    assert not image[:, 3:].any()
    assert not image[1:].any()


def test_a_large_sensor_is_averaged_down() -> None:
    events = made(5000, 1.0, size=(640, 480))
    windows = Windows(events.size, EventsConfig(window_ms=400, side=64), 0.4)
    (_, image), *_ = shown(windows, as_events(events, []))
    assert image.shape == (48, 64)
    assert image.max() == 255


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"image": "colour"}, "counts or surface"),
        ({"window_ms": 0.0}, "events.window_ms"),
        ({"window_ms": float("nan")}, "events.window_ms"),
        ({"window_events": -1}, "events.window_events"),
        ({"side": 4}, "events.side"),
        ({"refractory_us": 0.5}, "events.refractory_us"),
        ({"hot_pixels": -1.0}, "events.hot_pixels"),
    ],
)
def test_settings_out_of_range_are_refused(said: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        EventsConfig(**said)
