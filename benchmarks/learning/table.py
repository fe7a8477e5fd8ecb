"""Kinds of learning side by side: recall, training time, modelled energy and time of a query, bits.

    LAVA_VPR_DATA=... .venv-torch/bin/python -m benchmarks learning.table [--learner NAME] [--log FILE] [--record]

Five Nordland sections of 100 places, summer learned and winter asked, three seeds; exact matches. Settings were chosen
on the first two sections and Gardens Point (`benchmarks.learning.search`, `benchmarks.presets`). Training time is that
of processors, so that what else runs does not count. Every model leaves a line in the log, and those that have one
are not learned again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from benchmarks.nordland import FOLDERS, images_of
from benchmarks.places import TEMPLATES, PlacesSection, places, sections_of
from benchmarks.program import BenchmarkTable, Printed, program
from benchmarks.results.rows import ResultRow, asked
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.engine.presentations import cores
from lava_vpr.slayer.front_end import EPOCHS, learned_filters
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

SECTIONS = sections_of("nordland", 500)
SEEDS = (0, 1, 2)
LOG = Path("benchmarks/learning/table.log")
CHOSEN_ON = 2
"""So many of the sections were looked at when settings were chosen."""
SCRATCH = {
    "learning": {"rule": "slayer", "epochs": 60},
    "slayer": {"start": "scratch", "rate": 0.08, "sharpness": 0.1, "surrogate": 1.0},
    "augment": {"altered": 0.5},
}
LEARNERS: Mapping[str, Mapping[str, Any]] = {
    "templates": {"learning": TEMPLATES},
    "STDP": {},
    "STDP in integers": {"learning": {"arithmetic": "integer"}},
    "SLAYER from templates": {"learning": {"rule": "slayer", "epochs": 10}},
    "SLAYER from scratch": SCRATCH,
    "templates behind filters before learning": {"learning": TEMPLATES, "encoder": {"kind": "filters"}},
    "templates behind filters that SLAYER learned": {"learning": TEMPLATES, "encoder": {"kind": "filters"}},
}
UNLEARNED = "templates behind filters before learning"


class LearnedFigures(NamedTuple):
    """What one model reached, in percent, seconds, microjoules and milliseconds."""

    learner: str
    section: str
    seed: int
    recall_at_1: float
    recall_at_100_precision: float
    auc: float
    training_s: float
    microjoules: float
    milliseconds: float
    bits: int


def measured(learner: str, config: Config, section: PlacesSection) -> LearnedFigures:
    """Learn a section and ask for its places."""
    began = time.process_time()
    if config.encoder.kind == "filters":
        traverse = open_traverse(images_of(section.dataset, FOLDERS[section.dataset][0]))
        images, epochs = (
            traverse.take(range(section.first, section.end)).images(),
            0 if learner == UNLEARNED else EPOCHS,
        )
        config = update(config, {"encoder": {"filters": learned_filters(images, config, epochs)}})
    seconds = time.process_time() - began
    references = places(section, 0, config)
    began = time.process_time()
    model = train(references, config, pool=Pool(cores()))
    seconds += time.process_time() - began
    found = asked(ResultRow("", config, (section,), costs=True), model, section, costs=True)
    recall, costs = ([round(value, digits) for value in found[name]] for name, digits in (("network", 2), ("costs", 4)))
    return LearnedFigures(
        learner, str(section), config.seed, *recall, round(seconds, 2), *costs, model.weight_bits or 0
    )


def read(log: Path) -> list[LearnedFigures]:
    """The rows that a log holds."""
    return [LearnedFigures(**json.loads(line)) for line in log.read_text().splitlines()] if log.exists() else []


def table(rows: Sequence[LearnedFigures]) -> BenchmarkTable:
    """A line for each learner."""
    late, lines = {str(section) for section in SECTIONS[CHOSEN_ON:]}, []
    for learner in LEARNERS:
        own = [row for row in rows if row.learner == learner]
        if not own:
            continue
        costs = np.mean([(row.training_s, row.microjoules, row.milliseconds) for row in own], axis=0)
        shown = (f"{value:.{digits}f}" for value, digits in zip(costs, (1, 2, 2), strict=True))
        seeds = sorted({row.seed for row in own})
        name = learner if len(seeds) == len(SEEDS) else f"{learner} (seed {', '.join(map(str, seeds))})"
        recalls = (recalled(own, seeds), recalled([row for row in own if row.section in late], seeds))
        lines.append([name, *recalls, *shown, f"{own[0].bits} and a sign"])
    columns = ["", "0:500", "200:500, which the search did not see", "training, s", "µJ", "ms", "bits"]
    return BenchmarkTable(columns, lines, record="learning-kinds")


def recalled(rows: Sequence[LearnedFigures], seeds: Sequence[int]) -> str:
    """Means of R@1, R@100P and AUC, and how far the seeds' mean R@1 spread, if there are several."""
    if not rows:
        return "-"
    means = np.mean([(row.recall_at_1, row.recall_at_100_precision, row.auc) for row in rows], axis=0)
    text = " / ".join(f"{value:.1f}" for value in means)
    spread = np.std([np.mean([row.recall_at_1 for row in rows if row.seed == seed]) for seed in seeds])
    return f"{text} (R@1 of seeds ± {spread:.1f})" if len(seeds) > 1 else text


@program(*(section.dataset for section in SECTIONS))
@click.option("--learner", "names", multiple=True, type=click.Choice(list(LEARNERS)), help="Only these.")
@click.option("--log", type=click.Path(path_type=Path), default=LOG, show_default=True)
def main(names: Sequence[str], log: Path) -> Printed:
    """Learn what the log lacks, and print the table."""
    known = {(row.learner, row.section, row.seed) for row in read(log)}
    due = [(seed, learner, section) for seed in SEEDS for learner in names or LEARNERS for section in SECTIONS]
    for seed, learner, section in due:
        if (learner, str(section), seed) in known:
            continue
        row = measured(learner, update(preset("loihi"), {**LEARNERS[learner], "seed": seed}), section)
        with log.open("a") as file:
            file.write(json.dumps(row._asdict()) + "\n")
    yield table(read(log))
