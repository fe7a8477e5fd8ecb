"""`lava-vpr watch`: a line of JSON for each image as it comes, whatever the source; what is said and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.common import children
from support.common.bags import START, bag, frames
from support.common.commands import fails, images, matches, run
from support.common.imagefiles import video

from lava_vpr import Localizer
from lava_vpr.cli import main
from lava_vpr.images.imagefiles import read_image


def watched(*words: object, input: str | None = None) -> tuple[list[dict[str, Any]], Result]:
    """What ``watch m.lvpr words`` says of each image, and how it ended."""
    result = CliRunner().invoke(main, ["watch", "m.lvpr", *map(str, words)], input=input)
    return [json.loads(line) for line in result.stdout.splitlines()], result


def paths() -> str:
    """The images of the route as lines."""
    return "".join(f"{path}\n" for path in images("query"))


@pytest.mark.parametrize("words", [("--motion", "none"), (), ("--motion", "forward", "--query-views", "3")])
def test_the_answers_are_those_of_query(words: tuple[str, ...], here: Path) -> None:
    said, result = watched("-", *words, input=paths())
    assert result.exit_code == 0, result.output
    assert result.stderr == f"note: 8 images, {sum(one['accepted'] for one in said)} accepted, 0 left out\n"
    run("query", "m.lvpr", "query", "-o", "q.jsonl", "--top", 5, *(words or ("--motion", "any")))
    rows = [json.loads(line) for line in Path("q.jsonl").read_text().splitlines()]
    for one, row in zip(said, rows, strict=True):
        assert {key: one[key] for key in row} == row
        assert set(row) == set(one) - {"time", "radius", "off_map", "followed"}
        assert one["radius"] == (0 if "none" in words else 1)


def test_the_keys_of_a_line(here: Path) -> None:
    (one, *_), _ = watched("-", input=paths())
    assert list(one) == [
        *(
            "query",
            "query_name",
            "time",
            "place",
            "place_name",
            "confidence",
            "accepted",
            "probability",
            "radius",
            "off_map",
            "followed",
        ),
        "candidates",
    ]
    assert list(one["candidates"][0]) == ["place", "place_name", "score", "probability"]
    match = Localizer("m.lvpr").update(read_image(images("query")[0]))
    assert [found["place"] for found in one["candidates"]] == [found.place for found in match.candidates]


def test_positions_stand_beside_the_place(here: Path) -> None:
    run("train", "reference", "-o", "w.lvpr", "--config", "quick.toml", "--positions", "reference_positions.csv")
    cv2.imwrite("blank.png", np.full((48, 64, 3), 90, np.uint8))
    words = ["watch", "w.lvpr", "-", "--motion", "none"]
    result = CliRunner().invoke(main, words, input=f"{images('query')[3]}\nblank.png\n")
    there, blank = (json.loads(line) for line in result.stdout.splitlines())
    (row,) = CliRunner().invoke(main, ["query", "w.lvpr", str(images("query")[3]), "-o", "-"]).stdout.splitlines()[1:]
    assert f",{there['x']:.2f},{there['y']:.2f}" in row
    assert (blank["place"], blank["place_name"], blank["confidence"], blank["accepted"]) == (-1, None, None, False)
    assert (blank["x"], blank["y"], blank["candidates"]) == (None, None, [])


def test_images_that_cannot_be_read_are_left_out(here: Path) -> None:
    Path("cut.png").write_bytes(images("query")[0].read_bytes()[:-40])
    said, result = watched("-", input=f"cut.png\n{images('query')[0]}\n{chr(0) * 600}\n{images('query')[1]}\n")
    assert result.exit_code == 0
    assert [one["query"] for one in said] == [1, 3]
    lines = result.stderr.splitlines()
    assert lines[0].startswith("warning: image 0 is left out (1 so far): cut.png: is damaged or cut short")
    assert lines[1].startswith("warning: image 2 is left out (2 so far): '\\x00\\x00")
    assert "00': cannot be read (" in lines[1]
    assert len(lines[1]) < 500
    assert lines[2].startswith("note: 2 images, ")
    assert lines[2].endswith(" 2 left out")


def test_a_video(here: Path) -> None:
    path = video(Path("v.avi"), 20, marked=True)
    said, _ = watched(path, "--every", 0.5)
    assert [(one["query_name"], one["time"]) for one in said] == [
        ("frame 000000", 0),
        ("frame 000005", 0.5),
        ("frame 000010", 1.0),
        ("frame 000015", 1.5),
    ]


def test_a_video_of_the_route(here: Path) -> None:
    """Written at an image a second; the codec's losses are the same for both commands."""
    writer = cv2.VideoWriter("drive.avi", cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 1.0, (128, 64))
    for path in images("query"):
        writer.write(cv2.resize(read_image(path), (128, 64)))
    writer.release()
    said, _ = watched("drive.avi")
    assert [one["time"] for one in said] == list(range(8))
    rows = matches("drive.avi", "--motion", "any")
    assert [str(one["place"]) for one in said] == [row["place"] for row in rows]
    assert sum(one["place"] == one["query"] for one in said) >= 6


def test_it_stops_after_so_many(here: Path) -> None:
    said, result = watched("query", "--stop-after", 3)
    assert [one["query_name"] for one in said] == [path.name for path in images("query")[:3]]
    assert abs(said[0]["time"] - images("query")[0].stat().st_mtime) < 1e-5
    assert result.stderr.startswith("note: 3 images, ")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("none",), "none: cannot be opened (No such file or directory); check the path"),
        (("camera:993",), "camera:993: there is no camera /dev/video993; plug it in"),
        (("query", "--every", "0"), "--every is 0.0, but must be a number of seconds"),
        (("query", "--query-views", "2"), "views"),
    ],
)
def test_what_cannot_be_watched_is_one_line(words: tuple[str, ...], line: str, here: Path) -> None:
    said, result = watched(*words)
    assert result.exit_code == 1
    assert not said
    (told,) = result.stderr.splitlines()
    assert told.startswith("lava-vpr: error: ")
    assert line in told


def started(*words: object, **options: Any) -> children.Child:
    """The real program."""
    command = [sys.executable, "-m", "lava_vpr", "watch", "m.lvpr", *map(str, words)]
    pipe = subprocess.PIPE
    return children.Child(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, **options)


def next_line(child: children.Child) -> str:
    """The next line on stderr but for that of kernels, which depends on earlier tests; empty at the end."""
    line: str = child.stderr.readline()
    return next_line(child) if line == children.COMPILING else line


@pytest.mark.quick(1)
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 1), (signal.SIGTERM, -signal.SIGTERM)])
def test_a_folder_that_is_written_until_somebody_stops_it(number: int, code: int, here: Path) -> None:
    """Each image is answered before the next is written, as whoever reads the lines sees them."""
    folder = Path("frames")
    folder.mkdir()
    with started(folder) as child:
        assert child.stdout is not None
        for path in images("query")[:3]:
            (folder / "part").write_bytes(path.read_bytes())
            os.replace(folder / "part", folder / path.name)
            assert json.loads(child.stdout.readline())["query_name"] == path.name
        child.send_signal(number)
        _, said = child.communicate(timeout=30)
    assert child.returncode == code
    assert said == "\nAborted!\n"  # as every command says it


def ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def test_a_background_job_ignores_ctrl_c_and_ends_when_it_is_told_to(here: Path) -> None:
    """A shell has the background jobs of a script ignore SIGINT, and that stays so, as in all programs."""
    with started("-", preexec_fn=ignore_interrupts) as child:
        for number in (0, signal.SIGINT):
            child.send_signal(number)
            child.stdin.write(f"{images('query')[0]}\n")
            child.stdin.flush()
            assert json.loads(child.stdout.readline())["query_name"] == images("query")[0].name
        child.send_signal(signal.SIGTERM)
        _, said = child.communicate(timeout=30)
    assert child.returncode == -signal.SIGTERM
    assert said == "\nAborted!\n"


def test_a_reader_who_goes_away_ends_it_quietly(here: Path) -> None:
    with started("-") as child:
        assert child.stdout is not None
        assert child.stdin is not None
        child.stdin.write(f"{images('query')[0]}\n")
        child.stdin.flush()
        assert child.stdout.readline()
        child.stdout.close()
        child.stdin.write(paths())
        child.stdin.close()
        assert child.wait(30) == 0
        assert child.stderr is not None
        assert next_line(child) == ""


def test_a_page_shows_what_is_watched_until_somebody_stops_it(here: Path) -> None:
    with started("-", "--page", "0") as child:
        assert child.stdin is not None
        assert child.stderr is not None
        address = re.fullmatch(r"note: the page is at (http://127\.0\.0\.1:\d+/)\n", next_line(child))
        assert address is not None
        child.stdin.write("none.png\n" + paths())
        child.stdin.close()
        assert child.stdout is not None
        lines = [child.stdout.readline() for _ in range(8)]
        assert next_line(child).startswith("warning: image 0 is left out")
        assert next_line(child).startswith("note: 8 images, ")
        assert next_line(child) == "note: the source has ended; the page stays until Ctrl-C\n"
        with urlopen(f"{address[1]}state", timeout=10) as answer:
            state = json.load(answer)
        assert (state["answered"], state["refused"], state["status"]) == (8, 1, "the source has ended")
        assert state["query_name"] == json.loads(lines[-1])["query_name"]
        child.send_signal(signal.SIGINT)
        assert child.wait(30) == 1


def test_so_many_answers_end_it_with_a_page_too(here: Path) -> None:
    said, result = watched("query", "--stop-after", 2, "--page", 0)
    assert result.exit_code == 0
    assert len(said) == 2
    assert result.stderr.startswith("note: the page is at http://127.0.0.1:")


def test_a_bag_is_watched_and_queried_as_its_images_are(here: Path) -> None:
    path = bag(Path("drive"), frames(map(read_image, images("query"))))
    said, result = watched(path)
    assert result.exit_code == 0, result.output
    plain, _ = watched("-", input=paths())
    for one, other in zip(said, plain, strict=True):
        assert one == other | {"query_name": f"frame {one['query']:06d}", "time": START + one["query"]}
    rows = matches(path)
    assert [row["time"] for row in rows] == [str(START + k) for k in range(8)]
    for row, other in zip(rows, matches("query"), strict=True):
        assert {key: row[key] for key in other if key != "query_name"} == {
            key: value for key, value in other.items() if key != "query_name"
        }


def test_a_model_is_trained_from_a_bag(here: Path) -> None:
    bag(Path("summer"), frames(map(read_image, images("reference")), topic="/left"), "db3")
    for source, model in (("summer:/left", "bag.lvpr"), ("reference", "folder.lvpr")):
        run("train", source, "-o", model, "--config", "quick.toml")
    answers = [run("query", model, "query", "--format", "jsonl").stdout for model in ("bag.lvpr", "folder.lvpr")]
    places = [[json.loads(line) | {"place_name": ""} for line in text.splitlines()] for text in answers]
    assert places[0] == places[1]


def test_no_output_replaces_a_file_of_a_bag(here: Path) -> None:
    bag(Path("drive"), frames(map(read_image, images("query"))))
    said = fails("query", "m.lvpr", "drive", "-o", "drive/metadata.yaml")
    assert "drive/metadata.yaml: is also an input" in said


def test_a_bag_of_several_topics_asks_for_one(here: Path) -> None:
    pictures = [read_image(path) for path in images("query")[:2]]
    bag(Path("two"), [*frames(pictures[:1], topic="/left"), *frames(pictures[1:], topic="/right")])
    said, result = watched("two")
    assert (said, result.exit_code) == ([], 1)
    assert "two: has images of /left, /right; name one" in result.stderr
    assert [one["place"] for one in watched("two", "--topic", "/right", "--motion", "none")[0]] == [1]
