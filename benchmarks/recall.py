"""Recall on real images by what is varied: Nordland, summer learned, winter recognised, exact matches only.

    LAVA_VPR_DATA=... python -m benchmarks recall TABLE [--seeds 0,1,2]

Every line is the mean over its sections and seeds; each seed draws its own start weights and its own noise in training,
in the references' responses and in queries. Below a network stand other matchers on the same images, the paper's
decoders on the same spikes. Time on the chip is modelled for Kapoho Bay: nominal, clearing included, host I/O
not. What `make results` computes is not repeated here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import click

from benchmarks.places import TEMPLATES, PlacesSection, learned
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from benchmarks.results.rows import PRINTED, Record, ResultRow, asked, measure
from benchmarks.results.tables import DEFAULT, FIVE, PAPERS, SIMPLEST
from lava_vpr.config import INPUT_MODES, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.bundle.learning import learned_on_chip
from lava_vpr.engine.presentations import cores

ON_CHIP = "integers, as the chip can: no floor, no rest, thresholds folded"
INTEGER = {"learning": {"arithmetic": "integer"}}
ALL = (PlacesSection("nordland", 0, 500),)
PAPER = (FIVE[0], FIVE[3])


def varied(name: str, changes: Mapping[str, Mapping[str, Any]], of: str = DEFAULT, **fields: Any) -> ResultRow:
    """The five sections under other settings than those of a preset."""
    return ResultRow(name, update(preset(of), {part: dict(values) for part, values in changes.items()}), FIVE, **fields)


TABLES: dict[str, list[ResultRow]] = {
    "decoders": [varied("preset loihi", {}, matchers=(*SIMPLEST, *PAPERS, *(f"{name}{PRINTED}" for name in PAPERS)))],
    "arithmetic": [
        varied("float", {}),
        varied("none: the references' rates as weights", {"learning": TEMPLATES}),
        varied("integer: 8-bit weights, 7-bit traces", INTEGER),
        varied(
            "the same, thresholds rise between presentations",
            {"learning": {**INTEGER["learning"], "theta_update": "presentation"}},
        ),
        *(
            varied(f"integer, quantised to {bits} bits", INTEGER | {"network": {"weight_bits": bits}})  # type: ignore[dict-item]
            for bits in range(7, 0, -1)
        ),
    ],
    "chip-learning": [
        varied("float", {}),
        varied("integers", INTEGER),
        varied(ON_CHIP, {}),
    ],
    "input-modes": [
        ResultRow(f"{mode}, {title}", update(preset(DEFAULT), {"network": {"input_mode": mode}}), chosen)
        for title, chosen in (
            ("five sections", FIVE),
            ("0:200, which chose the settings", FIVE[:2]),
            ("200:500, which did not", FIVE[2:]),
            ("0:500 in one model", ALL),
        )
        for mode in INPUT_MODES
    ],
    "fast": [
        varied("preset fast", {}, "fast", costs=True),
        varied("query_inputs 0 (all)", {"encoder": {"query_inputs": 0}}, "fast", costs=True),
        varied("without signs", {"network": {"signed": False}}, "fast", costs=True),
        varied("prune 0.8", {"network": {"prune": 0.8}}, "fast", costs=True),
        varied("Poisson trains", {"network": {"trains": "poisson"}}, "fast", costs=True),
        varied("preset fast, and the paper's decoders", {}, "fast", matchers=PAPERS),
        varied("threshold 0.35, and the paper's decoders", {"network": {"threshold": 0.35}}, "fast", matchers=PAPERS),
        ResultRow("0:500 in one model", preset("fast"), ALL, costs=True),
        ResultRow("0:500 in one model, sequences of 5", preset("fast"), ALL, sequence=5),
    ],
    "accurate": [
        varied("preset accurate", {}, "accurate"),
        varied("prune 0 (none)", {"network": {"prune": 0.0}}, "accurate"),
    ],
    "paper": [
        ResultRow("preset paper, 0:100 and 300:400", preset("paper"), PAPER, (*PAPERS, "contrast", "sad", "hog")),
        ResultRow("preset loihi, the same places", preset(DEFAULT), PAPER, SIMPLEST),
    ],
}
"""Rows by the name of their table. Preset paper takes two minutes for each section and seed."""


def figures(row: ResultRow, section: PlacesSection, seed: int) -> dict[str, list[float]]:
    """The figures of a section; `ON_CHIP` is learned again as a bundle of the float model says."""
    if row.name != ON_CHIP:
        return measure(row, section, seed)
    model = learned(section, replace(row.config, seed=seed))
    return asked(row, learned_on_chip(model, cores()), section)


def lines(row: ResultRow, seeds: Sequence[int]) -> list[list[str]]:
    """The lines of a row: its network, then its other matchers."""
    record = Record({}, task=figures)
    record.bring_up_to_date([row], seeds)
    costs = [f"{record.mean(row, 'costs')[1]:.3g}"] if row.costs and 0 in seeds else []
    named = {row.name: "network"} | {f"  {matcher}": matcher for matcher in row.matchers}
    made = [[name, *(f"{value:.1f}" for value in record.mean(row, of, seeds=seeds))] for name, of in named.items()]
    return [made[0] + costs, *made[1:]]


@program("nordland")
@click.argument("table", type=click.Choice(list(TABLES)))
@seeds_option
def main(table: str, seeds: Sequence[int]) -> Printed:
    """Print recall on real images, and what it costs where that changes."""
    rows = [line for row in TABLES[table] for line in lines(row, seeds)]
    columns = ("", "R@1", "R@100P", "AUC", "modelled ms")[: max(map(len, rows))]
    filled = [[*row, *[""] * (len(columns) - len(row))] for row in rows]
    title = f"percent, seeds {', '.join(map(str, seeds))}"
    yield BenchmarkTable(columns, filled, title=title, record=table if table == "chip-learning" else "")
