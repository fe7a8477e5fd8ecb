"""Positions and keyframes from the command line, on the synthetic route."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import images, listed, matches, run
from support.common.imagefiles import video

from lava_vpr import model as model_file
from lava_vpr.cli import main
from lava_vpr.deploy.bundle.targets import open_bundle

POSITIONS = ("--positions", "reference_positions.csv")
QUERIES = ("--query-positions", "query_positions.csv")
TRACKS = ("--query-positions", "query.gpx", "--stamps", "query_positions.csv")
AGAINST = ["repeats", "cause"]
PLAIN = ["query", "query_name", "place", "place_name", "confidence", "accepted", "probability"]


def trained(*words: object) -> model_file.Model:
    run("train", *words, "-o", "p.lvpr", "--config", "quick.toml")
    return model_file.load("p.lvpr")


def said(name: str) -> np.ndarray:
    """x and y of a table of positions."""
    rows = list(csv.DictReader(Path(name).read_text().splitlines()))
    return np.array([[float(row["x"]), float(row["y"])] for row in rows])


def error(*words: object) -> str:
    """What a command that must fail says."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code in (1, 2), result.output
    return result.stderr


def table(*words: object) -> tuple[list[str], list[dict[str, str]]]:
    run("query", "p.lvpr", *words, "-o", "q.csv")
    with Path("q.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        return list(reader.fieldnames or ()), list(reader)


def test_positions_are_kept_and_the_table_tells_the_error(here: Path) -> None:
    model = trained("reference", *POSITIONS)
    assert model.frame == "xy"
    np.testing.assert_array_equal(model.positions, said("reference_positions.csv"))
    assert matches("query", "-o", "q.csv")[0].keys() == set(PLAIN)  # a model without positions: nothing more
    header, rows = table("query")
    assert header == [*PLAIN, "x", "y"]
    header, rows = table("query", *QUERIES)
    assert header == [*PLAIN, "x", "y", "time", "error_m", *AGAINST]
    ours, theirs = said("reference_positions.csv"), said("query_positions.csv")
    for k, row in enumerate(rows):
        place = int(row["place"])
        np.testing.assert_allclose([float(row["x"]), float(row["y"])], ours[place], atol=0.0051)
        assert abs(float(row["error_m"]) - np.hypot(*(theirs[k] - ours[place]))) < 0.0051
        assert float(row["time"]) == 1736942400 + 2 * k


def test_a_track_beside_images_of_other_times(here: Path) -> None:
    """A receiver's fixes once a second, images every two: the same places as by the table, to the receiver's error."""
    model = trained("reference", "--positions", "reference.gpx", "--stamps", "reference_positions.csv")
    where = model.whereabouts
    assert where is not None
    assert where.frame == "latlon"
    away = np.hypot(*(where.to("UTM 32N").values - [610_000, 6_640_000] - said("reference_positions.csv")).T)
    assert away.max() < 4.3  # 1.5 m twice, on each axis
    header, rows = table("query", *TRACKS)
    assert header == [*PLAIN, "lat", "lon", "time", "error_m", *AGAINST]
    right = [float(row["error_m"]) for row in rows if row["place"] == row["query"]]
    assert len(right) >= 6
    assert max(right) < 6


@pytest.mark.parametrize("frame", ["x,y", "lat,lon"])
@pytest.mark.parametrize("motion", ["none", "any"])
def test_a_stuck_camera_is_named(motion: str, frame: str, here: Path) -> None:
    """In a table, in lines of JSON, and once on stderr; the others' lines are as ever."""
    degrees, count, path = frame == "lat,lon", 26, images("query")[3]
    listed("stuck.txt", [images("query")[2], *[path] * 24, images("query")[2]])
    metres = np.arange(count) * 4.0 / (111_195 if degrees else 1)
    Path("moving.csv").write_text(f"{frame}\n" + "".join(f"{value},5\n" for value in metres))
    Path("places.csv").write_text(f"{frame}\n" + "".join(f"{value},5\n" for value in metres[:8]))
    trained("reference", "--positions", "places.csv")
    words = ("stuck.txt", "--query-positions", "moving.csv", "--motion", motion, "--target-precision", 0.3)
    _, rows = table(*words)
    assert [row["repeats"] for row in rows] == ["0", *map(str, range(24)), "0"]
    assert [row["cause"] for row in rows] == [""] * 20 + ["stuck camera"] * 5 + [""]
    assert [row["accepted"] for row in rows[3:25]] == ["true"] + ["false"] * 21
    told = run("query", "p.lvpr", *words, "--format", "jsonl")
    lines = [json.loads(line) for line in told.stdout.splitlines()]
    assert [(line["repeats"], line["cause"]) for line in lines[19:21]] == [(18, None), (19, "stuck camera")]
    assert told.stderr.count("stuck camera") == 1
    assert "warning: image 20: the last 20 images show the same, though the robot moves" in told.stderr


def test_times_that_cannot_be_are_told(here: Path) -> None:
    """In a column that is there only then, and once each on stderr; `watch` tells the same."""
    trained("reference")
    for seconds, faults in ((range(8), {}), ((0, 1, 3, 2, 4, 5, 6, 99), {3: "backwards", 7: "gap"})):
        names = [Path(f"{1_700_000_000 + second}.png") for second in seconds]
        for name, path in zip(names, images("query"), strict=True):
            shutil.copy(path, name)
        header, rows = table(listed("times.txt", names))
        assert ("time_fault" in header) == bool(faults)
        assert {k: row["time_fault"] for k, row in enumerate(rows) if row.get("time_fault")} == faults
        asked = run("query", "p.lvpr", "times.txt"), run("watch", "p.lvpr", "times.txt")
        assert [one.stderr.count("warning: image 3 was taken before one that came before it") for one in asked] == [
            int(bool(faults))
        ] * 2
        lines = [json.loads(line) for line in asked[1].stdout.splitlines()]
        assert {k: line["time_fault"] for k, line in enumerate(lines) if "time_fault" in line} == faults


def test_eval_by_positions_is_eval_by_order(here: Path) -> None:
    trained("reference", *POSITIONS)
    run("eval", "p.lvpr", "query", *QUERIES, "--radius", 8, "--json", "p.json", "--report", "r")
    run("eval", "m.lvpr", "query", "--json", "m.json")
    run("eval", "p.lvpr", "query", *QUERIES, "--radius", 8, "--places", "5:8", "--json", "few.json")
    by_positions, by_order = (json.loads(Path(name).read_text()) for name in ("p.json", "m.json"))
    assert (by_positions.pop("model"), by_order.pop("model")) == ("p.lvpr", "m.lvpr")
    figures = by_positions.pop("position_error")
    assert by_order.pop("position_error") is None
    assert by_positions == by_order
    assert list(figures) == ["median_m", "p90_m", "within", "radius_m", "matched"]
    assert (figures["matched"], figures["radius_m"]) == (8, 8)
    assert figures["within"] == by_order["decoders"]["contrast"]["recall_at_1"]
    _, rows = table("query", *QUERIES)
    metres = [float(row["error_m"]) for row in rows]
    assert figures["median_m"] == pytest.approx(np.median(metres), abs=0.01)
    assert figures["p90_m"] == pytest.approx(np.quantile(metres, 0.9), abs=0.01)
    page = Path("r/report.html").read_text()
    assert '<section id="map">' in page
    assert "within 8 m." in page
    few = json.loads(Path("few.json").read_text())
    assert (few["queries"], few["position_error"]["matched"]) == (3, 3)


def test_positions_of_both_files_tell_metres_too(here: Path) -> None:
    words = ("eval", "m.lvpr", "query", "--positions", "reference_positions.csv", "query_positions.csv", "--radius", 8)
    out = run(*words, "--sequence", 3).stdout
    assert "metres of error: median " in out
    assert "of 6 within 8 m" in out
    gt = run("eval", "m.lvpr", "query").stdout
    assert "metres of error" not in gt


def test_names_of_the_field_need_no_option(here: Path) -> None:
    for folder in ("reference", "query"):
        Path("at", folder).mkdir(parents=True)
        for image, (x, y) in zip(images(folder), np.array([5e5, 4e6]) + said(f"{folder}_positions.csv"), strict=True):
            shutil.copy(image, Path("at", folder, f"@{x:010.2f}@{y:010.2f}@32@U@@@@@@@@@@@.png"))
    model = trained("at/reference")
    assert model.frame == "UTM 32N"
    values = {}
    for name, words in (("names", ()), ("order", ("--tolerance", 1)), ("gt", ("--gt", "gt.txt"))):
        Path("gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(8)))
        run("eval", "p.lvpr", "at/query", *words, "--json", "e.json")
        values[name] = json.loads(Path("e.json").read_text())
    assert values["names"]["position_error"]["radius_m"] == 25
    assert values["names"]["position_error"] == values["gt"]["position_error"]
    assert values["order"]["decoders"]["contrast"]["recall_at_1"] >= 0.75
    header, _ = table("at/query")
    assert header == [*PLAIN, "x", "y", "error_m", *AGAINST]


def test_places_by_distance(here: Path) -> None:
    model = trained("reference", "query", *POSITIONS, "--spacing", 35)
    assert model.place_indices.tolist() == [0, 2, 4, 6]
    assert (model.route_images, len(model.labels)) == (8, 8)
    np.testing.assert_array_equal(model.positions, said("reference_positions.csv")[::2])
    run("eval", "p.lvpr", "query", "--json", "e.json")  # in order: the queries with the places' numbers
    values = json.loads(Path("e.json").read_text())
    assert (values["queries"], values["places"]) == (4, 4)
    assert values["decoders"]["contrast"]["recall_at_1"] >= 0.75
    run("eval", "p.lvpr", "query", *QUERIES, "--json", "e.json")
    assert json.loads(Path("e.json").read_text())["queries"] == 7  # from the first place to the last
    assert [row["place"] in "0246" for row in table("query")[1]] == [True] * 8


def test_places_by_change(here: Path) -> None:
    (here / "slow").mkdir()
    paths = [path for k, path in enumerate(images("reference")) for _ in range(1 + 3 * (k == 2))]
    for k, path in enumerate(paths):
        shutil.copy(path, here / "slow" / f"{k:02d}.png")
    model = trained("slow", "--keyframes", 0.02)
    assert model.place_indices.tolist() == [0, 1, 2, 6, 7, 8, 9, 10]
    assert model.route_images == 11


def test_a_video_is_placed_by_the_times_of_its_frames(here: Path) -> None:
    video(Path("v.avi"), 20, marked=True)
    Path("t.csv").write_text("x,y,time\n" + "".join(f"{10 * k},0,{k}\n" for k in range(4)))
    Path("u.csv").write_text("x,y,time\n" + "".join(f"{10 * k},0,{1714564800 + k}\n" for k in range(5)))
    every = ("--every", 0.5)
    model = trained("v.avi", *every, "--positions", "t.csv")
    assert model.positions is not None
    np.testing.assert_allclose(model.positions[:, 0], np.arange(len(model.positions)) * 5.0, atol=0.5)
    later = trained("v.avi", *every, "--positions", "u.csv", "--stamps", "2024-05-01T12:00:00Z")
    assert later.positions is not None
    np.testing.assert_allclose(later.positions, model.positions, atol=1e-5)
    assert "seconds since their own start, and the track's are not" in error(
        "train", "v.avi", "-o", "n.lvpr", *every, "--positions", "u.csv"
    )
    header, rows = table("v.avi", *every)
    assert header == [*PLAIN, "x", "y", "time"]
    assert [float(row["time"]) for row in rows] == pytest.approx([0.5 * k for k in range(len(rows))], abs=0.05)


def test_a_bundle_keeps_positions(here: Path) -> None:
    model = trained("reference", *POSITIONS)
    run("deploy", "p.lvpr", "--target", "loihi2", "-o", "b")
    opened = open_bundle(Path("b"))
    assert opened.frame == "xy"
    np.testing.assert_array_equal(opened.positions, model.positions)


TRAIN = ("train", "reference", "-o", "n.lvpr")


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ((*TRAIN, "--spacing", 5), "reference: --spacing needs positions of its images; give --positions FILE"),
        ((*TRAIN, *POSITIONS, "--spacing", 500), "with this --spacing all 8 images are one place; lower it"),
        ((*TRAIN, "--keyframes", 0.99), "with this --keyframes all 8 images are one place; lower it"),
        ((*TRAIN, "--keyframes", 0.5, "--spacing", 5), "--spacing and --keyframes both say"),
        ((*TRAIN, "--keyframes", 0), "0.0 is not in the range 0<x<=1"),
        ((*TRAIN, "--spacing", "nan"), "--spacing is not a number"),
        ((*TRAIN, "--positions", "none.csv"), "none.csv: cannot be read"),
        ((*TRAIN, *POSITIONS, *POSITIONS), "--positions is given 2 times for 1 references"),
        ((*TRAIN, "--stamps", "12.5"), "--stamps 12.5 is when a video begins; give a CSV file"),
        ((*TRAIN, "--stamps", "none.csv"), "none.csv: cannot be read"),
        ((*TRAIN, "--positions", "reference.gpx"), "reference.gpx: has 15 positions with times for 8 images, of which"),
        (
            (*TRAIN, "--positions", "reference.gpx", "--stamps", "query_positions.csv"),
            "reference.gpx: image 0 was taken at 1736942400 s, outside the track (1719835200..1719835214)",
        ),
        (
            (*TRAIN, "--positions", "reference.gpx", "--stamps", "half.csv", "--gap", 0.5, "--places", "0:7"),
            "was taken in a gap of 1.0 s between two positions",
        ),
        (("query", "m.lvpr", "query", "-o", "q.csv", *QUERIES), "--query-positions needs a model that knows where its"),
        (("eval", "m.lvpr", "query", *QUERIES), "--query-positions needs a model that knows where its places are"),
        (("eval", "p.lvpr", "query", *QUERIES, "--positions", "a", "b", "--radius", 1), "leave out --query-positions"),
        (("eval", "p.lvpr", "query", *QUERIES, "--tolerance", 1), "--tolerance counts places along the route"),
        (("eval", "p.lvpr", "query", "--gt", "a.txt", "--radius", 1), "give one of them"),
        (("eval", "p.lvpr", "query", "--query-positions", "few.csv"), "few.csv: has 2 positions, image 7 has none"),
        (
            ("eval", "p.lvpr", "query", "--query-positions", "deg.csv"),
            "deg.csv: positions in x,y and in lat,lon cannot",
        ),
        (("query", "p.lvpr", "query", "-o", "q.csv", "--query-positions", "deg.csv"), "lat,lon cannot be compared"),
        (("query", "p.lvpr", "query", "-o", "query.gpx", "--query-positions", "query.gpx"), "is also an input"),
    ],
)
def test_what_is_wrong_is_told(words: tuple[object, ...], part: str, here: Path) -> None:
    Path("few.csv").write_text("x,y\n1,2\n3,4\n")
    Path("half.csv").write_text("time\n" + "".join(f"{1719835200.5 + 2 * k}\n" for k in range(7)))
    Path("deg.csv").write_text("lat,lon\n" + "1,2\n" * 8)
    if "p.lvpr" in words:
        trained("reference", *POSITIONS)
    assert part in " ".join(error(*words).split())
    assert not Path("n.lvpr").exists()
    assert not Path("q.csv").exists()
