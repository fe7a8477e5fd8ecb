"""Images placed on a track, by their times or by its rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.common.imagefiles import QUICK, refused

from lava_vpr.positions.frames import LAT_LON, XY, Positions
from lava_vpr.positions.tables import Track
from lava_vpr.positions.track import PositionRequest, images_on

T0 = 1.7e9


def track(values: list[tuple[float, float]], times: list[float] | None, frame: str = XY) -> Track:
    return Track(
        Positions(np.array(values, np.float64), frame),
        None if times is None else np.array(times, np.float64),
        Path("p.csv"),
    )


def asked(stamps: list[float] | None, count: int | None = None, whole: int | None = None) -> PositionRequest:
    n = len(stamps) if stamps is not None else count or 0
    return PositionRequest(
        np.arange(n), n if whole is None else whole, None if stamps is None else np.array(stamps, np.float64)
    )


@QUICK
@given(
    st.lists(st.tuples(st.floats(0.1, 9.9), st.floats(-100, 100), st.floats(-100, 100)), min_size=2, max_size=20),
    st.lists(st.floats(0, 1), min_size=1, max_size=30),
)
def test_images_lie_between_the_points_around_them(
    steps: list[tuple[float, float, float]], shares: list[float]
) -> None:
    times = np.cumsum([step[0] for step in steps])
    values = np.array([step[1:] for step in steps])
    stamps = times[0] + np.array(shares) * (times[-1] - times[0])
    stamps = np.clip(stamps, times[0], times[-1])
    found, when = images_on(Track(Positions(values, XY), times, Path("p")), asked(stamps.tolist()))
    wanted = np.stack([np.interp(stamps, times, axis) for axis in values.T], axis=1)
    np.testing.assert_allclose(found.values, wanted, atol=1e-9)
    assert when is not None
    np.testing.assert_array_equal(when, stamps)


def test_one_hertz_beside_ten() -> None:
    second = np.arange(11.0)
    gps = track([(10 * t, 5.0) for t in second], (T0 + second).tolist())
    images = T0 + np.arange(100) / 10
    found, _ = images_on(gps, asked(images.tolist()))
    np.testing.assert_allclose(found.values[:, 0], 10 * (images - T0), atol=1e-4)


def test_longitudes_go_the_short_way_round() -> None:
    found, _ = images_on(track([(0, 179.9), (0, -179.9)], [0, 4], LAT_LON), asked([0, 1, 2, 3, 4]))
    np.testing.assert_allclose(found.values[:, 1] % 360, [179.9, 179.95, 180.0, 180.05, 180.1])


def test_equal_times_and_a_lone_point() -> None:
    found, _ = images_on(track([(0, 0), (1, 0), (3, 0)], [0, 0, 1]), asked([0, 0.5, 1]))
    np.testing.assert_allclose(found.values[:, 0], [0, 2, 3])
    found, _ = images_on(track([(7, 8)], [5]), asked([5, 5]))
    assert found.values.tolist() == [[7, 8], [7, 8]]


@pytest.mark.parametrize(
    ("times", "images", "gap", "part"),
    [
        ([0, 1], [0, 1.5], 10, "p.csv: image 1 was taken at 1.5 s, outside the track (0..1); leave out images without"),
        ([1, 2], [0.5], 10, "image 0 was taken at 0.5 s, outside the track (1..2)"),
        ([0, 11], [0, 5, 11], 10, "image 1 was taken in a gap of 11.0 s between two positions (1 of 3 images were)"),
        ([0, 2], [1], 1, "longer than 1 s; complete the track, leave the images out, or allow more with --gap"),
        ([T0, T0 + 1], [0, 1, 2], 10, "with times for 3 images, whose times are seconds since their own start"),
        ([0, 1], [T0, T0, T0], 10, "with times for 3 images, whose times are seconds since 1970"),
        ([0, 1], None, 10, "has 2 positions with times for 3 images, of which nobody says when they were taken"),
    ],
)
def test_images_that_cannot_be_placed(times: list[float], images: list[float] | None, gap: float, part: str) -> None:
    gps = track([(0, 0), (1, 1)], times)
    refused(lambda: images_on(gps, asked(images, count=3), gap), part)


def test_a_gap_is_no_matter_at_its_ends() -> None:
    found, _ = images_on(track([(0, 0), (9, 9)], [0, 60]), asked([0, 60]))
    assert found.values.tolist() == [[0, 0], [9, 9]]


def test_a_gap_is_longer_than_ten_seconds() -> None:
    found, _ = images_on(track([(0, 0), (20, 0)], [0, 10]), asked([4]))
    assert found.values.tolist() == [[8, 0]]
    refused(lambda: images_on(track([(0, 0), (20, 0)], [0, 10.5]), asked([4])), "gap of 10.5 s", "longer than 10 s")


@pytest.mark.parametrize("times", [None, [0.0, 2.0, 4.0]])
def test_a_row_an_image_needs_no_times(times: list[float] | None) -> None:
    gps = track([(0, 0), (1, 1), (2, 2)], times)
    some = PositionRequest(np.array([2, 0]), 3)
    found, when = images_on(gps, some)
    assert found.values.tolist() == [[2, 2], [0, 0]]
    assert (None if when is None else when.tolist()) == (None if times is None else [4, 0])
    refused(lambda: images_on(track([(0, 0)], None), some), "p.csv: has 1 positions, image 2 has none; give one a line")
