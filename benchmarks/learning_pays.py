"""Does learning pay? STDP against templates, which learn nothing, where references are not one clean image a place.

    LAVA_VPR_DATA=... python -m benchmarks.learning_pays [--seeds 0,1,2]

Templates are the mean rates of what a place's references show, by their labels; STDP sees no label: a neuron learns
what makes it spike, and the responses to all references label it afterwards. Real scenarios are three Nordland sections
(200:500, which the search did not see), synthetic ones the built-in world in four conditions. ``cosine`` compares a
query's rates with those of every reference, under its label.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import FOLDERS, images_of, required
from benchmarks.results.places import TEMPLATES
from lava_vpr.config import Config, EncoderConfig, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse, activity_of, thumbnail
from lava_vpr.engine.threads import cores
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.inputs.views import View, seen_as
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

Images = list[NDArray[np.uint8]]
PLACES = 100
SECTIONS = (200, 300, 400)
NOISE = 25.0
"""Standard deviation of a noisy reference's pixels, in grey levels."""
HIDDEN = 0.25
"""Share of the width that something hides in a noisy reference."""
MISLABELLED = 0.3
"""Share of the images of each traverse that stand under another place's label."""
SHIFT = 0.142
SPACING = 5.0
"""Metres between places of the synthetic world: closer than its usual ones, so that neighbours look alike."""
SURE = 0.5
"""Share of the answers, the surest ones, that a robot learns from while it drives."""
LEARNERS: dict[str, dict[str, Any]] = {
    "templates": TEMPLATES,
    "STDP": {},
    "STDP, integer": {"arithmetic": "integer"},
}
console = Console(highlight=False, width=120)


class Scenario(NamedTuple):
    """What is learned and asked.

    Attributes:
        references: Traverses, place for place.
        queries: Images of the places, in order.
        tolerance: Places that an answer may be off.
        settings: Settings of STDP's network beside the preset's.
        kept: Every so many places a template is kept (1: all), where there are fewer neurons than places.
    """

    references: list[Images]
    queries: Images
    tolerance: int = 0
    settings: dict[str, Any] = {}  # noqa: RUF012 - never changed
    kept: int = 1


@lru_cache(maxsize=8)
def _nordland(which: int, first: int) -> tuple[NDArray[np.uint8], ...]:
    traverse = open_traverse(images_of("nordland", FOLDERS["nordland"][which]))
    return tuple(traverse.take(range(first, first + PLACES)).images())


@lru_cache(maxsize=16)
def _synthetic(condition: str, seed: int) -> tuple[NDArray[np.uint8], ...]:
    world = World(seed=seed, places=PLACES, spacing_m=SPACING)
    return tuple(render(world, place, condition) for place in range(PLACES))


def encoded(images: Sequence[NDArray[np.uint8]], encoder: EncoderConfig) -> EncodedTraverse:
    """Images in memory, encoded."""
    return EncodedTraverse(
        tuple(f"{k:04d}" for k in range(len(images))),
        np.arange(len(images)),
        np.array([activity_of(image, encoder) for image in images], np.float32),
        np.array([patch_normalised(image) for image in images], np.uint8),
        np.array([thumbnail(image) for image in images], np.uint8),
    )


def noisy(images: Sequence[NDArray[np.uint8]], rng: np.random.Generator) -> Images:
    """Every image with a sensor's noise, and something that hides a part of it."""
    made = []
    for image in images:
        noise = rng.normal(0.0, NOISE, image.shape)
        copy = np.clip(image + noise, 0, 255).astype(np.uint8)
        left = int(rng.uniform(0, (1 - HIDDEN) * image.shape[1]))
        copy[:, left : left + round(HIDDEN * image.shape[1])] = rng.integers(0, 256)
        made.append(copy)
    return made


def mislabelled(images: Sequence[NDArray[np.uint8]], rng: np.random.Generator) -> Images:
    """The images, `MISLABELLED` of them in each other's places."""
    order = np.arange(len(images))
    some = rng.choice(len(images), round(MISLABELLED * len(images)), replace=False)
    order[some] = np.roll(some, 1)
    return [images[k] for k in order]


def shifted(images: Sequence[NDArray[np.uint8]], rng: np.random.Generator) -> Images:
    """Every image from one of three lanes, nobody says which."""
    return [seen_as(image, View(SHIFT * int(rng.integers(-1, 2)))) for image in images]


def _clean(first: int, rng: np.random.Generator) -> Scenario:
    return Scenario([list(_nordland(0, first))], list(_nordland(1, first)))


def _noisy_one(first: int, rng: np.random.Generator) -> Scenario:
    return Scenario([noisy(_nordland(0, first), rng)], list(_nordland(1, first)))


def _noisy_five(first: int, rng: np.random.Generator) -> Scenario:
    return Scenario([noisy(_nordland(0, first), rng) for _ in range(5)], list(_nordland(1, first)))


def _mislabelled_five(first: int, rng: np.random.Generator) -> Scenario:
    return Scenario([mislabelled(_nordland(0, first), rng) for _ in range(5)], list(_nordland(1, first)))


def _lanes(first: int, rng: np.random.Generator) -> Scenario:
    references = [shifted(_nordland(0, first), rng) for _ in range(5)]
    return Scenario(references, shifted(_nordland(1, first), rng))


def _lanes_more_neurons(first: int, rng: np.random.Generator) -> Scenario:
    return _lanes(first, rng)._replace(settings={"network": {"neurons_per_place": 3.0}})


def _fewer(first: int, rng: np.random.Generator) -> Scenario:
    scenario = _clean(first, rng)
    return scenario._replace(tolerance=1, settings={"network": {"neurons_per_place": 0.5}}, kept=2)


def _seasons(first: int, rng: np.random.Generator) -> Scenario:
    references = [list(_synthetic(condition, first)) for condition in ("summer", "rain", "night")]
    return Scenario(references, list(_synthetic("winter", first)))


def _one_season(first: int, rng: np.random.Generator) -> Scenario:
    return Scenario([list(_synthetic("summer", first))], list(_synthetic("winter", first)))


SCENARIOS: dict[str, tuple[Callable[[int, np.random.Generator], Scenario], Sequence[int]]] = {
    "one clean traverse": (_clean, SECTIONS),
    "one noisy traverse, 25 % hidden": (_noisy_one, SECTIONS),
    "five noisy traverses": (_noisy_five, SECTIONS),
    "five traverses, 30 % mislabelled": (_mislabelled_five, SECTIONS),
    "five traverses from three lanes, nobody says which": (_lanes, SECTIONS),
    "the same, STDP with three neurons a place": (_lanes_more_neurons, SECTIONS),
    "half as many neurons as places, within one place": (_fewer, SECTIONS),
    "synthetic: summer learned, winter asked": (_one_season, (0, 1, 2)),
    "synthetic: summer, rain and night learned, winter asked": (_seasons, (0, 1, 2)),
}


def answered(scenario: Scenario, config: Config, template: bool) -> Recognition:
    """What a network makes of a scenario."""
    config = update(config, {} if template else scenario.settings)
    kept = np.arange(0, PLACES, scenario.kept if template else 1)
    references = [encoded([images[k] for k in kept], config.encoder) for images in scenario.references]
    model = train(references, config, jobs=cores())
    truth = np.abs(np.arange(PLACES)[:, None] - kept) <= scenario.tolerance
    queries = encoded(scenario.queries, config.encoder)
    return recognise(model, queries, truth, Comparison(rivals=("cosine",), keep_scores=False), threads=cores())


def _figures(metrics: Sequence[Metrics]) -> str:
    rows = [(m.recall_at_1, m.recall_at_100_precision, m.auc) for m in metrics]
    return " / ".join(f"{100 * value:.1f}" for value in np.mean(rows, axis=0))


def print_scenarios(config: Config, seeds: Sequence[int]) -> None:
    """Print a row for each scenario."""
    table = Table(title="R@1 / R@100P / AUC", title_justify="left")
    for column in ("", *LEARNERS, "cosine of the references"):
        table.add_column(column)
    for title, (make, parts) in SCENARIOS.items():
        found: dict[str, list[Metrics]] = {name: [] for name in (*LEARNERS, "cosine")}
        for part in parts:
            for seed in seeds:
                scenario = make(part, np.random.default_rng((seed, part)))
                for name, learning in LEARNERS.items():
                    settings = update(config, {"learning": learning, "seed": seed})
                    result = answered(scenario, settings, name == "templates")
                    found[name].append(result.metrics[result.default])
                    if name == "STDP":
                        found["cosine"].append(result.metrics["cosine"])
        table.add_row(title, *(_figures(metrics) for metrics in found.values()))
    console.print(table)


def _drives(config: Config, world: int, gated: bool) -> Iterator[tuple[str, Metrics]]:
    """Recall in rain, at night and in winter of what was learned in summer and, if ``gated``, from its own answers."""
    references = [encoded(_synthetic("summer", world), config.encoder)]
    truth = np.eye(PLACES, dtype=bool)
    for condition in ("rain", "night", "winter"):
        model = train(references, config, jobs=cores())
        queries = encoded(_synthetic(condition, world), config.encoder)
        comparison = Comparison(rivals=(), keep_scores=False)
        result = recognise(model, queries, truth, comparison, threads=cores())
        yield condition, result.metrics[result.default]
        if gated:
            references.append(_learned_from(result, queries, references[0]))


def _learned_from(result: Recognition, queries: EncodedTraverse, first: EncodedTraverse) -> EncodedTraverse:
    """The surest of the queries under the places that the network took them for; the first traverse elsewhere."""
    sure = np.argsort(result.confidence, kind="stable")[round((1 - SURE) * len(queries)) :]  # surest last, so it stays
    activity = first.activity.copy()
    for query in sure:
        if result.matches[query] >= 0:
            activity[result.matches[query]] = queries.activity[query]
    return dataclasses.replace(first, activity=activity)


def print_drift(config: Config, seeds: Sequence[int]) -> None:
    """Print what learning from the network's own surest answers brings, drive after drive."""
    table = Table(
        title="synthetic drives one after another, learned in summer: R@1 / R@100P / AUC", title_justify="left"
    )
    for column in ("", "rain", "night", "winter"):
        table.add_column(column)
    for name, learning in LEARNERS.items():
        for gated in (False, True):
            found: dict[str, list[Metrics]] = {}
            for world in seeds:
                settings = update(config, {"learning": learning, "seed": world})
                for condition, metrics in _drives(settings, world, gated):
                    found.setdefault(condition, []).append(metrics)
            title = f"{name}, {'learning from its surest answers' if gated else 'as learned in summer'}"
            table.add_row(title, *(_figures(metrics) for metrics in found.values()))
    console.print(table)


@click.command()
@click.option("--seeds", default="0,1,2", show_default=True, help="Seeds, separated by commas.")
@click.option("--preset", "name", default="loihi", show_default=True)
def main(seeds: str, name: str) -> None:
    """Print where learning beats templates, and where it does not."""
    required("nordland")
    chosen = [int(seed) for seed in seeds.split(",")]
    print_scenarios(preset(name), chosen)
    print_drift(preset(name), chosen)


if __name__ == "__main__":
    main()
