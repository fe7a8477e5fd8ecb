"""Frames of positions: distances, conversions, drawings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from support.common.imagefiles import QUICK, refused

from lava_vpr.errors import InputError
from lava_vpr.positions.frames import LAT_LON, XY, Positions, columns, distances, fits, is_frame, joined, utm_frame
from lava_vpr.positions.track import PositionRequest, Track, images_on

SAN_FRANCISCO = (37.81098, -122.47762), (545981.19, 4184971.70)
"""Latitude and longitude, easting and northing in UTM zone 10, as a published dataset names one of its images."""


def degrees(*rows: tuple[float, float]) -> Positions:
    return Positions(np.array(rows, dtype=np.float64), LAT_LON)


def haversine(a: np.ndarray, b: np.ndarray) -> float:
    """Metres between two points in degrees on a sphere of 6,371,008.8 m."""
    (lat, lon), (lat2, lon2) = np.radians(a), np.radians(b)
    h = np.sin((lat2 - lat) / 2) ** 2 + np.cos(lat) * np.cos(lat2) * np.sin((lon2 - lon) / 2) ** 2
    return float(2 * 6_371_008.8 * np.arcsin(np.sqrt(h)))


def test_utm_is_that_of_a_published_image() -> None:
    there = degrees(SAN_FRANCISCO[0]).to("UTM 10N")
    np.testing.assert_allclose(there.values[0], SAN_FRANCISCO[1], atol=0.6)  # its degrees have five digits
    np.testing.assert_allclose(there.to(LAT_LON).values[0], SAN_FRANCISCO[0], atol=1e-7)
    assert distances(there, degrees(SAN_FRANCISCO[0]))[0] < 1e-3


@pytest.mark.parametrize("zone", ["UTM 31N", "UTM 33N", "UTM 32S"])
def test_a_neighbouring_zone_is_another_frame_of_the_same_places(zone: str) -> None:
    places = degrees((59.9, 10.7), (60.0, 10.8), (60.1, 11.2))
    np.testing.assert_allclose(
        places.to(zone).to("UTM 32N").to(LAT_LON).values, places.values, atol=1e-5
    )  # half a metre, from a zone away
    step = distances(places.take([0, 1]).to(zone), places.take([1, 2]))
    np.testing.assert_allclose(step, [haversine(*places.values[:2]), haversine(*places.values[1:])], rtol=0.01)


@pytest.mark.parametrize("at", [(0.0, 0.0), (60.0, 10.0), (-45.0, 179.9999), (84.0, -180.0), (89.999, 7.0)])
def test_distances_of_degrees_are_those_of_the_sphere(at: tuple[float, float]) -> None:
    rng = np.random.default_rng(3)
    ours = np.array([at])
    theirs = ours + rng.uniform(-1e-3, 1e-3, (20, 2))
    theirs[:, 0] = np.clip(theirs[:, 0], -90, 90)
    got = distances(Positions(np.tile(ours, (20, 1)), LAT_LON), Positions(theirs, LAT_LON))
    np.testing.assert_allclose(got, [haversine(ours[0], there) for there in theirs], rtol=1e-4, atol=1e-6)


def test_a_drawing_of_degrees_keeps_distances_across_the_date_line() -> None:
    route = degrees((45.0, 179.99), (45.001, -179.99), (45.002, 180.03))
    plane = route.plane()
    gaps = np.hypot(*np.diff(plane, axis=0).T)
    np.testing.assert_allclose(gaps, [haversine(*route.values[:2]), haversine(*route.values[1:])], rtol=1e-3)
    assert plane[1, 1] > plane[0, 1]


def test_a_drawing_is_about_the_middle_of_its_degrees() -> None:
    """About 30 N, 5 E: 111,195.08 m to a degree north, and of a degree east the cosine of 30 degrees, 96,297.76 m."""
    found = degrees((0, 0), (60, 10), (6, 2)).plane()
    wanted = [
        [-5 * 96_297.7638, -30 * 111_195.0797],
        [5 * 96_297.7638, 30 * 111_195.0797],
        [-288_893.291, -2_668_681.91],
    ]
    np.testing.assert_allclose(found, wanted, rtol=1e-8)


@pytest.mark.parametrize(
    ("values", "frame", "message"),
    [
        ([[0, 0], [np.nan, 0]], XY, r"position 1 is \[nan, 0.0\], not finite or out of the range of xy; correct it"),
        ([[0, np.inf]], "UTM 32N", r"position 0 is \[0.0, inf\], not finite or out of the range of UTM 32N"),
        ([[1e300, 0]], XY, r"position 0 is \[1e\+300, 0.0\], not finite"),
        ([[91, 0]], LAT_LON, r"position 0 is \[91.0, 0.0\], not finite or out of the range of latlon"),
        ([[0, 0, 0]], XY, r"positions are of type int64 and shape \(1, 3\); give two real numbers"),
        ([0, 0], XY, r"shape \(2,\)"),
        ([[0, 0], [0]], XY, "positions are of type object"),
        ([["1", "2"]], XY, "positions are of type <U1"),
        ([[True, False]], XY, "positions are of type bool"),
        ([[1j, 0]], XY, "positions are of type complex128"),
        (None, XY, "positions are of type object"),
        ([[0, 0]], "nope", "positions have the frame 'nope'; name xy, latlon, or a zone as in UTM 32N"),
        ([[0, 0]], None, "positions have the frame None"),
    ],
)
def test_positions_that_are_none_are_refused(values: Any, frame: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Positions(values, frame)


def test_positions_are_numbers_of_their_own() -> None:
    given = np.array([[1, 2], [3, 4]], np.int32)
    taken = Positions(given, XY)
    given[0] = 9
    assert taken.values.dtype == np.float64
    assert taken.values.tolist() == [[1, 2], [3, 4]]
    floats = np.zeros((1, 2))
    taken = Positions(floats, XY)
    floats[0] = np.nan
    assert taken.values.tolist() == [[0, 0]]


def test_metres_without_a_zone_are_taken_for_any_metres() -> None:
    here, there = Positions(np.array([[3.0, 4.0]]), XY), Positions(np.zeros((1, 2)), "UTM 32N")
    assert distances(here, there).tolist() == [5.0]
    assert distances(there, here).tolist() == [5.0]
    assert joined([there, here]).frame == "UTM 32N"
    refused(lambda: distances(here, degrees((0, 0))), "x,y and in lat,lon cannot be compared")


def test_what_is_beyond_utm_is_refused() -> None:
    refused(lambda: degrees((85.0, 10.0)).to("UTM 32N"), "beyond UTM, which ends at 80 S and 84 N")


def test_frames_and_ranges() -> None:
    assert [
        name
        for name in ("xy", "latlon", "UTM 1N", "UTM 60S", "UTM 0N", "UTM 61N", "utm 3N", "UTM 07N")
        if is_frame(name)
    ] == [
        "xy",
        "latlon",
        "UTM 1N",
        "UTM 60S",
    ]
    assert utm_frame(7, north=False) == "UTM 7S"
    assert (columns(LAT_LON), columns(utm_frame(7, True)), columns(XY)) == (("lat", "lon"), ("x", "y"), ("x", "y"))
    values = np.array([[90.0, 360.0], [-90.1, 10.0], [np.nan, np.inf]])
    assert fits(values, LAT_LON).tolist() == [[True, True], [False, True], [False, False]]
    assert fits(values, XY).tolist() == [[True, True], [True, True], [False, False]]
    largest = np.array([[9_007_199_254_740_992.0, -9_007_199_254_740_994.0]])  # 2^53, and the next number beyond
    assert fits(largest, XY).tolist() == [[True, False]]


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
