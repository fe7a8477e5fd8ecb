"""Kinds of learning side by side: recall, training time, modelled energy and time of a query, bits.

    LAVA_VPR_DATA=... .venv-torch/bin/python -m benchmarks learning.table [--learner NAME] [--record]

Five Nordland sections of 100 places, learned in summer and queried in winter, three seeds; exact matches. Settings were
chosen on the first two sections and Gardens Point (`benchmarks.learning.search`, `benchmarks.presets`). Training time
is that of processors, so that what else runs does not count. Figures are kept in table.json, as those of the results
are in docs/results.json: what is known under today's settings and sources is not learned again.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.places import TEMPLATES, PlacesSection, learned, places
from benchmarks.program import BenchmarkTable, Printed, program
from benchmarks.results.rows import SEEDS, Figures, Record, ResultRow, asked
from benchmarks.results.tables import DEFAULT, FIVE, LATE
from lava_vpr.config import integer_config, preset
from lava_vpr.configfile import update

FILE = Path(__file__).with_name("table.json")
SCRATCH = {
    "learning": {"rule": "slayer", "epochs": 60},
    "slayer": {"start": "scratch", "rate": 0.08, "sharpness": 0.1, "surrogate": 1.0},
    "augment": {"altered": 0.5},
}
LEARNERS: Mapping[str, dict[str, Any]] = {
    "templates": {"learning": TEMPLATES},
    "STDP": {},
    "STDP in integers": {"learning": {"arithmetic": "integer"}},
    "SLAYER from templates": {"learning": {"rule": "slayer", "epochs": 10}},
    "SLAYER from scratch": SCRATCH,
}
ROWS = {name: ResultRow(name, update(preset(DEFAULT), how), FIVE, costs=True) for name, how in LEARNERS.items()}


def figures_and_seconds(row: ResultRow, section: PlacesSection, seed: int) -> Figures:
    """The figures of a section with a seed, and the seconds of processors that learning took."""
    config = dataclasses.replace(row.config, seed=seed)
    places(section, 0, config)  # read before the clock goes on
    began = time.process_time()
    model = learned(section, config)
    seconds = time.process_time() - began
    return asked(row, model, section, costs=seed == SEEDS[0]) | {"training": [round(seconds, 2)]}


@program(*(section.dataset for section in FIVE))
@click.option("--learner", "names", multiple=True, type=click.Choice(list(LEARNERS)), help="Only these.")
def main(names: Sequence[str]) -> Printed:
    """Learn what is not known, and print the table."""
    record, lines = Record.read(FILE, task=figures_and_seconds), []
    rows = [ROWS[name] for name in names or LEARNERS]
    record.bring_up_to_date(rows)
    for row in rows:
        costs = (record.mean(row, "training")[0], record.mean(row, "costs")[1])
        shown = (f"{value:.{digits}f}" for value, digits in zip(costs, (1, 2), strict=True))
        bits = f"{integer_config(row.config, row.name).network.weight_bits} and a sign"
        recalled = (record.cell(row, sections=sections) for sections in (FIVE, LATE))
        lines.append([row.name, *recalled, *shown, bits])
    columns = ["", "0:500", "200:500, which the search did not see", "training, s", "ms", "bits"]
    yield BenchmarkTable(columns, lines, record="learning-kinds")
