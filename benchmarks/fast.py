"""Preset ``fast`` on real images: recall beside modelled energy and time on Kapoho Bay, and what its settings bring.

    LAVA_VPR_DATA=... python -m benchmarks.fast [--seeds 0,1,2] [--budget 40] [--no-joined]

Nordland, summer learned, winter recognised, exact matches only. Places 0:200 chose the settings, 200:500 did not: they
are printed apart. Energy is dynamic, clearing of states included, host I/O not; all costs are modelled, nominal.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import SECTIONS, answer, encoded, learn, part, required
from lava_vpr.bench.results import Candidate
from lava_vpr.bench.sweep import search
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.engine.threads import cores
from lava_vpr.experiments.early_stopping import MARGINS
from lava_vpr.experiments.points import Case, Measurement, current, figures, mean, runs_of

Places = tuple[int, int]
PARTS = {"0:200 (chose the settings)": SECTIONS[:2], "200:500 (did not)": SECTIONS[2:], "all five": SECTIONS}
WITHOUT: dict[str, dict[str, Any]] = {
    "query_inputs 0 (all)": {"encoder": {"query_inputs": 0}},
    "without signs": {"network": {"signed": False}},
    "prune 0.8": {"network": {"prune": 0.8}},
    "Poisson trains": {"network": {"trains": "poisson"}},
}
"""Other settings than the preset's, one at a time."""

console = Console(highlight=False, width=150)


def case(places: Places, config: Config) -> Case:
    """Summer images ``places`` learned, the winter ones as queries."""
    queries = part(encoded("winter", config.encoder), slice(*places))
    return Case(learn(places, config), queries, np.eye(len(queries), dtype=bool))


def measure(asked: Case, margins: Sequence[float] = (np.inf,)) -> list[Measurement]:
    """Recall and modelled costs of a model as it stands, for each margin of early stopping."""
    (run,) = runs_of([asked], current(asked.model), KAPOHO_BAY, cores())
    return figures(run, margins)


def _table(title: str, first: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column(first)
    for name in ("R@1 %", "R@100P %", "AUC %", "modelled uJ", "modelled ms", "steps"):
        table.add_column(name, justify="right")
    return table


def _cells(row: Measurement | Candidate) -> list[str]:
    m, steps = row.metrics, row.steps if isinstance(row, Measurement) else row.mean_steps
    recall = (f"{100 * value:.1f}" for value in (m.recall_at_1, m.recall_at_100_precision, m.auc))
    return [*recall, f"{row.microjoules:.3f}", f"{row.milliseconds:.4f}", f"{steps:.1f}"]


def sections(config: Config, seeds: Sequence[int]) -> dict[tuple[Places, int], list[Measurement]]:
    """The figures of every section and seed, without early stopping and then with each of `MARGINS`."""
    return {
        (section, seed): measure(case(section, dataclasses.replace(config, seed=seed)), (np.inf, *MARGINS))
        for section in SECTIONS
        for seed in seeds
    }


def print_preset(name: str, seeds: Sequence[int]) -> None:
    """Print a preset's figures by part, seed and section, and what early stopping would bring."""
    results = sections(preset(name), seeds)
    table = _table(f"preset {name}, sections of 100 places, seeds {', '.join(map(str, seeds))}", "places")
    for title, chosen in PARTS.items():
        table.add_row(title, *_cells(mean([rows[0] for (section, _), rows in results.items() if section in chosen])))
    for seed in seeds:
        rows = [rows[0] for (_, learned_with), rows in results.items() if learned_with == seed]
        table.add_row(f"seed {seed}", *_cells(mean(rows)))
    for section in SECTIONS:
        rows = [rows[0] for (places, _), rows in results.items() if places == section]
        table.add_row(f"{section[0]}:{section[1]}", *_cells(mean(rows)))
    table.add_section()
    for title, chosen in PARTS.items():
        for number, margin in enumerate(MARGINS, start=1):
            rows = [rows[number] for (section, _), rows in results.items() if section in chosen]
            table.add_row(f"{title}, stopped at a lead of {margin:g}", *_cells(mean(rows)))
    console.print(table)


def print_without(seeds: Sequence[int]) -> None:
    """Print what other settings than the preset's bring (`WITHOUT`)."""
    table = _table("preset fast with other settings, five sections", "other")
    for title, changes in WITHOUT.items():
        config = update(preset("fast"), changes)
        figures_of_all = [
            measure(case(s, dataclasses.replace(config, seed=seed)))[0] for s in SECTIONS for seed in seeds
        ]
        table.add_row(title, *_cells(mean(figures_of_all)))
    console.print(table)


def print_joined(seeds: Sequence[int]) -> None:
    """Print the figures of all 500 places in one model, single images and sequences."""
    table = _table("preset fast, places 0:500 in one model", "queries")
    lengths: dict[int, list[float]] = {5: [], 10: []}
    single_images = []
    for seed in seeds:
        asked = case((0, 500), dataclasses.replace(preset("fast"), seed=seed))
        single_images.append(measure(asked)[0])
        for length, recalls in lengths.items():
            result = answer(asked.model, (0, 500), sequence=length, rivals=())
            recalls.append(result.metrics[result.default].recall_at_1)
    table.add_row("single images", *_cells(mean(single_images)))
    for length, recalls in lengths.items():
        table.add_row(f"sequences of {length}", f"{100 * np.mean(recalls):.1f}")
    console.print(table)


def print_front(seeds: Sequence[int], budget: int) -> None:
    """Print the front of a search on 0:200, from preset ``fast`` on (what differs from it); early stopping apart."""
    configs = [dataclasses.replace(preset("fast"), seed=seed) for seed in seeds]
    cases = [case(section, config) for section in SECTIONS[:2] for config in configs]
    points = search(cases, budget, retrain=False, threads=cores())
    for stopping in (False, True):
        rows = [point for point in points if point.front and ("stop_margin" in point.settings) == stopping]
        way = "with early stopping" if stopping else "without early stopping"
        table = _table(f"front on 0:200 of {budget} networks, {way}", "settings")
        for point in sorted(rows, key=lambda point: point.microjoules):
            words = ", ".join(f"{key} {value:g}" for key, value in point.settings.items())
            table.add_row(point.chosen or words, *_cells(point))
        console.print(table)


@click.command()
@click.option("--seeds", default="0,1,2")
@click.option("--budget", type=int, default=40, help="Networks that the search on 0:200 tries.")
@click.option("--joined/--no-joined", default=True)
def main(seeds: str, budget: int, joined: bool) -> None:
    """Print recall and modelled costs of preset ``fast``, a table for each question."""
    required("nordland")
    numbers = [int(seed) for seed in seeds.split(",")]
    print_preset("fast", numbers)
    print_preset("loihi", numbers[:1])
    print_without(numbers)
    if joined:
        print_joined(numbers)
    if budget:
        print_front(numbers, budget)


if __name__ == "__main__":
    main()
