"""The command line at work: what each command writes and prints. Wrong use is in test_cli_errors.py."""

from __future__ import annotations

import csv
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from imagefiles import video

from lava_vpr import __version__, model
from lava_vpr.cli import main
from lava_vpr.synthetic import write_traverses

CONFIG = "[network]\nsteps = 120\n[learning]\nsteps = 120\nepochs = 5\n"
ROOT = Path(__file__).resolve().parent.parent
FIGURES = {"recall_at_1", "recall_at_n", "recall_at_100_precision", "precision_at_100_recall", "auc"}
DECODERS = ["standard", "weighted", "probability", "weighted_probability", "contrast"]
PLACES = 8


def run(*words: object) -> Result:
    """A command that must succeed without a word on stderr."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return result


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic route and a model of it; never written to."""
    root = tmp_path_factory.mktemp("made") / "w"
    write_traverses(root, PLACES, 0)
    (root / "quick.toml").write_text(CONFIG)
    run("train", root / "reference", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    return root


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own to work in, which sees what was made."""
    for entry in made.iterdir():
        os.symlink(entry, tmp_path / entry.name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def figures(*words: object) -> dict[str, Any]:
    """What ``eval m.lvpr words --json`` writes."""
    run("eval", "m.lvpr", *words, "--json", "f.json")
    return dict(json.loads(Path("f.json").read_text()))


def recall(values: dict[str, Any], name: str = "contrast") -> float:
    return float({**values["decoders"], **values["baselines"]}[name]["recall_at_1"])


def matches(*words: object) -> list[dict[str, str]]:
    """What ``query m.lvpr words`` writes."""
    run("query", "m.lvpr", *words, "-o", "q.csv")
    with Path("q.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def images(folder: str) -> list[Path]:
    return sorted(Path(folder).iterdir())


def listed(name: str, paths: list[Path]) -> str:
    Path(name).write_text("".join(f"{path}\n" for path in paths))
    return name


# --- demo, synth, doctor, help ---------------------------------------------------------------------------------------


def test_demo_twice_into_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("lava_vpr.cli.demo")
    draw = module.write_traverses
    monkeypatch.setattr(module, "write_traverses", lambda out, places, seed, keep: draw(out, 12, seed, keep=keep))
    monkeypatch.chdir(tmp_path)
    results = []
    for _ in range(2):
        text = run("demo", "--out", "d").stdout
        results.append((text, Path("d/figures.json").read_bytes(), Path("d/model.lvpr").read_bytes()))
    assert results[0][1:] == results[1][1:]
    text = results[0][0]
    assert "12 queries, 12 places, 12 neurons" in text
    for name in ("contrast *", "standard", "weighted_probability", "sad", "cosine"):
        assert re.search(rf"│ {re.escape(name)} +│( +[\d.]+ │){{6}}\n", text), text
    assert text.splitlines()[-1] == "report to open in a browser: d/report/report.html"
    page = Path("d/report/report.html").read_text(encoding="utf-8")
    assert "lava-vpr demo" in page
    assert str(tmp_path) not in page
    assert {p.name for p in Path("d").iterdir()} == {
        *("reference", "query", "reference_positions.csv", "query_positions.csv"),
        *("model.lvpr", "figures.json", "report"),
    }
    values = json.loads(results[0][1])
    assert (values["places"], values["queries"], values["network"]["weight_bits"]) == (12, 12, 3)


def test_synth_writes_two_journeys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("synth", "s", "--places", 3, "--seed", 7).stdout == "3 places: s/reference, s/query\n"
    names = [f"place_{k:05d}.png" for k in range(3)]
    assert [p.name for p in images("s/reference")] == [p.name for p in images("s/query")] == names
    run("synth", "t", "--places", 3, "--seed", 7)
    run("synth", "u", "--places", 3, "--seed", 8)
    first = Path("s/query", names[1]).read_bytes()
    assert first == Path("t/query", names[1]).read_bytes()
    assert first != Path("u/query", names[1]).read_bytes()


def test_doctor_says_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    text = run("doctor").stdout
    assert text.startswith(f"lava-vpr {__version__}, Python 3.10.")
    assert re.search(r"│ host +│ yes +│", text)
    assert re.search(r"│ lava-nc +│ 0\.10\.", text)
    for extra in ("brian2", "lava-dl", "lava-loihi", "nxsdk"):
        assert re.search(rf"│ {extra} +│ ", text)
    module = importlib.import_module("lava_vpr.cli.doctor")
    known = module.version
    monkeypatch.setattr(module, "version", lambda package: None if package == "scipy" else known(package))
    result = CliRunner().invoke(main, ["doctor"])
    assert result.exit_code == 1
    assert re.search(r"│ scipy +│ missing ", result.stdout)
    assert "scipy missing; install lava-vpr again" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def commands() -> Iterator[tuple[str, click.Command]]:
    ctx = click.Context(main)
    for name in main.list_commands(ctx):
        command = main.get_command(ctx, name)
        assert command is not None
        yield name, command


def test_every_command_and_option_says_what_it_is() -> None:
    seen = dict(commands())
    assert list(seen) == ["demo", "synth", "train", "eval", "query", "doctor"]
    overview = run("--help").stdout
    assert overview == run("-h").stdout
    for name, command in seen.items():
        assert command.name == name
        assert len(command.help or "") > 20
        assert re.search(rf"^  {name} +\S", overview, re.M), overview
        text = " ".join(run(name, "--help").stdout.split())
        for param in command.params:
            if isinstance(param, click.Option):
                assert len(param.help or "") > 8, f"{name} {param.opts}"
                assert (param.help or "").rstrip("]").endswith((".", "100", "0")), f"{name} {param.opts}"
                assert param.opts[-1].removeprefix("--") in text
            else:
                assert (param.metavar or param.human_readable_name).removesuffix("...") in (command.help or "") or (
                    name in ("eval", "query") and param.human_readable_name == "MODEL"
                ), f"{name}: the help does not speak of {param.human_readable_name}"


def test_the_command_line_reference_is_up_to_date() -> None:
    """docs/cli.md is what scripts/cli_reference.py writes."""
    done = subprocess.run([sys.executable, "scripts/cli_reference.py", "--check"], cwd=ROOT, capture_output=True)
    assert done.returncode == 0, done.stderr.decode()


def test_version_and_the_module() -> None:
    assert run("--version").stdout == f"lava-vpr, version {__version__}\n"
    done = subprocess.run([sys.executable, "-m", "lava_vpr", "--version"], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"lava-vpr, version {__version__}\n", "")
    shown = subprocess.run([sys.executable, "-m", "lava_vpr", "--help"], capture_output=True, text=True, check=True)
    assert shown.stdout.startswith("Usage: lava-vpr [OPTIONS] COMMAND")


# --- train -----------------------------------------------------------------------------------------------------------


def test_train_is_quiet_in_a_pipe(here: Path) -> None:
    result = run("train", "reference", "-o", "n.lvpr", "--config", "quick.toml")
    pattern = (
        r"learned 8 places in \d+\.\d s: 8 neurons, 3-bit weights, \d+\.\d spikes per image, "
        r"\d neurons used, \d of 8 places covered\nmodel: n\.lvpr\n"
    )
    assert re.fullmatch(pattern, result.stdout), result.stdout
    assert not list(here.glob("*.checkpoint"))
    assert not list(here.glob(".n.lvpr*"))


def test_equal_trainings_write_equal_bytes(here: Path) -> None:
    for name, jobs in (("a", 1), ("b", 2)):
        run("train", "reference", "-o", f"{name}.lvpr", "--config", "quick.toml", "--stretch", 3, "--jobs", jobs)
    assert Path("a.lvpr").read_bytes() == Path("b.lvpr").read_bytes()
    assert str(here).encode() not in Path("a.lvpr").read_bytes()


def test_options_reach_the_model(here: Path) -> None:
    options = "--stretch 3 --weight-bits 5 --neurons 4 --epochs 2 --seed 11 --input onoff"
    text = run("train", "reference", "-o", "n.lvpr", "--config", "quick.toml", *options.split()).stdout
    assert text.startswith("learned 8 places in 3 stretches in ")
    assert ": 12 neurons, 5-bit weights, " in text
    learned = model.load(Path("n.lvpr"))
    assert [part.places for part in learned.stretches] == [3, 2, 3]
    assert [part.neurons for part in learned.stretches] == [4, 4, 4]
    assert learned.weight_bits == 5
    assert 7 < learned.network.weights.max() < 32
    config = learned.config
    assert (config.learning.epochs, config.seed, config.stretch, config.encoder.kind) == (2, 11, 3, "onoff")
    assert (config.network.steps, config.learning.steps) == (120, 120)  # from the file


def test_an_option_outweighs_the_file_and_the_file_the_preset(here: Path) -> None:
    Path("c.toml").write_text("seed = 4\n" + CONFIG)
    run("train", "reference", "-o", "a.lvpr", "--config", "c.toml", "--epochs", 2)
    run("train", "reference", "-o", "b.lvpr", "--config", "c.toml", "--seed", 5, "--preset", "loihi")
    a, b = model.load(Path("a.lvpr")).config, model.load(Path("b.lvpr")).config
    assert (a.learning.epochs, a.seed) == (2, 4)
    assert (b.learning.epochs, b.seed) == (5, 5)


def test_places_keep_their_absolute_indices(here: Path) -> None:
    run("train", "reference", "-o", "m2.lvpr", "--config", "quick.toml", "--places", "2:6")
    learned = model.load(Path("m2.lvpr"))
    assert learned.place_indices.tolist() == [2, 3, 4, 5]
    assert learned.place_names == tuple(f"place_{k:05d}.png" for k in range(2, 6))
    assert learned.route_images == PLACES
    # Queries default to the same range; `query` takes all and names absolute places.
    run("eval", "m2.lvpr", "query", "--json", "f.json")
    values = json.loads(Path("f.json").read_text())
    assert (values["places"], values["queries"]) == (4, 4)
    assert recall(values) >= 0.75
    run("query", "m2.lvpr", "query", "-o", "q.csv", "--places", "3:6")
    rows = [line.split(",") for line in Path("q.csv").read_text().splitlines()[1:]]
    assert [row[0] for row in rows] == ["3", "4", "5"]
    assert {row[2] for row in rows} <= {"2", "3", "4", "5"}
    assert all(row[3] == f"place_{int(row[2]):05d}.png" for row in rows)
    assert sum(row[0] == row[2] for row in rows) >= 2


def test_several_references_and_lists(here: Path) -> None:
    listed("a.txt", images("reference"))
    text = run("train", "a.txt", "query", "-o", "n.lvpr", "--config", "quick.toml").stdout
    assert text.startswith("learned 8 places in ")
    learned = model.load(Path("n.lvpr"))
    assert learned.labels.tolist() == [*range(PLACES), *range(PLACES)]
    assert len(learned.activity) == 2 * PLACES
    # A list is taken in its own order.
    listed("back.txt", images("reference")[::-1])
    run("train", "back.txt", "-o", "back.lvpr", "--config", "quick.toml", "--places", "0:3")
    assert model.load(Path("back.lvpr")).place_names == tuple(f"place_{k:05d}.png" for k in (7, 6, 5))


def test_a_video_is_a_traverse(here: Path) -> None:
    video(Path("v.avi"), 20)
    text = run("train", "v.avi", "-o", "v.lvpr", "--config", "quick.toml", "--every", 0.5).stdout
    assert text.startswith("learned 4 places in ")
    learned = model.load(Path("v.lvpr"))
    assert learned.place_names == ("frame 000000", "frame 000005", "frame 000010", "frame 000015")


# --- eval ------------------------------------------------------------------------------------------------------------


def test_the_json_has_these_keys_in_this_order(here: Path) -> None:
    values = figures("query")
    assert list(values) == ["places", "queries", "network", "default_decoder", "decoders", "baselines"]
    assert (values["places"], values["queries"], values["default_decoder"]) == (8, 8, "contrast")
    assert values["network"] == {"neurons": 8, "weight_bits": 3, "steps": 120}
    assert list(values["decoders"]) == DECODERS
    assert list(values["baselines"]) == ["sad", "cosine"]
    for matcher in (*values["decoders"].values(), *values["baselines"].values()):
        assert set(matcher) == FIGURES
        assert set(matcher["recall_at_n"]) == {"5", "10"}
        numbers = [matcher[key] for key in FIGURES - {"recall_at_n"}] + list(matcher["recall_at_n"].values())
        assert all(isinstance(x, float) and 0 <= x <= 1 for x in numbers)
        assert matcher["recall_at_n"]["10"] == 1.0  # of 8 places
    assert recall(values) >= 0.75


def test_equal_inputs_write_equal_bytes_wherever_they_are(here: Path) -> None:
    written = []
    for place in ("one", "another/deeper"):
        folder = here / place
        folder.mkdir(parents=True)
        shutil.copy("m.lvpr", folder / "m.lvpr")
        shutil.copytree("query", folder / "query")
        names = ("--json", folder / "f.json", "--report", folder / "r")
        table = run("eval", folder / "m.lvpr", folder / "query", *names).stdout
        files = [p for p in sorted(folder.rglob("*")) if p.is_file() and "query" not in p.parts]
        written.append({str(p.relative_to(folder)): p.read_bytes() for p in files})
        assert table.startswith("8 queries, 8 places, 8 neurons\n")
    assert written[0] == written[1]
    assert {"f.json", "r/report.html"} <= set(written[0])
    text = written[0]["f.json"].decode() + written[0]["r/report.html"].decode()
    assert str(here) not in text
    assert "lava-vpr eval m.lvpr query" in written[0]["r/report.html"].decode()
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\d\d:\d\d:\d\d", text)


def test_ground_truth_says_which_places_are_right(here: Path) -> None:
    plain = figures("query")
    Path("gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(8)))
    assert figures("query", "--gt", "gt.txt") == plain
    Path("wrong.json").write_text(json.dumps({str(k): (k + 4) % 8 for k in range(8)}))
    assert recall(figures("query", "--gt", "wrong.json")) == 0
    Path("any.json").write_text(json.dumps({str(k): list(range(8)) for k in range(8)}))
    assert recall(figures("query", "--gt", "any.json")) == 1


def test_fewer_and_more_queries_than_places(here: Path) -> None:
    Path("gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(8)))
    few = figures("query", "--places", "5:8", "--gt", "gt.txt")
    assert (few["places"], few["queries"]) == (8, 3)
    assert recall(few) >= 2 / 3
    order = [3, 1, 3, 0, 7, 7, 6, 5, 4, 2, 1, 0]
    listed("more.txt", [images("query")[k] for k in order])
    np.save("gt.npy", np.array(order))
    more = figures("more.txt", "--gt", "gt.npy")
    assert (more["places"], more["queries"]) == (8, 12)
    assert recall(more) >= 0.75


def test_positions_and_radius(here: Path) -> None:
    positions = ("--positions", "reference_positions.csv", "query_positions.csv", "--radius")
    assert figures("query", *positions, 8) == figures("query")  # places are 20 m apart, known to 3 m
    assert recall(figures("query", *positions, 0)) == 0
    wide = figures("query", *positions, 1000)
    assert recall(wide) == recall(wide, "sad") == 1
    few = figures("query", "--places", "5:8", *positions, 8)
    assert (few["queries"], few["places"]) == (3, 8)


def test_tolerance_counts_neighbours(here: Path) -> None:
    listed("next.txt", images("query")[1:] + images("query")[:1])
    assert recall(figures("next.txt")) <= 0.25
    assert recall(figures("next.txt", "--tolerance", 1)) >= 0.75
    assert recall(figures("next.txt", "--tolerance", 7)) == 1


def test_sequences(here: Path) -> None:
    single, triple = figures("query"), figures("query", "--sequence", 3)
    assert list(triple["decoders"]) == DECODERS
    assert triple["queries"] == 8
    assert recall(triple) == 1
    assert triple != single
    assert "8 queries, 8 places, 8 neurons, sequences of 3" in run("eval", "m.lvpr", "query", "--sequence", 3).stdout


def test_one_baseline_only(here: Path) -> None:
    everything = figures("query")
    for name in ("sad", "cosine"):
        assert figures("query", "--baseline", name)["baselines"] == {name: everything["baselines"][name]}
    both = figures("query", "--baseline", "sad", "--baseline", "cosine")
    assert both == everything


def test_descriptors_of_another_method(here: Path) -> None:
    np.save("r.npy", np.eye(8, dtype=np.float32))
    np.save("q.npy", np.roll(np.eye(8, dtype=np.float32), 1, axis=0))
    right = figures("query", "--descriptors", "r.npy", "r.npy")
    assert list(right["baselines"]) == ["sad", "cosine", "descriptors"]
    assert recall(right, "descriptors") == 1
    assert recall(figures("query", "--descriptors", "r.npy", "q.npy"), "descriptors") == 0


def test_the_seed_of_queries_is_the_models_by_default(here: Path) -> None:
    run("train", "reference", "-o", "s5.lvpr", "--config", "quick.toml", "--seed", 5)
    answers = {}
    for name, options in {"default": (), "5": ("--seed", 5), "0": ("--seed", 0)}.items():
        run("query", "s5.lvpr", "query", "-o", f"{name}.csv", *options)
        run("eval", "s5.lvpr", "query", "--json", f"{name}.json", "--sequence", 2, *options)
        answers[name] = Path(f"{name}.csv").read_bytes(), Path(f"{name}.json").read_bytes()
    assert answers["default"] == answers["5"]
    assert answers["default"][0] != answers["0"][0]


# --- query -----------------------------------------------------------------------------------------------------------


def test_the_csv_has_these_columns(here: Path) -> None:
    text = run("query", "m.lvpr", "query", "-o", "q.csv").stdout
    assert text == "8 images, 8 recognised: q.csv\n"
    lines = Path("q.csv").read_text().splitlines()
    assert lines[0] == "query,query_name,place,place_name,confidence,accepted"
    assert len(lines) == 9
    for k, line in enumerate(lines[1:]):
        assert re.fullmatch(rf"{k},place_{k:05d}\.png,(\d),place_0000\1\.png,\d[\d.e+-]*,true", line), line
    rows = matches("query")
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
    assert all(row["accepted"] == "true" for row in rows[2:])


def test_min_confidence_accepts_the_surest(here: Path) -> None:
    every = matches("query")
    limit = float(np.median([float(row["confidence"]) for row in every]))
    some = matches("query", "--min-confidence", limit)
    assert [{**row, "accepted": ""} for row in some] == [{**row, "accepted": ""} for row in every]
    assert [row["accepted"] for row in some] == [str(float(row["confidence"]) >= limit).lower() for row in every]
    assert 0 < sum(row["accepted"] == "true" for row in some) < 8
    none = run("query", "m.lvpr", "query", "-o", "q.csv", "--min-confidence", "inf").stdout
    assert none == "8 images, 0 recognised: q.csv\n"


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


# --- output files ----------------------------------------------------------------------------------------------------

WRITERS = {
    "n.lvpr": "train reference -o n.lvpr --config quick.toml",
    "n.csv": "query m.lvpr query -o n.csv",
    "n.json": "eval m.lvpr query --json n.json",
}


@pytest.mark.parametrize("name", WRITERS)
def test_an_existing_output_is_replaced_in_one_step(name: str, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path(name).write_text("old")
    os.link(name, "second name of the old file")
    run(*WRITERS[name].split())
    assert len(Path(name).read_bytes()) > 100
    assert Path("second name of the old file").read_text() == "old"
    fresh = Path(name).read_bytes()

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    result = CliRunner().invoke(main, WRITERS[name].split())
    assert result.exit_code == 1
    assert re.search(rf"^lava-vpr: error: {name}: .*No space left on device.*free", result.stderr)
    assert Path(name).read_bytes() == fresh
    assert not list(here.glob(".*.tmp"))
