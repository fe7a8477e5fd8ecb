"""`lava-vpr query --report`: a page of pairs beside the rows; what stood there stays if it fails."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.common.commands import content, fails, images, listed, run

from lava_vpr.matching.probability import ASSUMED, UNREACHED

PAGE = Path("r/query.html")


def payload() -> dict[str, Any]:
    """What the page's script is given."""
    found = re.search(r'id="report-data">(.*?)</script>', PAGE.read_text(encoding="utf-8"))
    assert found is not None
    return dict(json.loads(found[1]))


def test_the_page_says_what_the_rows_say(here: Path) -> None:
    rows = run("query", "m.lvpr", "query", "--motion", "any", "-o", "-").stdout
    told = run("query", "m.lvpr", "query", "--motion", "any", "-o", "q.csv", "--report", "r")
    assert Path("q.csv").read_text() == rows
    assert told.stdout.splitlines()[-1] == f"report: {PAGE}"
    found, shown = list(csv.DictReader(rows.splitlines())), payload()
    assert shown["queries"] == [f"{row['query']} · {row['query_name']}" for row in found]
    assert [shown["places"][k] for k in shown["match"]] == [f"{row['place']} · {row['place_name']}" for row in found]
    assert shown["accepted"] == [row["accepted"] == "true" for row in found]
    assert shown["shown"] == [f"{100 * float(row['probability']):.1f} %" for row in found]
    text = PAGE.read_text(encoding="utf-8")
    assert "lava-vpr query m.lvpr query --motion any</code>" in text
    assert ASSUMED in text
    assert 'id="drive"' in text


def test_unordered_photos_come_without_a_drive(here: Path) -> None:
    photos = listed("photos.txt", [images("query")[k] for k in (5, 0, 3)])
    told = run("query", "m.lvpr", photos, "--report", "r")
    assert re.fullmatch(r"3 images, \d accepted\nreport: r/query.html\n", told.stdout)
    assert 'id="drive"' not in PAGE.read_text(encoding="utf-8")
    assert run("query", "m.lvpr", images("query")[0], "--report", "r").stdout.startswith("1 image, ")
    again = run("query", "m.lvpr", photos, "-o", "-", "--report", "r")
    assert (again.stdout.startswith("query,query_name"), again.stderr) == (True, f"note: {UNREACHED}\n")


@pytest.mark.parametrize(
    ("words", "said"), [((), "stands at the place"), (("--query-positions", "p.csv"), "Metres of")]
)
def test_a_map_shows_the_images_where_they_were_taken_or_at_their_matches(
    words: tuple[str, ...], said: str, here: Path
) -> None:
    track = "x,y\n" + "".join(f"{3 * k},{k % 2}\n" for k in range(8))
    Path("p.csv").write_text(track)
    run("train", "reference", "-o", "n.lvpr", "--config", "quick.toml", "--positions", "p.csv")
    run("query", "n.lvpr", "query", "--report", "r")
    assert "stands at the place" in PAGE.read_text(encoding="utf-8")
    run("query", "n.lvpr", "query", "--report", "r", "--query-positions", "p.csv")
    assert "Metres of error: median" in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("words", [("--sequence", "3"), ("--query-views", "3")])
def test_where_probabilities_are_not_known_confidence_stands(words: tuple[str, ...], here: Path) -> None:
    run("query", "m.lvpr", "query", "--report", "r", *words)
    assert payload()["what"] == "confidence"
    assert ("each image alone" in PAGE.read_text(encoding="utf-8")) == ("--sequence" not in words)


def test_a_cause_stands_on_the_page(here: Path) -> None:
    cv2.imwrite("black.png", np.zeros((48, 64, 3), np.uint8))
    listed("black.txt", [Path("black.png")] * 24)
    run("query", "m.lvpr", "black.txt", "--motion", "any", "--report", "r")
    assert "<div><dt>camera</dt><dd>blank</dd></div>" in PAGE.read_text()


def test_other_files_of_the_folder_stay(here: Path) -> None:
    Path("r").mkdir()
    Path("r/report.html").write_text("of eval")
    PAGE.write_text("of yesterday")
    run("query", "m.lvpr", "query", "--report", "r")
    assert sorted(path.name for path in Path("r").iterdir()) == ["query.html", "report.html"]
    assert Path("r/report.html").read_text() == "of eval"
    assert "Accepted" in PAGE.read_text(encoding="utf-8")


def test_a_damaged_image_costs_no_page(here: Path) -> None:
    Path("r").mkdir()
    PAGE.write_text("of yesterday")
    Path("bad.png").write_bytes(b"no image")
    before = content(Path("r"))
    assert "bad.png" in fails(
        "query", "m.lvpr", listed("l.txt", [images("query")[0], Path("bad.png")]), "--report", "r"
    )
    assert content(Path("r")) == before
