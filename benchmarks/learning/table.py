"""Kinds of learning side by side: recall, training time, modelled energy and time of a query, bits.

    LAVA_VPR_DATA=... .venv-torch/bin/python -m benchmarks learning.table [--learner NAME] [--log FILE] [--record]

Five Nordland sections of 100 places, summer learned and winter asked, three seeds; exact matches. Settings were chosen
on the first two sections and Gardens Point (`benchmarks.learning.search`, `benchmarks.presets`). Training time is that
of processors, so that what else runs does not count. Every model leaves a line in the log, and those that have one
are not learned again.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from benchmarks.nordland import FOLDERS, images_of
from benchmarks.places import TEMPLATES, Section, places, sections_of
from benchmarks.program import Figures, Printed, program
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.encoding import EncodedTraverse, Keep, encode_views
from lava_vpr.engine.threads import cores
from lava_vpr.experiments.points import Case, current, figures, runs_of
from lava_vpr.slayer.front_end import EPOCHS, learned_filters
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, open_traverse

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


class Row(NamedTuple):
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


def measured(learner: str, config: Config, section: Section) -> Row:
    """Learn a section and ask for its places."""
    began = time.process_time()
    if config.encoder.kind == "filters":
        epochs = 0 if learner == UNLEARNED else EPOCHS
        config = update(config, {"encoder": {"filters": learned_filters(taken(section, 0).images(), config, epochs)}})
    seconds = time.process_time() - began
    (queries,), references = encoded(section, 1, config), encoded(section, 0, config)
    began = time.process_time()
    model = train(references, config, jobs=cores())
    seconds += time.process_time() - began
    case = Case(model, queries, np.eye(len(queries), dtype=bool))
    (run,) = runs_of([case], current(model), KAPOHO_BAY, cores())
    (found,) = figures(run, [math.inf])
    metrics = found.metrics
    recall = (metrics.recall_at_1, metrics.recall_at_100_precision, metrics.auc)
    bits = model.weight_bits or 0
    percent = (round(100 * value, 2) for value in recall)
    costs = (round(seconds, 2), round(found.microjoules, 4), round(found.milliseconds, 4))
    return Row(learner, str(section), config.seed, *percent, *costs, bits)


def taken(section: Section, which: int) -> Traverse:
    """References (0) or queries (1) of a section as they were taken."""
    dataset, first, end = section
    return open_traverse(images_of(dataset, FOLDERS[dataset][which])).take(range(first, end))


def encoded(section: Section, which: int, config: Config) -> tuple[EncodedTraverse, ...]:
    """References (0) or queries (1) of a section, of the whole journey once where inputs are fixed."""
    if config.encoder.kind != "filters":
        return places(section, which, config)
    return encode_views(taken(section, which), config.encoder, config.views.views, Keep.ALL)


def read(log: Path) -> list[Row]:
    """The rows that a log holds."""
    return [Row(**json.loads(line)) for line in log.read_text().splitlines()] if log.exists() else []


def table(rows: Sequence[Row]) -> Figures:
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
    return Figures(columns, lines, record="learning-kinds")


def recalled(rows: Sequence[Row], seeds: Sequence[int]) -> str:
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
