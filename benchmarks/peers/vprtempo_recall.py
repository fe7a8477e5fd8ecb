"""VPRTempo written from its equations, on real images: recall of winter queries, exact matches, five sections.

    LAVA_VPR_DATA=... python -m benchmarks peers.vprtempo_recall [--seeds 0,1,2] [--own]

Without options: 28x28 images patch-normalised as in VPRSNN, as model files hold them. ``--own`` adds VPRTempo's own
56x56 images, gamma-corrected, window 15 (about a minute a seed). Nothing here was chosen on recall.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.vprtempo import (
    SIDE,
    SMALL_SIDE,
    SMALL_WINDOW,
    WINDOW,
    input_spikes,
    preprocess,
    train,
)
from benchmarks.places import SECTIONS, images_of
from benchmarks.program import Printed, program, seeds_option
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.matching.evaluation import Metrics, Recall, evaluate, titles
from lava_vpr.show.table import Table
from lava_vpr.traverse import open_traverse

Prepare = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]

IMAGES: dict[str, Prepare] = {
    "28x28, window 7, as lava-vpr and SAD see them": patch_normalised,
    "28x28, window 7, its own preprocessing": lambda image: preprocess(image, SMALL_SIDE, SMALL_WINDOW),
    "56x56, window 15, its own preprocessing": lambda image: preprocess(image, SIDE, WINDOW),
}


@lru_cache(maxsize=2)
def spikes_of(season: str, kind: str) -> NDArray[np.float32]:
    """Input spikes of all images of a season."""
    return input_spikes(
        np.stack([IMAGES[kind](image) for image in open_traverse(images_of("nordland", season)).images()])
    )


def section(kind: str, places: tuple[int, int], seed: int) -> Metrics:
    """Recall of one section; the best amplitude is the confidence, as in the released code."""
    images = slice(*places)
    network = train(spikes_of("summer", kind)[images], seed=seed)
    scores = network.scores(spikes_of("winter", kind)[images])
    values = scores.astype(np.float64)
    return evaluate(values, values.max(axis=1), np.eye(len(values), dtype=bool))


@program("nordland")
@seeds_option
@click.option("--own", is_flag=True, help="Also VPRTempo's own preprocessing and its 56x56 images.")
def main(seeds: Sequence[int], own: bool) -> Printed:
    """Recall of VPRTempo on real images: five sections of 100 places, percent."""
    rows = []
    for kind in list(IMAGES) if own else list(IMAGES)[:1]:
        started = time.perf_counter()
        found = [[Recall.of(section(kind, places, seed)) for places in SECTIONS] for seed in seeds]
        figures, took = 100 * np.array(found), time.perf_counter() - started
        rows.append(
            [
                kind,
                *(f"{value:.1f}" for value in figures.mean(axis=(0, 1))),
                " ".join(f"{value:.0f}" for value in figures[..., 0].mean(axis=0)),
                " ".join(f"{value:.1f}" for value in figures[..., 0].mean(axis=1)),
                f"{took / (len(seeds) * len(SECTIONS)):.1f}",
            ]
        )
    yield Table(["", *titles(), "R@1 by section", "by seed", "s a section"], rows)
