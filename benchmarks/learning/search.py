"""The search that chose the settings of learning by SLAYER; needs lava-dl (`make ci-torch` sets it up).

    LAVA_VPR_DATA=... .venv-torch/bin/python -m benchmarks learning.search [--start template] [--log FILE]

It sees places 0:200 of Nordland, as two sections, and 0:50 of Gardens Point within two places, and seeds that no table
uses. One round of coordinate descent: settings take their values in turn, and a value is kept if it raises the score by
more than `MARGIN` points: 0.6 R@1, 0.15 R@100P and 0.25 AUC, Gardens Point counting 15 %, as in `benchmarks.presets`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import PlacesSection
from benchmarks.program import MARGIN, RECALL, Log, Printed, program, recalls
from benchmarks.results.rows import ResultRow, measure
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.experiments.search import Settings, descend

SEEDS = (3, 4)
PLACES = {
    PlacesSection("nordland", 0, 100): 0,
    PlacesSection("nordland", 100, 200): 0,
    PlacesSection("gardens", 0, 50): 2,
}
"""How many places off an answer may be, by what is learned."""
WEIGHTS = np.array(((0.425,), (0.425,), (0.15,))) * RECALL
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


def configured(base: Config, settings: Settings) -> Config:
    """``base`` with settings, each by its section and name."""
    for name, value in settings.items():
        section, _, key = name.partition(".")
        base = update(base, {section: {key: value}})
    return base


def recalled(config: Config) -> NDArray[np.float64]:
    """R@1, R@100P and AUC in percent of each of `PLACES`, means over the seeds."""
    rows = (ResultRow("", config, (section,), tolerance=off) for section, off in PLACES.items())
    return np.array([np.mean([measure(row, *row.sections, seed)["network"] for seed in SEEDS], axis=0) for row in rows])


@program(*(section.dataset for section in PLACES))
@click.option("--start", type=click.Choice(list(FIRST)), default="template", show_default=True)
@click.option("--log", "path", type=click.Path(path_type=Path), default=Path("search.log"), show_default=True)
def main(start: str, path: Path) -> Printed:
    """Choose the settings, with a line for every one that is tried."""
    base = update(preset("loihi"), {"learning": {"rule": "slayer"}})
    base = update(base, {name: dict(values) for name, values in FIRST[start].items()})
    log, titles = Log(path), ", ".join(map(str, PLACES))
    log.write(f"{start}: R@1/R@100P/AUC of {titles}; seeds {', '.join(map(str, SEEDS))}; * kept")
    held = {name: getattr(getattr(base, name.partition(".")[0]), name.partition(".")[2]) for name in TRIED}

    def score(found: NDArray[np.float64]) -> float:
        return float((found * WEIGHTS).sum())

    trials = descend(
        held,
        TRIED,
        lambda settings: recalled(configured(base, settings)),
        lambda trial, best: score(trial.result) > score(best.result) + MARGIN,  # type: ignore[arg-type]
        rounds=1,
    )
    chosen = configured(base, log.chosen(trials, lambda found: f"{recalls(found)}  {score(found):6.2f}"))
    yield f"{start}: {chosen.slayer} {chosen.augment} epochs={chosen.learning.epochs}"
