"""Answers as VPR-methods-evaluation's predictions, read back line by line."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common.commands import content, fails, images, run

ASK = ("query", "m.lvpr", "query", "-o", "q.csv")


def read(folder: str) -> dict[str, tuple[str, list[str]]]:
    """The path of the query and those of the predictions, by the file's name."""
    found = {}
    for path in sorted(Path(folder).iterdir()):
        head, query, blank, words, *places = path.read_text().removesuffix("\n").split("\n")
        assert (head, blank, words) == ("Query path:", "", "Predictions paths:")
        found[path.name] = (query, places)
    return found


@pytest.mark.parametrize("references", [None, "some/where"])
def test_each_query_has_a_file_with_its_best_places(here: Path, references: str | None) -> None:
    where = () if references is None else ("--references", references)
    run(*ASK, "--top", 3, "--predictions", "preds", *where)
    rows = list(csv.DictReader(Path("q.csv").read_text().splitlines()))
    found = read("preds")
    assert list(found) == [f"{number:03d}.txt" for number in range(8)]
    for row, path, (query, places) in zip(rows, images("query"), found.values(), strict=True):
        assert Path(query).samefile(path)
        assert len(places) == 3
        assert places[0] == (row["place_name"] if references is None else f"{references}/{row['place_name']}")


def test_a_place_each_and_none_of_a_blank_image(here: Path) -> None:
    cv2.imwrite("blank.png", np.full((48, 64, 3), 90, np.uint8))
    run("query", "m.lvpr", "blank.png", "--predictions", "preds")
    assert read("preds") == {"000.txt": ("blank.png", [])}
    run(*ASK, "--predictions", "all")
    assert [len(places) for _, places in read("all").values()] == [1] * 8


@pytest.mark.parametrize(
    ("words", "message", "code"),
    [
        (("--predictions", "query"), "query: the input query would be replaced with it; name another folder", 1),
        (("--predictions", "there"), "there: exists, and a folder of predictions replaces nothing; remove it or", 1),
        (("--predictions", "none/out"), "none/out: cannot be written (No such file or directory); free space", 1),
        (("--predictions", "m.lvpr/out"), "m.lvpr/out: cannot be written (Not a directory)", 1),
        (("--references", "reference"), "--references names the folder in the paths of --predictions; give that", 2),
    ],
)
def test_what_cannot_be_predictions_is_one_line(here: Path, words: tuple[str, ...], message: str, code: int) -> None:
    Path("there").mkdir()
    before = content(Path())
    assert message in fails(*ASK, *words, code=code)
    assert content(Path()) == before
