"""What `lava-vpr query` prints: CSV and JSON lines on standard output, candidates, and one image as a sentence; and the
page of pairs that `--report` writes beside the rows."""

from __future__ import annotations

import csv
import io
import json
import re
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from support.common.commands import content, fails, images, listed, run

from lava_vpr import model as model_file, traverse
from lava_vpr.backends import answering
from lava_vpr.cli import main
from lava_vpr.cli.show import streams
from lava_vpr.encoding import encode_traverse
from lava_vpr.matching.probability import ASSUMED, UNREACHED
from lava_vpr.matching.sequences import normalise_scores
from lava_vpr.model import decode
from lava_vpr.recognition import count_query_spikes
from lava_vpr.traverse import open_traverse

FILTERED = ("--motion", "any")


def printed(*words: object) -> str:
    """What ``query m.lvpr words`` prints."""
    return run("query", "m.lvpr", *words).stdout


def csv_of(text: str) -> list[dict[str, str]]:
    """The rows of a CSV text."""
    return list(csv.DictReader(io.StringIO(text, newline="")))


def scores_of(source: str) -> np.ndarray:
    """The default decoder's scores of all images of ``source``, worked out at once."""
    model = model_file.load("m.lvpr")
    counts, _ = count_query_spikes(model, encode_traverse(open_traverse(source), model.config.encoder))
    return decode(model, counts, model.config.decoder.default)


@pytest.mark.parametrize("words", [(), FILTERED, ("--sequence", 3), ("--top", 3), ("--top", 3, *FILTERED)])
def test_standard_output_gets_what_a_file_gets(words: tuple[object, ...], here: Path) -> None:
    said = run("query", "m.lvpr", "query", "-o", "q.csv", *words).stdout
    assert said.startswith("8 images, ")
    text = Path("q.csv").read_text()
    assert printed("query", *words) == printed("query", "-o", "-", *words) == text
    assert printed("query", "--format", "csv", *words) == text
    assert not Path("-").exists()


@pytest.mark.parametrize("words", [(), FILTERED, ("--sequence", 3), ("--query-views", 3)])
def test_json_lines_say_what_the_table_says(words: tuple[object, ...], here: Path) -> None:
    cv2.imwrite("blank.png", np.full((48, 64, 3), 90, np.uint8))
    Path("some.txt").write_text("".join(f"{path}\n" for path in [*images("query"), "blank.png"]))
    rows = csv_of(printed("some.txt", *words))
    lines = [json.loads(line) for line in printed("some.txt", "--format", "jsonl", *words).splitlines()]
    assert len(lines) == 9
    for row, values in zip(rows, lines, strict=True):
        assert list(values)[: len(row)] == list(row)
        assert set(values) - set(row) == ({"unlike"} if row["query_name"] == "blank.png" else set())
        for name, value in list(values.items())[: len(row)]:
            kind = {"query_name": str, "place_name": str, "accepted": bool, "query": int, "place": int}.get(name, float)
            assert value is None if row[name] == "" else type(value) is kind
            plain = str(value).lower() if kind is bool else value
            assert (
                value is None or kind(plain) == (row[name] if kind is bool else kind(row[name])) or plain == row[name]
            )
    run("query", "m.lvpr", "some.txt", "-o", "q.jsonl", *words)
    assert [json.loads(line) for line in Path("q.jsonl").read_text().splitlines()] == lines


def test_candidates_are_the_places_by_their_scores(here: Path) -> None:
    scores, model = scores_of("query"), model_file.load("m.lvpr")
    rows = csv_of(printed("query", "--top", 3))
    lines = [json.loads(line) for line in printed("query", "--top", 3, "--format", "jsonl").splitlines()]
    assert list(rows[0])[7:] == ["score", "place_2", "place_name_2", "score_2", "place_3", "place_name_3", "score_3"]
    for row, line, of_places in zip(rows, lines, scores, strict=True):
        order = sorted(range(model.places), key=lambda place, of=of_places: (-of[place], place))[:3]
        assert [int(row[name]) for name in ("place", "place_2", "place_3")] == order
        assert [float(row[name]) for name in ("score", "score_2", "score_3")] == [of_places[k] for k in order]
        assert [found["place"] for found in line["candidates"]] == order
        assert [found["place_name"] for found in line["candidates"]] == [model.place_names[k] for k in order]
        chances = [found["probability"] for found in line["candidates"]]
        assert chances == [line["probability"], None, None]


@pytest.mark.parametrize("words", [(), FILTERED, ("--sequence", 3)])
def test_all_scores_come_as_a_matrix(words: tuple[object, ...], here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answering, "BATCH", 3)
    alone = wanted = scores_of("query")
    words = (*words, "--adapt", "off")
    if "--sequence" in words:  # normalised, of the last image and place of each; before are none
        wanted, alone = np.full((8, 8), np.nan), normalise_scores(alone)
        wanted[2:, 2:] = alone[:6, :6] + alone[1:7, 1:7] + alone[2:, 2:]
    assert printed("query", "--scores", "s.npy", *words) == printed("query", *words)
    found = np.load("s.npy")
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    Path("some.txt").write_text(f"{images('query')[0]}\nnone.png\n")
    fails("query", "m.lvpr", "some.txt", "-o", "q.csv", "--scores", "s.npy")
    assert np.array_equal(np.load("s.npy"), found, equal_nan=True)


def test_candidates_of_the_filter_have_probabilities(here: Path) -> None:
    rows = csv_of(printed("query", "--top", 99, *FILTERED))
    assert "probability_99" in rows[0]
    for row in rows:
        places = [int(row[name]) for name in row if name.startswith("place_") and row[name] and "name" not in name]
        assert sorted([int(row["place"]), *places]) == list(range(8))  # the map has no more
        chances = [float(row[name]) for name in row if name.startswith("probability_") and row[name]]
        assert chances == sorted(chances, reverse=True)
        near = dict(zip(places, chances, strict=True))
        best, beside = int(row["place"]), float(row["probability"])
        assert all(near[k] <= beside + 1e-6 for k in (best - 1, best + 1) if k in near)
        assert sum(near.values()) < 1


def test_candidates_of_a_sequence_are_those_of_its_end(here: Path) -> None:
    rows = csv_of(printed("query", "--top", 8, "--sequence", 3))
    assert [(row["place"], row["place_2"], row["score"]) for row in rows[:2]] == [("-1", "", "")] * 2
    for row in rows[2:]:
        named = [row["place"], *(row[f"place_{k}"] for k in range(2, 9))]
        assert sorted(filter(None, named)) == list("234567")  # the last of three places each
        known = [float(row[name]) for name in row if name.startswith("score") and row[name]]
        assert known == sorted(known, reverse=True)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (
            (),
            (" may show place 3 (place_00003.png): not accepted, probability 47%, and no probability is high enough ",),
        ),
        (("--target-precision", 0.3), (" shows place 3 (place_00003.png): accepted, probability 47%.",)),
        (("--query-views", 3), (" may show place 3 (place_00003.png): not accepted, confidence ",)),
        (("--query-views", 3, "--min-confidence", 0), (" shows place 3 (place_00003.png): accepted, confidence ",)),
        (
            ("--min-confidence", "99"),
            (" may show place 3 (place_00003.png): not accepted, probability 47%, confidence ",),
        ),
        (("--min-confidence", "0"), (" shows place 3 (place_00003.png): accepted, ",)),
        (("--top", 2), ("not accepted", "\n2. place ", "score ")),
        (("--top", 2, *FILTERED), ("not accepted", "below the threshold of 95%", "\n2. place ", ", probability ")),
    ],
)
def test_one_image_is_told_in_a_sentence(words: tuple[object, ...], parts: tuple[str, ...], here: Path) -> None:
    text = printed(images("query")[3], *words)
    assert text.startswith("place_00003.png ")
    assert text.endswith("\n")
    assert all(part in text for part in parts), text
    assert len(text.splitlines()) == (2 if "--top" in words else 1)


def test_a_sentence_of_an_image_that_shows_nothing(here: Path) -> None:
    cv2.imwrite("blank.png", np.full((48, 64, 3), 90, np.uint8))
    assert printed("blank.png", "--top", 3) == "blank.png matches no place of the map.\n"


def test_a_sentence_of_an_image_unlike_the_map(here: Path) -> None:
    image = cv2.imread(images("query")[3])
    image[:12] = 0
    cv2.imwrite("border.png", image)
    said = printed("border.png", "--target-precision", 0.01)
    assert said.startswith("border.png may show place ")
    assert said.endswith("%, but it is unlike all that the map has seen.\n")


def test_a_sentence_says_where(here: Path) -> None:
    run("train", "reference", "-o", "w.lvpr", "--config", "quick.toml", "--positions", "reference_positions.csv")
    said = run("query", "w.lvpr", images("query")[3], "--target-precision", 0.3).stdout
    (row,) = csv_of(run("query", "w.lvpr", images("query")[3], "-o", "-").stdout)
    names = [name for name in ("x", "y", "lat", "lon") if name in row]
    assert len(names) == 2
    assert f" (place_00003.png) at {', '.join(f'{name} {row[name]}' for name in names)}: accepted, " in said


@pytest.mark.parametrize("words", [("-o", "-"), ("--format", "csv"), ("-o", "q.csv")])
def test_one_image_as_a_table(words: tuple[str, ...], here: Path) -> None:
    said = printed(images("query")[3], *words)
    assert csv_of(Path("q.csv").read_text() if "q.csv" in words else said)[0]["place"] == "3"


def test_a_line_comes_before_the_next_image_is_read(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Then two, four and so on are taken together; a file gets them as it always did."""
    events: list[Any] = []
    read = traverse.read_image

    def noted(path: Path) -> Any:
        events.append("read")
        return read(path)

    def write(piece: str) -> None:
        events.append(piece.count("\n"))

    monkeypatch.setattr(traverse, "read_image", noted)
    monkeypatch.setattr(streams, "write_stdout", write)
    monkeypatch.setattr(streams, "text_writer", lambda path: nullcontext(write))
    run("query", "m.lvpr", "query", "-o", "-")
    assert events == [1, "read", 1, "read", "read", 2, *["read"] * 4, 4, "read", 1]
    events.clear()
    run("query", "m.lvpr", "query", "-o", "q.csv")
    assert events == [1, *["read"] * 8, 8]


def test_what_was_printed_stands_when_an_image_is_damaged(here: Path) -> None:
    Path("damaged.png").write_bytes(images("query")[0].read_bytes()[:-40])
    Path("some.txt").write_text(f"{images('query')[0]}\ndamaged.png\n")
    ended = CliRunner().invoke(main, ["query", "m.lvpr", "some.txt"])
    assert ended.exit_code == 1
    assert len(csv_of(ended.stdout)) == 1
    assert ended.stderr.startswith("lava-vpr: error: damaged.png: ")


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
