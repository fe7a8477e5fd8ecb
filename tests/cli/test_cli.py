"""The command line at work: demo, synth, train, help, output files. Wrong use is in test_cli_errors.py."""

from __future__ import annotations

import ast
import importlib
import json
import os
import platform
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from support.common import children
from support.common.commands import CONFIG, PLACES, fails, images, listed, recall, run

from lava_vpr import __version__, model
from lava_vpr.backends.lava import lava_missing
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cli import main
from lava_vpr.cli.show.headings import OPTIONS, POSITIONS, RUNNING, help_records
from lava_vpr.cli.show.recall import MEANING
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.processes.base import lava_checks

ROOT = Path(__file__).resolve().parents[2]


# --- demo, synth, doctor, help ---------------------------------------------------------------------------------------


def test_demo_twice_into_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("lava_vpr.cli.demo")
    draw = module.write_traverses
    monkeypatch.setattr(module, "write_traverses", lambda out, places, *given, **how: draw(out, 12, *given, **how))
    monkeypatch.chdir(tmp_path)
    results = []
    for _ in range(2):
        text = run("demo", "--out", "d").stdout
        results.append((text, Path("d/figures.json").read_bytes(), Path("d/model.lvpr").read_bytes()))
    assert results[0][1:] == results[1][1:]
    text = results[0][0]
    assert "12 queries, 12 places, 12 neurons" in text
    for name in ("contrast *", "sad", "cosine"):
        assert re.search(rf"│ {re.escape(name)} +│( +[\d.]+ │){{4}}\n", text), text
    assert "│ weighted_probability" not in text
    assert "\nP@100R, AUC and the other decoders: in the report\n" in text
    assert text.splitlines()[-1] == "report to open in a browser: d/report/report.html"
    page = Path("d/report/report.html").read_text(encoding="utf-8")
    assert "lava-vpr demo" in page
    assert str(tmp_path) not in page
    assert {p.name for p in Path("d").iterdir()} == {
        *("reference", "query", "reference_positions.csv", "query_positions.csv", "reference.gpx", "query.gpx"),
        *("model.lvpr", "figures.json", "report"),
    }
    values = json.loads(results[0][1])
    right = round(12 * values["decoders"]["contrast"]["recall_at_1"])
    assert f"\nRecognised the place in {right} of 12 queries.\n{MEANING}\n12 queries, 12 places" in text
    assert (values["places"], values["queries"], values["network"]["weight_bits"]) == (12, 12, 3)


def test_doctor_says_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    text = run("doctor").stdout
    assert text.startswith(f"lava-vpr {__version__}, Python {platform.python_version()}, ")
    assert re.search(r"│ host +│ yes +│", text)
    able = len(re.findall(r"│ [\w-]+ +│ yes +│", text))
    assert text.splitlines()[1] == f"All that is needed is installed; {able} of {len(BACKENDS)} backends can run."
    missing = lava_missing()
    assert re.search(rf"│ lava-nc +│ {'0.10.0' if missing is None else 'not installed'} ", text)
    assert re.search(rf"│ lava-fused +│ {'yes' if missing is None else 'no'} ", text)
    for extra in ("lava-dl", "pi-heif", "pillow-heif", "lava-loihi", "nxsdk"):
        assert re.search(rf"│ {extra} +│ ", text)
    assert "SANA-FE" not in text
    assert re.search(r"│ RAPL +│ (not )?readable", text)
    module = importlib.import_module("lava_vpr.cli.doctor")
    known = module.installed
    monkeypatch.setattr(module, "installed", lambda package: None if package == "scipy" else known(package))
    result = CliRunner().invoke(main, ["doctor"])
    assert result.exit_code == 1
    assert re.search(r"│ scipy +│ missing ", result.stdout)
    assert result.stdout.splitlines()[1] == f"scipy missing; 0 of {len(BACKENDS)} backends can run."
    assert "lava-vpr: error: scipy missing; install again" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_lavas_absence_is_one_line(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`doctor` and `verify` go on without Lava; what was to run in it does not."""
    said = "lava-nc is not installed: pip install lava-nc==0.10.*"

    def absent() -> None:
        raise BackendUnavailableError(said)

    monkeypatch.setattr(lava_checks, "require_lava", absent)
    monkeypatch.setattr("lava_vpr.processes.require_lava", absent)
    for words in (("doctor",), ("verify", "m.lvpr", "query", "--limit", 1)):
        lines = [line for line in run(*words).stdout.splitlines() if said in line]
        assert lines == [f"lava-fixed, lava-float, lava-fused, lava-library, loihi2: {said}"]
    for words in (
        ("verify", "m.lvpr", "query"),
        ("query", "m.lvpr", "query", "-o", "q.csv"),
        ("eval", "m.lvpr", "query"),
    ):
        assert fails(*words, "--backend", "lava-fused") == said
    with pytest.raises(BackendUnavailableError, match=re.escape(said)):
        from lava_vpr.processes import PlaceNetwork  # noqa: F401


def commands() -> Iterator[tuple[str, click.Command]]:
    ctx = click.Context(main)
    for name in main.list_commands(ctx):
        command = main.get_command(ctx, name)
        assert command is not None
        yield name, command


def test_every_command_and_option_says_what_it_is() -> None:
    seen = dict(commands())
    changing = ["extend", "remove", "merge"]
    asking = ["eval", "query", "watch", "season", "verify", "fit", "deploy", "export", "import", "bench"]
    asking += ["datasets", "protocol", "study", "paper-table", "doctor"]
    assert list(seen) == ["demo", "synth", "train", *changing, *asking]
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
                assert (param.help or "").split("  [default: ")[0].endswith("."), f"{name} {param.opts}"
                assert param.opts[-1].removeprefix("--") in text
            else:
                assert (param.metavar or param.human_readable_name).removesuffix("...").strip("[]") in (
                    command.help or ""
                ) or (name in ("eval", "query") and param.human_readable_name == "MODEL"), (
                    f"{name}: the help does not speak of {param.human_readable_name}"
                )


def test_the_options_of_long_commands_stand_below_headings() -> None:
    for name, command in commands():
        records = help_records(command, click.Context(command))
        long = name in ("train", "eval", "query", "watch", "bench", "deploy", "study", "paper-table")
        assert (OPTIONS in records, len(records) >= 5) == (not long, long), name
        assert not long or list(records)[-1] == RUNNING
        assert sum(map(len, records.values())) == 1 + sum(isinstance(param, click.Option) for param in command.params)
        titles = re.findall(r"^(\S.*):$", run(name, "--help").stdout, re.M)
        assert titles == list(records)
    record = help_records(dict(commands())["eval"], click.Context(main))
    assert [words.split()[0] for words, _ in record[POSITIONS]] == ["--query-positions", "--stamps", "--gap"]


@pytest.mark.parametrize("path", sorted((ROOT / "lava_vpr" / "cli").rglob("*.py")), ids=lambda path: path.stem)
def test_commands_are_short(path: Path) -> None:
    """A command parses, calls one function and prints; what takes more lines belongs below."""
    text = path.read_text(encoding="utf-8")
    functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    long = {node.name: length for node in functions if (length := (node.end_lineno or 0) - node.lineno + 1) > 40}
    assert (long, text.count("\n") <= 400) == ({}, True)


def test_version_and_the_module() -> None:
    assert run("--version").stdout == f"lava-vpr, version {__version__}\n"
    done = children.run([sys.executable, "-m", "lava_vpr", "--version"], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"lava-vpr, version {__version__}\n", "")
    shown = children.run([sys.executable, "-m", "lava_vpr", "--help"], capture_output=True, text=True, check=True)
    assert shown.stdout.startswith("Usage: lava-vpr [OPTIONS] COMMAND")


# --- train -----------------------------------------------------------------------------------------------------------


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
    assert re.search(r" an image; \d+ neurons? without a place; every place has a neuron$", text, re.MULTILINE)
    learned = model.load(Path("n.lvpr"))
    assert [part.places for part in learned.stretches] == [3, 2, 3]
    assert [part.neurons for part in learned.stretches] == [4, 4, 4]
    assert learned.weight_bits == 5
    assert 7 < learned.network.weights.max() < 32
    config = learned.config
    assert (config.learning.epochs, config.seed, config.stretch, config.encoder.kind) == (2, 11, 3, "onoff")
    assert (config.network.steps, config.learning.steps) == (256, 300)  # from the file


def test_an_option_outweighs_the_file_and_the_file_the_preset(here: Path) -> None:
    Path("c.toml").write_text("seed = 4\n" + CONFIG)
    run("train", "reference", "-o", "a.lvpr", "--config", "c.toml", "--epochs", 2)
    run("train", "reference", "-o", "b.lvpr", "--config", "c.toml", "--seed", 5, "--preset", "loihi")
    a, b = model.load(Path("a.lvpr")).config, model.load(Path("b.lvpr")).config
    assert (a.learning.epochs, a.seed) == (2, 4)
    assert (b.learning.epochs, b.seed) == (6, 5)


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
    assert re.search(rf"^{name}: .*No space left on device.*free", fails(*WRITERS[name].split()))
    assert Path(name).read_bytes() == fresh
    assert not list(here.glob(".*.tmp"))
