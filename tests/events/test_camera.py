"""The event camera against a plain one, pixel by pixel; its noise and its rests."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lava_vpr.events.camera import EventCamera, Sensor

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
