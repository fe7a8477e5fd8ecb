"""The results: docs/results.json has today's rows, and its figures are those of today's code."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.figures import read
from benchmarks.places import PlacesSection
from benchmarks.results import __main__ as command, rows, tables
from benchmarks.results.rows import REMEDY, Record
from benchmarks.results.tables import DEFAULT, FIVE, LEARNED
from lava_vpr.configfile import update
from lava_vpr.experiments.cache import modules_of


def names(row: rows.ResultRow) -> list[str]:
    """What the figures of a row are kept under."""
    return [rows.name_of(*place) for place in rows.places_of([row])]


def test_the_file_has_every_section_and_seed_of_todays_rows_under_todays_settings() -> None:
    today = {name: rows.settings_hash(row) for row in tables.ROWS for name in names(row)}
    assert {name: key.split()[0] for name, (key, _) in Record.read().kept.items()} == today, REMEDY
    assert len({row.name for row in tables.ROWS}) == len(tables.ROWS)


def test_what_decides_the_figures_is_derived_from_imports() -> None:
    """A hash of sources changes with any of these modules: tests/experiments/test_grid.py."""
    decide = set(modules_of(rows.measure))
    engine, chip = {"lava_vpr.engine.inference.fixed", "lava_vpr.training.loop"}, {"lava_vpr.deploy.cost.costs"}
    assert {"benchmarks.results.rows", "benchmarks.places", "lava_vpr.recognition", *engine, *chip} <= decide
    assert not {name for name in decide if name.startswith(("lava_vpr.cli", "lava_vpr.report"))}


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    row, file = LEARNED[DEFAULT], tmp_path / "results.json"
    kept: dict[str, tuple[str, rows.Figures]] = {
        rows.name_of(row, section, seed): (
            "settings sources",
            {"network": [90.0 + k + seed, 80.5, 7.25], "costs": [2.0 * k, 1.0]},
        )
        for k, section in enumerate(FIVE)
        for seed in rows.SEEDS
    }
    made = Record(kept, file)
    made.write()
    read = Record.read(file)
    assert read == made
    # 500 queries, then 300: no finer than one of them, and from the least seed to the most.
    assert read.cell(row) == "93.0 / 80.4 / 7.2 (92.0 / 80.4 / 7.2 to 94.0 / 80.4 / 7.2)"
    assert read.cell(row, sections=FIVE[2:], figures=1) == "94.0 (93.0 to 95.0)"
    assert read.cell(row, sections=FIVE[:1], figures=1) == "91 (90 to 92)"
    assert read.mean(row, seeds=(0,))[0] == 92.0
    assert read.mean(row, "costs") == [4.0, 1.0]
    assert read.origin == (rows.short_hash("settings"), "sources")
    assert Record.read(tmp_path / "none.json").kept == {}


def test_what_is_up_to_date_is_not_computed_again(tmp_path: Path) -> None:
    """Under other settings, of a preset or a row, or from other sources it is; an interrupted run goes on."""
    file, asked = tmp_path / "results.json", list[str]()
    one = LEARNED[DEFAULT]
    two = dataclasses.replace(one, name="two")

    def measured(row: rows.ResultRow, section: PlacesSection, seed: int) -> rows.Figures:
        if row.name == "two" and (section, seed) == (FIVE[1], 2) and not asked.count("interrupted"):
            asked.append("interrupted")
            raise KeyboardInterrupt
        asked.append(row.name)
        return {"network": [1.0, 2.0, 3.0]}

    old = Record({"gone: nordland 0:100, seed 0": ("", {})}, file, measured)
    with pytest.raises(KeyboardInterrupt):
        command.bring_up_to_date(old, [one, two], every=False)
    assert {*Record.read(file).kept} == {*names(one), *names(two)[:5]}
    again, other, all_of = ["two"] * 15, dataclasses.replace(two, tolerance=1), [one.name] * 15 + ["two"] * 15
    inhibited = dataclasses.replace(two, config=update(two.config, {"network": {"inhibition": 0.66}}))
    for last, every, computed in (
        (two, False, again[5:]),
        (two, False, []),
        (two, True, all_of),
        (other, False, again),
        (inhibited, False, again),
    ):
        asked[:] = ["interrupted"]
        command.bring_up_to_date(Record.read(file, task=measured), [one, last], every)
        assert asked[1:] == computed
    found = Record.read(file, task=measured)
    place = (inhibited, FIVE[0], 0)
    assert found.find(place, found.key(place)) == {"network": [1.0, 2.0, 3.0]}
    assert found.find(place, Record({}).key(place)) is None  # another program
    assert {*found.kept} == {*names(one), *names(two)}


def test_what_the_page_says_of_its_tables_is_so() -> None:
    """Learning one clean traverse brings nothing; where cosine is ahead, and takes less energy."""
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
    assert kept.cell(every).startswith("80.3 / 40.5 / 78.7 (80.2 / 35.8 / ")
    assert " to 80.4 / 48.7 / " in kept.cell(every)
    adapted = (kept.mean(LEARNED[DEFAULT], f"{name}, adapted") for name in ("cosine", "network"))
    assert np.all(np.greater(*adapted))
    assert read("energy").columns[2:4] == [tables.WHOLE, tables.WITHOUT_ENCODING]
    energy = {row[0]: row[1:] for row in read("energy").rows}
    for case, row in tables.ENERGY_OF.items():
        own = energy[f"{case}, Kapoho Bay"]
        assert own[0] == kept.cell(row, figures=1), "python -m benchmarks energy.whole --record"
        if cosine := energy.get(f"{case}, `cosine`"):
            nominal = (float(one[2].split()[0].replace(",", "")) for one in (cosine, own, energy[f"{case}, no board"]))
            assert next(nominal) < min(nominal), case


@pytest.mark.parametrize(
    ("queries", "percent", "shown"),
    [
        *((50, 47.3333, "48"), (50, 2.0, "2"), (100, 95.6667, "96"), (300, 95.2222, "95.3"), (500, 88.2667, "88.2")),
        *((1000, 70.7333, "70.7"), (1500, 40.5333, "40.5")),
    ],
)
def test_no_figure_is_finer_than_a_query(queries: int, percent: float, shown: str) -> None:
    assert rows.rounded(percent, queries) == shown


def test_figures_are_shares_of_the_queries_that_were_asked() -> None:
    """Sequences of 5 ask 496 of 500 places; where each is seen 20 times, ten thousand are asked."""
    by_name, kept = {row.name: row for row in tables.ROWS}, Record.read()
    assert kept.cell(by_name["500 places, sequences of 5"], "sad", figures=2) == "83.7 / 65.9"  # 415 and 327 of 496
    standing = by_name[f"five sections, each image {rows.STANDING} times with noise"]
    assert kept.cell(standing, "template", figures=1).startswith("96.1 ")


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("kind", tables.KINDS)
def test_a_section_of_each_row_is_what_the_file_says(kind: str, data_root: Path) -> None:
    """The first section with the first seed, computed again: figure for figure."""
    kept = Record.read()
    for row in tables.KINDS[kind]:
        place = row.sections[0], rows.SEEDS[0]
        known = kept.kept[rows.name_of(row, *place)][1]
        assert rows.measure(row, *place) == known, f"{row.name}: if that is meant, {REMEDY}"
