"""HOG vectors through the spiking network, beside their own cosine, on the five sections of Nordland.

    LAVA_VPR_DATA=... python -m benchmarks.descriptors.recall [--seed 0 --seed 1 --seed 2] [--chosen-on]

OpenCV's HOG of 64 x 64 grey images (1,764 values, `lava_vpr.inputs.hog`) is given as any descriptor would be. For each
section of 100 places, summer learned and winter asked, and in the mean it prints R@1 in percent of the vectors' cosine
as they are and standardised, of the cosine of the network's inputs, of the network without learning and as learned.

With ``--chosen-on`` it does so on what settings were chosen on, Nordland 0:200 and Gardens Point 0:50 (within two
places), for every way to encode vectors that was tried.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.nordland import FOLDERS, images_of, required
from benchmarks.results.places import Section, sections_of
from lava_vpr.config import Config, StdpLearning, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.threads import cores
from lava_vpr.errors import LavaVprError
from lava_vpr.inputs.hog import hog
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.training.loop import train
from lava_vpr.training.standard import fitted, settings_for
from lava_vpr.traverse import open_traverse, vector_traverse
from lava_vpr.vectors.source import Vectors

FIVE = sections_of("nordland", 500)
CHOSEN_ON = (*sections_of("nordland", 200), Section("nordland", 0, 200), Section("gardens", 0, 50))
TOLERANCE = {"nordland": 0, "gardens": 2}
COLUMNS = ("vectors", "standardised", "cosine", "template", "contrast")

WAYS: dict[str, dict[str, Any]] = {
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


class Figures(NamedTuple):
    """R@1 in percent of each of `COLUMNS`, float64 (columns,), and the network's inputs."""

    recall: NDArray[np.float64]
    inputs: int


@lru_cache
def hogs(dataset: str, which: int) -> NDArray[np.float32]:
    """HOG vectors of the references (0) or queries (1) of a dataset, float32 (images, 1764), in 0..1."""
    images = open_traverse(images_of(dataset, FOLDERS[dataset][which])).images()
    return np.stack([hog(image) for image in images]).astype(np.float32) / np.float32(255)


def components(references: NDArray[np.float32], queries: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """Both as the principal components of the references, all that those differ in."""
    mean = references.mean(axis=0)
    _, sizes, axes = np.linalg.svd(references - mean, full_matrices=False)
    kept = axes[sizes > 1e-6 * sizes[0]].T
    return (references - mean) @ kept, (queries - mean) @ kept


def measured(section: Section, config: Config, pca: bool = False) -> Figures:
    """What the vectors of a section reach, or, with ``pca``, their components."""
    places = slice(section.first, section.end)
    pair: Sequence[NDArray[np.float32]] = [hogs(section.dataset, which)[places] for which in (0, 1)]
    pair = components(*pair) if pca else pair
    references, queries = (vector_traverse(f"{section}", Vectors(vectors)) for vectors in pair)
    config = settings_for(config, [references])
    standard = fitted(config, [references])
    learned = encode_traverse(references, config.encoder, Keep.ALL, standard=standard)
    model = train([learned], config, standard=standard, jobs=cores())
    asked = encode_traverse(queries, config.encoder, Keep.VECTORS, standard=standard)
    apart = np.abs(np.arange(len(asked))[:, None] - np.arange(model.places))
    result = recognise(
        model, asked, apart <= TOLERANCE[section.dataset], Comparison(keep_scores=False), threads=cores()
    )
    found = [100 * result.metrics[name].recall_at_1 if name in result.metrics else np.nan for name in COLUMNS]
    return Figures(np.array(found), config.encoder.inputs)


def with_way(settings: dict[str, Any], seed: int) -> Config:
    """The default preset with vectors encoded in one of `WAYS`."""
    config = dataclasses.replace(preset("loihi"), seed=seed)
    if not settings:
        return config
    encoder = {"kind": "vector", "query_inputs": 0} | settings
    steps = encoder.pop("steps", 2 * StdpLearning.steps)
    encoder.pop("pca", None)
    return update(config, {"encoder": encoder, "learning": {"steps": steps}})


def mean_over(sections: Sequence[Section], seeds: Sequence[int], settings: dict[str, Any]) -> list[Figures]:
    """The figures of each section, mean over the seeds."""
    found = []
    for section in sections:
        every = [measured(section, with_way(settings, seed), "pca" in settings) for seed in seeds]
        found.append(Figures(np.mean([one.recall for one in every], axis=0), every[0].inputs))
    return found


def line(name: str, recall: NDArray[np.float64]) -> str:
    """A row of the table."""
    return f"{name:<34}" + "".join(f"{value:>14.1f}" for value in recall)


@click.command()
@click.option("--seed", "seeds", type=int, multiple=True, default=(0, 1, 2), show_default=True)
@click.option("--chosen-on", is_flag=True, help="Every way to encode vectors, on what settings were chosen on.")
def main(seeds: tuple[int, ...], chosen_on: bool) -> None:
    """Print the table."""
    required("nordland", "gardens")
    try:
        title = f"R@1 in percent, seeds {', '.join(map(str, seeds))}"
        print(f"{title:<34}" + "".join(f"{name:>14}" for name in COLUMNS))
        if chosen_on:
            for name, settings in WAYS.items():
                found = mean_over(CHOSEN_ON, seeds, settings)
                mean = np.mean([one.recall for one in found], axis=0)
                print(line(name, mean), f"{found[0].inputs:>8,} inputs", flush=True)
            return
        found = mean_over(FIVE, seeds, {})
        for section, figures in zip(FIVE, found, strict=True):
            print(line(str(section), figures.recall), flush=True)
        mean = np.mean([one.recall for one in found], axis=0)
        print(line("mean", mean))
        own, cosine = mean[COLUMNS.index("contrast")], mean[COLUMNS.index("vectors")]
        print(f"the network is {own - cosine:+.1f} points from the vectors' own cosine")
    except LavaVprError as error:
        raise SystemExit(f"error: {error}") from None


if __name__ == "__main__":
    main()
