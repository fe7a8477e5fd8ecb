"""The results: docs/results.json has today's rows, and its figures are those of today's code."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.places import PlacesSection
from benchmarks.results import __main__ as command
from benchmarks.results import record, rows, tables
from benchmarks.results.record import REMEDY, Record
from benchmarks.results.tables import DEFAULT, FIVE, INTEGER, LEARNED
from lava_vpr.configfile import update
from lava_vpr.experiments.cache import modules_of


def test_the_file_has_todays_rows_under_todays_settings() -> None:
    assert Record.read().lacks(tables.ROWS) == [], REMEDY


def test_the_file_has_every_section_and_seed_of_a_row() -> None:
    kept = Record.read()
    for row in tables.ROWS:
        wanted = {record.key(section, seed) for section in row.sections for seed in rows.SEEDS}
        assert set(kept.rows[row.name]["figures"]) == wanted, row.name
    assert len({row.name for row in tables.ROWS}) == len(tables.ROWS)


@pytest.mark.parametrize("name", INTEGER)
def test_another_setting_of_a_preset_is_another_row(name: str) -> None:
    row = LEARNED[name]
    changed = dataclasses.replace(row, config=update(row.config, {"network": {"inhibition": 0.66}}))
    others, kept = [other for other in tables.ROWS if other != row], Record({})
    for one in tables.ROWS:
        kept.put(one, "of today", {})
    assert kept.lacks(tables.ROWS) == []
    assert kept.lacks([*others, changed]) == [row.name]
    assert kept.lacks(others) == [row.name]


def test_what_decides_the_figures_is_derived_from_imports() -> None:
    """A hash of sources changes with any of these modules: tests/experiments/test_cache.py."""
    decide = set(modules_of(rows.measure))
    engine, chip = {"lava_vpr.engine.inference.fixed", "lava_vpr.training.loop"}, {"lava_vpr.deploy.cost.costs"}
    assert {"benchmarks.results.rows", "benchmarks.places", "lava_vpr.recognition", *engine, *chip} <= decide
    assert not {name for name in decide if name.startswith(("lava_vpr.cli", "lava_vpr.report"))}


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    row, made = LEARNED[DEFAULT], Record({})
    figures = {
        record.key(section, seed): {"network": [90.0 + k + seed, 80.5, 7.25], "costs": [2.0 * k, 1.0]}
        for k, section in enumerate(FIVE)
        for seed in rows.SEEDS
    }
    made.put(row, "of today", figures)
    made.write(tmp_path / "results.json")
    read = Record.read(tmp_path / "results.json")
    assert read == made
    assert read.current(row, "of today")
    assert not read.current(row, "of yesterday")
    assert not read.current(dataclasses.replace(row, tolerance=1), "of today")
    assert read.cell(row) == "93.0 / 80.5 / 7.2"
    assert read.cell(row, sections=FIVE[2:]) == "94.0 / 80.5 / 7.2"
    assert read.mean(row, seeds=(0,))[0] == 92.0
    assert read.mean(row, "costs") == [4.0, 1.0]
    assert Record.read(tmp_path / "none.json") == Record({})


def test_what_is_up_to_date_is_not_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, asked = tmp_path / "results.json", []
    one, two = LEARNED[DEFAULT], dataclasses.replace(LEARNED[DEFAULT], name="two")

    def measured(row: rows.ResultRow, section: PlacesSection, seed: int) -> rows.Figures:
        if row == two and (section, seed) == (FIVE[1], 2) and not asked.count("interrupted"):
            asked.append("interrupted")
            raise KeyboardInterrupt
        asked.append(row.name)
        return {"network": [1.0, 2.0, 3.0]}

    monkeypatch.setattr(command, "measure", measured)
    old = Record({"gone": {"settings": "", "sources": "", "figures": {}}})
    with pytest.raises(KeyboardInterrupt):
        command.bring_up_to_date(old, [one, two], file, every=False)
    assert set(Record.read(file).rows) == {one.name}
    for every, computed in ((False, ["two"] * 15), (False, []), (True, [one.name] * 15 + ["two"] * 15)):
        asked[:] = ["interrupted"]
        command.bring_up_to_date(Record.read(file), [one, two], file, every)
        assert asked[1:] == computed
        assert Record.read(file).lacks([one, two]) == []


def test_what_the_page_says_of_its_tables_is_so() -> None:
    """Learning one clean traverse brings nothing; where cosine is ahead; what `fast` takes the chip."""
    kept = Record.read()
    for row in tables.ROWS:
        if "template" in row.matchers:
            few = row.sections[0].dataset == "gardens"  # 50 images: one is two points
            assert (-3 if few else -1) <= kept.mean(row, "template")[0] - kept.mean(row)[0] <= (3 if few else 2), (
                row.name
            )
    assert kept.mean(tables.LENGTHS["1,500"], "cosine")[1] > kept.mean(tables.LENGTHS["1,500"])[1]
    every = tables.LENGTHS["1,500, all inputs spike in queries"]
    assert np.all(np.array(kept.mean(every, "cosine")) > kept.mean(every))
    adapted = (kept.mean(LEARNED[DEFAULT], f"{name}, adapted") for name in ("cosine", "network"))
    assert np.all(np.greater(*adapted))
    assert "1.1 µJ, is a hundredth" in (record.ROOT / "docs" / "results.md").read_text(encoding="utf-8").replace(
        "\n  ", " "
    )
    assert f"{kept.mean(LEARNED['fast'], 'costs')[0]:.1f}" == "1.1"


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("kind", tables.KINDS)
def test_a_section_of_each_row_is_what_the_file_says(kind: str, data_root: Path) -> None:
    """The first section with the first seed, computed anew: figure for figure."""
    kept = Record.read()
    for row in tables.KINDS[kind]:
        place = row.sections[0], rows.SEEDS[0]
        assert rows.measure(row, *place) == kept.figures(row, *place), f"{row.name}: if that is meant, {REMEDY}"
