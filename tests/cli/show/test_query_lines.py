"""`lava-vpr query`: the lines that others script against, and which answers are accepted."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common.commands import fails, figures, matches, recall, run

from lava_vpr.matching.probability import ASSUMED


def test_where_all_is_on_the_map_a_match_is_likelier(here: Path) -> None:
    ways = ((), ("--off-map", 0.5), ("--off-map", 0))
    half, told, all_ = (matches("query", "--motion", "none", *words) for words in ways)
    assert half == told
    sure = [[float(row["probability"]) for row in rows] for rows in (half, all_)]
    assert all(one < other for one, other in zip(*sure, strict=True))
    (row, *_) = figures("query", "--off-map", 0)["probability"]["single"]["thresholds"]
    assert ASSUMED in run("query", "m.lvpr", "query", "--off-map", 0).stderr
    assert ASSUMED not in run("query", "m.lvpr", "query", "--off-map", 0, "--min-confidence", 1).stderr
    assert row["accepted"] >= figures("query")["probability"]["single"]["thresholds"][0]["accepted"]
    assert "probabilities assume 0 % (--off-map)" in " ".join(
        run("eval", "m.lvpr", "query", "--off-map", 0).stdout.split()
    )


def test_the_csv_has_these_columns(here: Path) -> None:
    text = run("query", "m.lvpr", "query", "-o", "q.csv").stdout
    lines = Path("q.csv").read_text().splitlines()
    assert lines[0] == "query,query_name,place,place_name,confidence,accepted,probability"
    assert len(lines) == 9
    for k, line in enumerate(lines[1:]):
        shape = rf"{k},place_{k:05d}\.png,(\d),place_0000\1\.png,\d[\d.e+-]*,(true|false),(0\.\d{{6}})"
        assert re.fullmatch(shape, line), line
    rows = matches("query")
    assert text == f"8 images, {sum(row['accepted'] == 'true' for row in rows)} accepted: q.csv\n"
    assert (
        run("query", "m.lvpr", "query", "-o", "q.csv", "--min-confidence", 0).stdout == "8 images, 8 accepted: q.csv\n"
    )
    assert sum(row["query"] == row["place"] for row in rows) == round(8 * recall(figures("query")))


def test_one_image_and_names_that_need_quotes(here: Path) -> None:
    whole = matches("query")
    shutil.copy("query/place_00000.png", '0, "the" first.png')
    (row,) = matches('0, "the" first.png')
    assert row == {**whole[0], "query_name": '0, "the" first.png'}


def test_query_sequences_look_back(here: Path) -> None:
    rows = matches("query", "--sequence", 3)
    for row in rows[:2]:
        assert [row[key] for key in ("place", "place_name", "confidence", "accepted")] == ["-1", "", "", "false"]
    # Windows name their last pair, and the right one is found for all.
    assert [row["place"] for row in rows[2:]] == [str(k) for k in range(2, 8)]
    assert {(row["accepted"], row["probability"]) for row in rows} == {("false", "")}
    sure = matches("query", "--sequence", 3, "--min-confidence", 0)
    assert [row["accepted"] for row in sure] == ["false"] * 2 + ["true"] * 6


UNKNOWN = (
    ("query m.lvpr query --sequence 3", "sequences have no probabilities; give --motion any in place of --sequence 3"),
    ("query m.lvpr query --query-views 3", "several views of a query, and preset paper, have no probabilities"),
    (
        "watch m.lvpr query --query-views 3 --motion none --stop-after 8",
        "several views of a query, and preset paper, have no",
    ),
)


@pytest.mark.parametrize(("words", "text"), UNKNOWN)
def test_without_probabilities_nothing_is_accepted_and_no_precision_aimed_at(words: str, text: str, here: Path) -> None:
    said = run(*words.split())
    assert f"note: no match is accepted: {text}" in said.stderr
    assert "true" not in said.stdout
    refused = fails(*words.split(), "--target-precision", "0.9")
    assert refused.startswith(f"a target precision of 0.9 needs probabilities, but {text}")


def test_min_confidence_accepts_the_surest(here: Path) -> None:
    every = matches("query")
    known = sorted({float(row["confidence"]) for row in every})
    limit = (known[0] + known[-1]) / 2
    some = matches("query", "--min-confidence", limit)
    assert [{**row, "accepted": ""} for row in some] == [{**row, "accepted": ""} for row in every]
    assert [row["accepted"] for row in some] == [str(float(row["confidence"]) >= limit).lower() for row in every]
    assert 0 < sum(row["accepted"] == "true" for row in some) < 8
    none = run("query", "m.lvpr", "query", "-o", "q.csv", "--min-confidence", "inf").stdout
    assert none == "8 images, 0 accepted: q.csv\n"


def test_a_confidence_copied_from_the_csv_accepts_its_own_row(here: Path) -> None:
    for row in matches("query"):
        again = matches("query", "--min-confidence", row["confidence"])[int(row["query"])]
        assert again["accepted"] == "true", row


def test_a_blank_image_matches_no_place(here: Path) -> None:
    Path("mixed").mkdir()
    cv2.imwrite("mixed/0.png", np.full((48, 64, 3), 90, np.uint8))
    shutil.copy("query/place_00001.png", "mixed/1.png")
    blank, other = matches("mixed")
    assert [blank[key] for key in ("place", "place_name", "confidence", "accepted")] == ["-1", "", "", "false"]
    assert int(other["place"]) >= 0
    Path("blank").mkdir()
    shutil.copy("mixed/0.png", "blank/0.png")
    Path("gt.txt").write_text("0: 0\n")
    values = figures("blank", "--gt", "gt.txt")
    assert recall(values) == 0
    assert values["decoders"]["contrast"]["recall_at_n"] == {"5": 0.0, "10": 0.0}
