"""The search that chose the settings of learning by SLAYER; needs lava-dl (`make ci-torch` sets it up).

    LAVA_VPR_DATA=... .venv-torch/bin/python -m benchmarks.learning.search [--start template] [--log FILE]

It sees places 0:200 of Nordland, as two sections, and 0:50 of Gardens Point within two places, and seeds that no table
uses. One round of coordinate descent: settings take their values in turn, and a value is kept if it raises the score by
more than `MARGIN` points: 0.6 R@1, 0.15 R@100P and 0.25 AUC, Gardens Point counting 15 %, as in `benchmarks.presets`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.nordland import required
from benchmarks.results.places import Section, learn, places
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.engine.threads import cores
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, recognise

SEEDS = (3, 4)
PLACES = ((Section("nordland", 0, 100), 0), (Section("nordland", 100, 200), 0), (Section("gardens", 0, 50), 2))
"""What is learned, and how many places off an answer may be."""
WEIGHTS = np.array(((0.425,), (0.425,), (0.15,))) * (0.6, 0.15, 0.25)
MARGIN = 0.5
FIRST: Mapping[str, Mapping[str, Any]] = {
    "template": {"learning": {"epochs": 10}, "slayer": {"start": "template", "rate": 0.02}},
    "scratch": {"learning": {"epochs": 40}, "slayer": {"start": "scratch", "rate": 0.05}},
}
"""Where the search starts; what it does not name is at its default."""
TRIED: Mapping[str, Sequence[Any]] = {
    "slayer.rate": (0.01, 0.05, 0.1),
    "augment.altered": (0.5, 0.7, 0.9),
    "augment.shift": (0.0, 2.0),
    "augment.noise": (0.0, 1.0),
    "augment.contrast": (0.0,),
    "augment.illumination": (0.0,),
    "slayer.surrogate": (0.1, 1.0),
    "slayer.sharpness": (0.1, 2.0),
    "learning.epochs": (20, 80),
}


def figures(model: Model, section: Section, tolerance: int) -> tuple[float, float, float]:
    """R@1, R@100P and AUC in percent of the queries of a section."""
    queries = places(section, 1, model.config)[0]
    order = np.arange(len(queries))
    truth = np.abs(order[:, None] - order) <= tolerance
    result = recognise(model, queries, truth, Comparison(rivals=(), keep_scores=False), threads=cores())
    found = result.metrics[result.default]
    return 100 * found.recall_at_1, 100 * found.recall_at_100_precision, 100 * found.auc


def scored(config: Config) -> tuple[float, str]:
    """The score of settings, and their figures."""
    rows = []
    for section, tolerance in PLACES:
        models = (learn(section, update(config, {"seed": seed})) for seed in SEEDS)
        rows.append(np.mean([figures(model, section, tolerance) for model in models], axis=0))
    told = "  ".join("/".join(f"{value:.1f}" for value in row) for row in rows)
    return float(np.sum(np.array(rows) * WEIGHTS)), told


@click.command()
@click.option("--start", type=click.Choice(list(FIRST)), default="template", show_default=True)
@click.option("--log", "path", type=click.Path(path_type=Path), default=None, help="Append here, too.")
def main(start: str, path: Path | None) -> None:
    """Choose the settings, and print a line for every one that was tried."""
    required(*(section.dataset for section, _ in PLACES))

    def note(line: str) -> None:
        print(line, flush=True)
        if path is not None:
            with path.open("a") as file:
                file.write(line + "\n")

    config = update(preset("loihi"), {"learning": {"rule": "slayer"}})
    config = update(config, {name: dict(values) for name, values in FIRST[start].items()})
    began = time.monotonic()
    best, told = scored(config)
    seeds = ", ".join(map(str, SEEDS))
    note(f"{start}: R@1/R@100P/AUC of {', '.join(str(section) for section, _ in PLACES)}; seeds {seeds}; * kept")
    note(f"  {best:6.2f}   {told}  the start, {time.monotonic() - began:.0f} s")
    for name, values in TRIED.items():
        section, _, key = name.partition(".")
        for value in values:
            tried = update(config, {section: {key: value}})
            if tried == config:
                continue
            score, told = scored(tried)
            kept = score > best + MARGIN
            note(f"  {score:6.2f} {'*' if kept else ' '} {told}  {name} {value:g}")
            if kept:
                best, config = score, tried
    note(f"{start}: {config.slayer} {config.augment} epochs={config.learning.epochs}")


if __name__ == "__main__":
    main()
