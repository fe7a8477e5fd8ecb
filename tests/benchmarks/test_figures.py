"""Every figure of the docs by one command: which commands there are, and what they find."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from benchmarks import figures
from benchmarks.commands import records, tables
from lava_vpr.config import DecoderConfig
from lava_vpr.errors import InputError
from lava_vpr.matching.decoders import DECODERS


def test_every_record_has_one_command_and_pages_come_last() -> None:
    found = list(records.commands())
    assert found[-2:] == [records.RESULTS, records.PAGES]
    assert all(command.endswith(" --record") for command in found[:-2])
    named = {name for command in found if "commands.tables" in command for name in command.split()[4:-1]}
    assert named == set(tables.NAMES)
    assert {figures.read(name).command for name in set(figures.names()) - named} == {
        command.removesuffix(" --record") for command in found[:-2] if "commands.tables" not in command
    }


def test_what_bars_a_command_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(records, "ROOT", tmp_path)
    assert records.commands(["snntorch", "versions", "season"]) == {
        ".venv-torch/bin/python -m benchmarks exchange.compare --record": ".venv-torch/bin/python is missing: run make "
        "ci-torch",
        "python -m benchmarks versions.whole CHECKOUT --record": "it compares with an older checkout: name one by hand",
        "python -m benchmarks learning.season --part compared --record": "",
    }


def test_a_run_goes_on_behind_a_command() -> None:
    found = {"one": "", "two": "barred", "three": ""}
    assert records.remaining(found, None) == found
    assert records.remaining(found, "one") == {"two": "barred", "three": ""}
    with pytest.raises(InputError, match="--after 'four': no such command"):
        records.remaining(found, "four")


def test_a_command_that_fails_is_named_at_the_end_and_others_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def commands(names: Any) -> dict[str, str]:
        return {"exit 3": "", "touch barred": "no such thing", "touch done": ""}

    monkeypatch.setattr(records, "ROOT", tmp_path)
    monkeypatch.setattr(records, "commands", commands)
    monkeypatch.setattr("benchmarks.program.required", lambda *datasets: None)
    with pytest.raises(SystemExit, match="1"):
        records.main([], standalone_mode=False)
    assert [path.name for path in tmp_path.iterdir()] == ["done"]
    said = capfd.readouterr().out
    assert "2 of 3: touch barred (no such thing)" in said
    assert said.endswith("failed: exit 3\n")


def test_commands_of_records_find_the_images_that_they_name(data_root: Path) -> None:
    before = Path.cwd()
    with tables.images():
        assert Path(os.environ["N"]) == Path.cwd()
        assert [len(Path(f"{season}.txt").read_text().split()) for season in ("summer", "winter")] == [1500, 1500]
        assert [len(list(Path(name).iterdir())) for name in ("summer", "nordland/winter", "gardens/ref")] == [
            500,
            1500,
            100,
        ]
        assert all(path.exists() for path in Path.cwd().rglob("*"))
    assert Path.cwd() == before


def test_the_default_decoder_scores_highest_in_every_row() -> None:
    record = figures.read("decoders-chosen")
    assert record.columns[1:] == [DECODERS[name].title for name in DECODERS]
    assert record.columns[1] == DECODERS[DecoderConfig().default].title
    for name, *cells in record.rows:
        first, *others = (float(cell.split("; ")[1]) for cell in cells)
        assert first > max(others), name
