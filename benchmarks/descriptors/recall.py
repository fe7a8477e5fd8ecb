"""HOG vectors through the spiking network, beside their own cosine, on the five sections of Nordland.

    LAVA_VPR_DATA=... python -m benchmarks descriptors.recall [--seeds 0,1,2] [--chosen-on] [--record]

OpenCV's HOG of 64 x 64 grey images (1,764 values, `lava_vpr.inputs.patches.hog`) is given as any descriptor would be.
For each section of 100 places, learned in summer and queried in winter, and in the mean it prints R@1 in percent of the
vectors' cosine as they are and standardised, of the cosine of the network's inputs, of the network without learning and
as learned.

With ``--chosen-on`` it does so on what settings were chosen on, Nordland 0:200 and Gardens Point 0:50 (within two
places), for every way to encode vectors that was tried.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import FOLDERS, PlacesSection, images_of, near, recognised, sections_of
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from lava_vpr.config import Config, StdpLearning, preset
from lava_vpr.configfile import update
from lava_vpr.inputs.patches import hog
from lava_vpr.recognition import Comparison
from lava_vpr.training.preparing import settings_for
from lava_vpr.traverse import open_traverse, vector_traverse
from lava_vpr.vectors.files import Vectors

FIVE = sections_of("nordland", 500)
CHOSEN_ON = (*sections_of("nordland", 200), PlacesSection("nordland", 0, 200), PlacesSection("gardens", 0, 50))
TOLERANCE = {"nordland": 0, "gardens": 2}
MATCHERS = {
    "cosine of the vectors": "vectors",
    "standardised": "standardised",
    "cosine of the inputs": "cosine",
    "without learning": "template",
    "as learned": "contrast",
}
WAYS: Mapping[str, Mapping[str, Any]] = {
    "as it is": {},
    "learned for 350 steps": {"steps": 350},
    "learned for 1,400 steps": {"steps": 1400},
    "520 of the inputs": {"query_inputs": 520},
    "no dead zone": {"vector_dead_zone": 0.0},
    "dead zone 0.3": {"vector_dead_zone": 0.3},
    "dead zone 0.7": {"vector_dead_zone": 0.7},
    "a scale for each value": {"vector_scale": "own"},
    "projected on 1,024": {"vector_kept": 1024},
    "projected on 1,024, no dead zone": {"vector_kept": 1024, "vector_dead_zone": 0.0},
    "PCA of the references": {"pca": True},
    "PCA of the references, no dead zone": {"pca": True, "vector_dead_zone": 0.0},
    "one input a value (rates)": {"kind": "rates"},
    "one input a value, 520 of them": {"kind": "rates", "query_inputs": 520},
}
"""Ways to encode vectors: settings of ``[encoder]``, and ``steps`` of ``[learning]``, beside the defaults; ``pca``: all
components of the references in place of the vectors."""


@lru_cache
def hogs(dataset: str, which: int) -> NDArray[np.float32]:
    """HOG vectors of the references (0) or queries (1) of a dataset, float32 (images, 1764), in 0..1."""
    images = open_traverse(images_of(dataset, FOLDERS[dataset][which])).images()
    return np.stack([hog(image) for image in images]).astype(np.float32) / np.float32(255)


def components(references: NDArray[np.float32], queries: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Both as the principal components of the references, all that those differ in."""
    mean = references.mean(axis=0)
    _, sizes, axes = np.linalg.svd(references - mean, full_matrices=False)
    kept = axes[sizes > 1e-6 * sizes[0]].T
    return [(references - mean) @ kept, (queries - mean) @ kept]


def with_way(settings: Mapping[str, Any]) -> Config:
    """The default preset with vectors encoded in one of `WAYS`."""
    if not settings:
        return preset("loihi")
    encoder = {"kind": "vector", "query_inputs": 0} | dict(settings)
    steps = encoder.pop("steps", 2 * StdpLearning.steps)
    encoder.pop("pca", None)
    return update(preset("loihi"), {"encoder": encoder, "learning": {"steps": steps}})


def vector_recall(
    section: PlacesSection, settings: Mapping[str, Any], seeds: Sequence[int]
) -> tuple[NDArray[np.float64], int]:
    """R@1 in percent of each of `MATCHERS`, means over seeds, and the network's inputs."""
    pair = [hogs(section.dataset, which)[section.first : section.end] for which in (0, 1)]
    pair = components(*pair) if "pca" in settings else pair
    references, queries = (vector_traverse(f"{section}", Vectors(vectors)) for vectors in pair)
    truth = near(section.end - section.first, TOLERANCE[section.dataset])
    config = with_way(settings)
    results = recognised(config, references, queries, truth, seeds, Comparison(keep_scores=False))
    found = [
        [one.metrics[name].recall_at_1 if name in one.metrics else np.nan for name in MATCHERS.values()]
        for one in results
    ]
    return 100 * np.mean(found, axis=0), settings_for(config, [references]).encoder.inputs


@program("nordland", "gardens")
@seeds_option
@click.option("--chosen-on", is_flag=True, help="Every way to encode vectors, on what settings were chosen on.")
def main(seeds: Sequence[int], chosen_on: bool) -> Printed:
    """R@1 in percent of HOG vectors through the network, and of their own cosine."""
    if not chosen_on:
        found = [vector_recall(section, {}, seeds)[0] for section in FIVE]
        named = zip([*map(str, FIVE), "mean"], [*found, np.mean(found, axis=0)], strict=True)
        rows = [[name, *(f"{value:.1f}" for value in values)] for name, values in named]
        yield BenchmarkTable(["section", *MATCHERS], rows, record="descriptors")
        return
    rows = []
    for name, settings in WAYS.items():
        every = [vector_recall(section, settings, seeds) for section in CHOSEN_ON]
        inputs, values = every[0][1], np.mean([values for values, _ in every], axis=0)
        rows.append([name, f"{inputs:,}", *(f"{value:.1f}" for value in values[2:])])
    yield BenchmarkTable(["vectors as inputs", "inputs", *list(MATCHERS)[2:]], rows, record="descriptors-ways")
