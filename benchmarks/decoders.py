"""Which decoder is the default: all of them on the same spikes, on what settings may be chosen on.

    LAVA_VPR_DATA=... python -m benchmarks decoders [--seeds 3,4,5,6] [--record]

Maps of Nordland 0:100, 100:200 and 0:200 and of Gardens Point 0:50 (within two places), each learned in summer and in
winter (Gardens Point: on either side of the path) and asked with the other, by STDP and by templates. Cells are R@1 /
R@100P / AUC in percent, and the score that chooses presets (`benchmarks.presets`): weighted means over maps and seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import click
import numpy as np

from benchmarks.descriptors.recall import hogs
from benchmarks.learning.surroundings import LEARNERS
from benchmarks.places import FOLDERS, PlacesSection, images_of, near, recognised
from benchmarks.presets import PLACES, SEASONS, WEIGHTS
from benchmarks.program import RECALL, BenchmarkTable, Printed, program
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.evaluation import Recall
from lava_vpr.recognition import DECODERS_ONLY
from lava_vpr.traverse import Traverse, open_traverse, vector_traverse
from lava_vpr.vectors.files import Vectors


def images(section: PlacesSection, which: int) -> Traverse:
    """References (0) or queries (1) of a section."""
    return open_traverse(images_of(section.dataset, FOLDERS[section.dataset][which]), places=section[1:])


def vectors(section: PlacesSection, which: int) -> Traverse:
    """HOG vectors of these images."""
    return vector_traverse(str(section), Vectors(hogs(section.dataset, which)[section.first : section.end]))


INPUTS: Mapping[str, tuple[str, Callable[[PlacesSection, int], Traverse]]] = {
    **{f"`{name}`": (name, images) for name in ("loihi", "balanced", "fast", "accurate")},
    "HOG vectors, `loihi`": ("loihi", vectors),
}
"""Rows: a preset, and what it is given."""


def cells(name: str, learner: str, seeds: Sequence[int]) -> dict[str, str]:
    """What each decoder recalls."""
    preset_name, traverse = INPUTS[name]
    config = update(preset(preset_name), {"learning": LEARNERS[learner]})
    found: dict[str, list[float]] = {decoder: [] for decoder in DECODERS}
    for section, tolerance in PLACES.items():
        truth = near(section.end - section.first, tolerance)
        for season in SEASONS:
            pair = traverse(section, season), traverse(section, 1 - season)
            results = recognised(config, *pair, truth, seeds, DECODERS_ONLY)
            for decoder, figures in found.items():
                figures.append(np.mean([Recall.of(one.metrics[decoder]) for one in results], axis=0))
    made = {}
    for decoder, figures in found.items():
        score = WEIGHTS * 100 * np.array(figures)
        made[decoder] = " / ".join(f"{value:.1f}" for value in score.sum(axis=0) / RECALL) + f"; {score.sum():.1f}"
    return made


@program("nordland", "gardens")
@click.option("--seeds", default="3,4,5,6", show_default=True, help="Seeds, separated by commas.")
def main(seeds: str) -> Printed:
    """Every decoder on the same spikes."""
    rows = []
    for name in INPUTS:
        for learner in LEARNERS:
            rows.append(
                [f"{name}, {learner}", *cells(name, learner, [int(seed) for seed in seeds.split(",")]).values()]
            )
            click.echo(" | ".join(rows[-1]), err=True)
    titles = [DECODERS[name].title for name in DECODERS]
    yield BenchmarkTable(["", *titles], rows, title="R@1 / R@100P / AUC; score", record="decoders-chosen")
