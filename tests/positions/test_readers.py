"""Positions and times from CSV tables, GPX files and file names."""

from __future__ import annotations

import time
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest
from support.common.imagefiles import refused, written

from lava_vpr.errors import InputError
from lava_vpr.positions.frames import LAT_LON, XY, Positions, positions_of_names, stamp_of, stamps_of_names
from lava_vpr.positions.gpx import gpx_text, read_gpx
from lava_vpr.positions.track import read_stamps, read_table, read_track
from lava_vpr.storage.limits import variable

NOON = datetime(2024, 5, 1, 12, tzinfo=timezone.utc).timestamp()


def table(path: Path, text: str) -> Path:
    return written(path, text.encode())


# ---------------------------------------------------------------- tables


@pytest.mark.parametrize(
    "text",
    [
        "x,y\n1,2\n3.5,-4e1\n",
        "1,2\n3.5,-4e1",
        "n,Y,X\n0,2,1\n\n# c\n1,-40,3.5\n",
        "1;2\n3.5;-40",
        "easting,northing\n1,2\n3.5,-40\n",
        "lat,lon,x,y\n60,10,1,2\n60,10,3.5,-40\n",
    ],
)
def test_positions_in_metres(tmp_path: Path, text: str) -> None:
    got = read_track(table(tmp_path / "p.csv", text))
    assert (got.positions.frame, got.stamps) == (XY, None)
    np.testing.assert_array_equal(got.positions.values, [[1, 2], [3.5, -40]])


@pytest.mark.parametrize("header", ["lat,lon", "Latitude,Longitude", "lat,lng"])
def test_positions_in_degrees(tmp_path: Path, header: str) -> None:
    got = read_table(table(tmp_path / "p.csv", f"{header}\n60,10\n-60.5,359\n"))
    assert got.positions.frame == LAT_LON
    np.testing.assert_array_equal(got.positions.values, [[60, 10], [-60.5, 359]])


@pytest.mark.parametrize("name", ["time", "Timestamp", "stamp", "t"])
@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (("0", "0.1", "0.1"), (0, 0.1, 0.1)),
        ((f"{NOON:.0f}", f"{NOON + 1:.0f}.25", f"{NOON + 2:.0f}"), (NOON, NOON + 1.25, NOON + 2)),
        ((f"{NOON:.0f}000", f"{NOON:.0f}500", f"{NOON + 1:.0f}000"), (NOON, NOON + 0.5, NOON + 1)),
        ((f"{NOON:.0f}000000", f"{NOON:.0f}500000", f"{NOON:.0f}500001"), (NOON, NOON + 0.5, NOON + 0.500001)),
        ((f"{NOON:.0f}000000000",) * 3, (NOON,) * 3),
        (("2024-05-01T12:00:00Z", "2024-05-01 14:00:00.5+02:00", "20240501_120001"), (NOON, NOON + 0.5, NOON + 1)),
        (("2024-05-01T06:30:00-05:30", "2024-05-01T12:00:00.25", "2024-05-01T12-00-01"), (NOON, NOON + 0.25, NOON + 1)),
    ],
)
def test_times_are_numbers_of_any_unit_or_dates(
    tmp_path: Path, name: str, cells: tuple[str, ...], seconds: tuple[float, ...]
) -> None:
    rows = "".join(f"{k},0,{cell}\n" for k, cell in enumerate(cells))
    path = table(tmp_path / "p.csv", f"x,y,{name}\n{rows}")
    got = read_table(path).stamps
    assert got is not None
    np.testing.assert_allclose(got, seconds, rtol=0, atol=3e-7)
    np.testing.assert_array_equal(read_stamps(path), got)
    np.testing.assert_array_equal(read_stamps(table(tmp_path / "t.csv", "\n".join(cells))), got)


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("99999999999", 99_999_999_999.0),  # the year 5138
        ("100000000000", 1e8),  # milliseconds from here on,
        ("100000000000000", 1e8),  # microseconds,
        ("100000000000000000", 1e8),  # nanoseconds,
        ("100000000000000000000", 1e11),  # and of nothing smaller
    ],
)
def test_the_unit_of_a_time_follows_from_its_size(tmp_path: Path, cell: str, seconds: float) -> None:
    assert read_stamps(table(tmp_path / "t.csv", f"time\n{cell}\n")).tolist() == [seconds]


def test_a_column_called_time_goes_before_others(tmp_path: Path) -> None:
    got = read_table(table(tmp_path / "p.csv", "t,x,y,time\n7,1,2,5\n"))
    assert got.stamps is not None
    assert got.stamps.tolist() == [5]


@pytest.mark.parametrize("text", ["", "12 o'clock", "2024-13-01T00:00:00", "0000-01-01T00:00:00", "2024-05-01", "nan"])
def test_what_is_no_time_is_none(text: str) -> None:
    assert not np.isfinite(stamp_of(text))


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "p.csv: holds no positions; write one row an image"),
        ("x,y\n", "p.csv: holds no positions"),
        ("a,b\n1,2\n", "p.csv line 1: no columns x,y or lat,lon among 'a', 'b'; name them"),
        ("1,2,3\n", "p.csv line 1: has 3 columns and no header; add one: x,y"),
        ("x,y,x\n1,2,3\n", "p.csv line 1: has 2 columns 'x'; rename all but one"),
        ("x,y,t,T\n1,2,3,4\n", "p.csv line 1: has 2 columns 't'; rename all but one"),
        ("x,y\n1,2\n3\n", "p.csv line 3: has 1 cells, but line 1 has 2; write"),
        ("x,y\n1,2\n,\n3,4\n", "p.csv line 3: x is ''"),
        ("x,y\n\n1,2\n3,nan\n", "p.csv line 4: y is 'nan'; give a number in its range"),
        ("x,y\ninf,2\n", "p.csv line 2: x is 'inf'"),
        ("x,y\n1e30,2\n", "p.csv line 2: x is '1e30'"),
        ("1,2\n3,four\n", "p.csv line 2: y is 'four'"),
        ("lat,lon\n91,2\n", "p.csv line 2: latitude is '91'; give a number in its range"),
        ("lat,lon\n9,400\n", "p.csv line 2: longitude is '400'"),
        (
            "x,y,time\n1,2,0\n1,2,noon\n",
            "p.csv line 3: the time is 'noon'; write seconds, or a date as in 2024-05-01T12",
        ),
        ("x,y,time\n1,2,5\n1,2,4\n", "p.csv line 3: the time '4' is before that above; sort the rows"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path: Path, text: str, part: str) -> None:
    path = table(tmp_path / "p.csv", text)
    refused(lambda: read_track(path), part)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "t.csv: holds no times; write one row an image, column time"),
        ("name\na\n", "t.csv line 1: no column time among 'name'; name it"),
        ("1,2\n", "t.csv line 1: has 2 columns and no header; add one: time"),
        ("time\n1\nx\n", "t.csv line 3: the time is 'x'"),
    ],
)
def test_stamps_that_cannot_be_used(tmp_path: Path, text: str, part: str) -> None:
    path = table(tmp_path / "t.csv", text)
    refused(lambda: read_stamps(path), part)


# ---------------------------------------------------------------- GPX

POINT = '<trkpt lat="{}" lon="{}">{}</trkpt>'


def nested(levels: int) -> str:
    """A GPX file with so many levels of what a receiver adds, which gpxpy copies by a recursion in C."""
    return '<gpx version="1.1">' + "<extensions>" * levels + "</extensions>" * levels + "</gpx>"


def gpx(*points: str, root: str = "gpx") -> str:
    whole = "".join(points)
    return f'<?xml version="1.0"?>\n<{root} version="1.1"><trk><trkseg>{whole}</trkseg></trk></{root}>'


def at(second: str) -> str:
    return f"<time>2024-05-01T12:00:{second}</time>"


def test_a_track_of_several_segments(tmp_path: Path) -> None:
    text = gpx(POINT.format(60, 10, at("00Z")), "</trkseg><trkseg>", POINT.format(60.5, -10.25, at("01.5+00:00")))
    got = read_track(table(tmp_path / "P.GPX", text))
    assert got.positions.frame == LAT_LON
    np.testing.assert_array_equal(got.positions.values, [[60, 10], [60.5, -10.25]])
    assert got.stamps is not None
    np.testing.assert_array_equal(got.stamps, [NOON, NOON + 1.5])


@pytest.mark.parametrize("kind", ["route", "waypoints"])
def test_points_without_a_track(tmp_path: Path, kind: str) -> None:
    points = '<wpt lat="1" lon="2"/><wpt lat="3" lon="4"/>'
    inner = points if kind == "waypoints" else f'<wpt lat="8" lon="9"/><rte>{points.replace("wpt", "rtept")}</rte>'
    got = read_gpx(table(tmp_path / "p.gpx", f'<gpx version="1.1">{inner}</gpx>'))
    assert got.positions.values.tolist() == [[1, 2], [3, 4]]
    assert got.stamps is None


def test_a_time_without_a_zone_is_no_local_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = table(tmp_path / "p.gpx", gpx(POINT.format(1, 2, at("00"))))
    with monkeypatch.context() as there:
        there.setenv("TZ", "JST-9")
        time.tzset()
        got = read_gpx(path).stamps
    time.tzset()
    assert got is not None
    assert got.tolist() == [NOON]


def test_many_namespaces_are_none_too_many_up_to_a_hundred(tmp_path: Path) -> None:
    text = gpx(f"<!--{' xmlns' * 100}-->", POINT.format(1, 2, ""))
    assert read_gpx(table(tmp_path / "p.gpx", text)).positions.values.tolist() == [[1, 2]]


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    places = Positions(np.array([[59.1234567, 10.7654321], [-1e-7, -180.0]]), LAT_LON)
    got = read_gpx(table(tmp_path / "p.gpx", gpx_text(places, np.array([NOON, NOON + 0.25]))))
    np.testing.assert_array_equal(got.positions.values, places.values)
    assert got.stamps is not None
    np.testing.assert_array_equal(got.stamps, [NOON, NOON + 0.25])


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "p.gpx: is no GPX, or cut short ("),
        ("x,y\n1,2\n", "p.gpx: is no GPX, or cut short ("),
        (gpx(POINT.format(1, 2, ""))[:-20], "p.gpx: is no GPX, or cut short ("),
        (gpx(root="kml"), "p.gpx: holds no points; export a track"),
        (gpx(), "p.gpx: holds no points; export a track"),
        (gpx(POINT.format("north", 2, "")), "p.gpx: is no GPX, or cut short ("),
        (gpx(POINT.format(1, 2, ""), POINT.format(91, 2, "")), "p.gpx: point 2 is at 91, 2; remove or correct it"),
        (gpx(POINT.format("nan", 2, "")), "p.gpx: point 1 is at nan, 2"),
        (gpx(POINT.format(1, 2, at("00Z")), POINT.format(1, 2, "")), "p.gpx: point 2 has no time, but others have"),
        (
            gpx(POINT.format(1, 2, at("00Z")), POINT.format(1, 2, "<time>noon</time>")),
            "p.gpx: point 2 has no time, but others have",
        ),
        (gpx(POINT.format(1, 2, at("02Z")), POINT.format(1, 2, at("01Z"))), "p.gpx: point 2 is earlier than the point"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + gpx(), "p.gpx: is no GPX (it declares a document type)"),
        (gpx() + " xmlns" * 101, "p.gpx: is no GPX (it declares 101 namespaces)"),
        (nested(99), "p.gpx: holds no points"),
        (nested(100), "p.gpx: is no GPX, or cut short ('its elements are nested more than 100 deep')"),
        (nested(200_000), "p.gpx: is no GPX, or cut short ('its elements are nested more than 100 deep')"),
    ],
)
def test_gpx_that_cannot_be_used(tmp_path: Path, text: str, part: str) -> None:
    path = table(tmp_path / "p.gpx", text)
    refused(lambda: read_track(path), part)


def test_the_points_of_a_gpx_file_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = table(tmp_path / "p.gpx", gpx(*[POINT.format(1, 2, "")] * 3))
    monkeypatch.setenv(variable("points"), "3")
    assert len(read_gpx(path).positions) == 3
    monkeypatch.setenv(variable("points"), "2")
    refused(lambda: read_gpx(path), f"{path.name}: has 3", variable("points"))


# ---------------------------------------------------------------- names

FULL = "@0545981.19@4184971.70@10@S@037.81098@-122.47762@rtCs5-P_9NGDz@@174@@@@20140901_120000@@.jpg"


def test_names_of_the_field_tell_position_and_time() -> None:
    found = positions_of_names([FULL, FULL.replace("5981", "5982")], "d")
    assert found is not None
    assert found.frame == "UTM 10N"
    assert found.values.tolist() == [[545981.19, 4184971.70], [545982.19, 4184971.70]]
    stamps = stamps_of_names([FULL])
    assert stamps is not None
    assert stamps.tolist() == [datetime(2014, 9, 1, 12, tzinfo=timezone.utc).timestamp()]
    assert stamps_of_names([FULL.replace("20140901_120000", "201409")]) is None


@pytest.mark.parametrize(
    ("name", "frame", "values"),
    [
        ("@0@2.3@.jpg", XY, [0, 2.3]),
        ("@-5.@+7@@@@.png", XY, [-5, 7]),
        ("@500000@9000000@31@M@.jpg", "UTM 31S", [500000, 9000000]),
        ("@500000@90@31@n@.jpg", "UTM 31N", [500000, 90]),
        ("@1@2@61@S@.jpg", XY, [1, 2]),
        ("@1@2@10@I@.jpg", XY, [1, 2]),
    ],
)
def test_zones_of_names(name: str, frame: str, values: list[float]) -> None:
    found = positions_of_names([name], "d")
    assert found is not None
    assert (found.frame, found.values.tolist()) == (frame, [values])


@pytest.mark.parametrize(
    "name", ["a.jpg", "@1.jpg", "@1@two@.jpg", "@nan@1@.jpg", "x@1@2@.jpg", "@1e5@2@.jpg", "@@@.jpg"]
)
def test_other_names_tell_no_position(name: str) -> None:
    assert positions_of_names([name], "d") is None
    assert positions_of_names([FULL, name], "d") is None
    assert positions_of_names([], "d") is None


def test_names_of_two_zones_become_degrees() -> None:
    west = Positions(np.array([[59.9, 5.99], [59.9, 6.01]]), LAT_LON)
    zones = [west.take([0]).to("UTM 31N"), west.take([1]).to("UTM 32N")]
    names = [f"@{z.values[0, 0]:.3f}@{z.values[0, 1]:.3f}@{z.frame[4:6]}@V@.jpg" for z in zones]
    found = positions_of_names(names, "d")
    assert found is not None
    assert found.frame == LAT_LON
    np.testing.assert_allclose(found.values, west.values, atol=1e-6)


@pytest.mark.parametrize(
    ("names", "part"),
    [
        ([FULL, "@1@2@.jpg"], "d: the name '@1@2@.jpg' has no UTM zone, but others have"),
        ([f"@{'9' * 30}@2@.jpg"], "has no position in metres; rename it"),
    ],
)
def test_names_that_contradict_each_other(names: list[str], part: str) -> None:
    with pytest.raises(InputError, match=part.replace("(", r"\(")):
        positions_of_names(names, "d")


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        (["1714564800.5.png", "1714564801.png"], [NOON + 0.5, NOON + 1]),
        (["1714564800500.png", "1714564801000.png"], [NOON + 0.5, NOON + 1]),
        (["2024-05-01T12:00:00Z.png", "20240501_120001.png"], [NOON, NOON + 1]),
        (["000001.png", "000002.png"], None),
        (["999999999.png"], None),
        (["1000000000.png"], [1e9]),
        (["1714564800.png", "img.png"], None),
        (["frame 000012"], None),
        ([], None),
    ],
)
def test_times_of_other_names(names: list[str], wanted: list[float] | None) -> None:
    found = stamps_of_names(names)
    assert (None if found is None else found.tolist()) == wanted
