"""Does learning pay? STDP against what learns nothing, where references are not one clean image a place.

    LAVA_VPR_DATA=... python -m benchmarks learning_pays [--seeds 0,1,2] [--record]

Templates are the mean rates of what a place's references show, by their labels; a medoid is the one of these images
that is most like the others. STDP sees no label: a neuron learns what makes it spike, and the responses to all
references label it afterwards. Real scenarios are three Nordland sections (200:500, which the search did not see),
synthetic ones the built-in world in four conditions. ``cosine`` compares a query's rates with those of every reference,
under its label, or of the medoids. No neuron is recruited.

Nordland is here in two seasons, of which one is asked. So several traverses of it are made of the summer's images.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.places import ALL_CORES, FOLDERS, TEMPLATES, images_of
from benchmarks.program import BenchmarkTable, Printed, program, recall, seeds_option
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse, Keep, encode_arrays
from lava_vpr.experiments.grid import compute
from lava_vpr.inputs.views import View, seen_as
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.recognition import DECODERS_ONLY, Comparison, Recognition, recognise
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

Image = NDArray[np.uint8]
Random = np.random.Generator
PLACES = 100
SECTIONS = (200, 300, 400)
WORLDS = (0, 1, 2)
NOISE = 25.0
"""Standard deviation of a noisy reference's pixels, in grey levels."""
HIDDEN = 0.25
"""Share of the width that something hides in a noisy reference."""
RETAKEN = (0.05, 10.0)
"""Another traverse made of one: the most that an image is shifted to a side, in widths of it, and the standard
deviation of its pixels' noise, in grey levels."""
MISLABELLED = 0.3
"""Share of the images of each traverse that stand under another place's label."""
SHIFT = 0.142
SPACING = 5.0
"""Metres between places of the synthetic world: closer than its usual ones, so that neighbours look alike."""
SURE = 0.5
"""Share of the answers, the surest ones, that a robot learns from while it drives."""
LEARNERS: Mapping[str, Mapping[str, Any]] = {
    "templates": TEMPLATES,
    "medoids": TEMPLATES,
    "STDP": {"recruit": False},
    "STDP in integers": {"recruit": False, "arithmetic": "integer"},
}
COSINES = {"STDP": "`cosine`", "medoids": "`cosine` of medoids"}
"""The columns of cosine, by the network beside which it is computed, with the same references."""
COLUMNS = (*LEARNERS, *COSINES.values())


class Scenario(NamedTuple):
    """What is learned and asked.

    Attributes:
        references: Traverses, place for place.
        queries: Images of the places, in order.
        tolerance: Places that an answer may be off.
        neurons: STDP's neurons for each place.
        kept: Every so many places a template is kept (1: all), where there are fewer neurons than places.
        rivals: Whether templates and cosine differ from those of the scenario before.
    """

    references: Sequence[Sequence[Image]]
    queries: Sequence[Image]
    tolerance: int = 0
    neurons: float = 1.0
    kept: int = 1
    rivals: bool = True


@lru_cache(maxsize=8)
def nordland(which: int, first: int) -> tuple[Image, ...]:
    """Summer (0) or winter (1) images of the places from ``first`` on."""
    traverse = open_traverse(images_of("nordland", FOLDERS["nordland"][which]))
    return tuple(traverse.take(range(first, first + PLACES)).images())


@lru_cache(maxsize=16)
def synthetic(condition: str, seed: int) -> tuple[Image, ...]:
    """Images of a synthetic world in a condition."""
    world = World(seed=seed, places=PLACES, spacing_m=SPACING)
    return tuple(render(world, place, condition) for place in range(PLACES))


def encoded(images: Sequence[Image], config: Config) -> EncodedTraverse:
    """Images in memory, encoded."""
    return encode_arrays(images, config.encoder, keep=Keep.ALL)[0]


def grainy(image: Image, deviation: float, rng: Random) -> Image:
    """An image with a sensor's noise, in grey levels."""
    return np.clip(image + rng.normal(0.0, deviation, image.shape), 0, 255).astype(np.uint8)


def noisy(images: Sequence[Image], rng: Random) -> list[Image]:
    """Every image with a sensor's noise, and something that hides a part of it."""
    made = []
    for image in images:
        copy = grainy(image, NOISE, rng)
        left = int(rng.uniform(0, (1 - HIDDEN) * image.shape[1]))
        copy[:, left : left + round(HIDDEN * image.shape[1])] = rng.integers(0, 256)
        made.append(copy)
    return made


def mislabelled(images: Sequence[Image], rng: Random) -> list[Image]:
    """The images, `MISLABELLED` of them in each other's places."""
    order = np.arange(len(images))
    some = rng.choice(len(images), round(MISLABELLED * len(images)), replace=False)
    order[some] = np.roll(some, 1)
    return [images[k] for k in order]


def retaken(images: Sequence[Image], rng: Random) -> list[Image]:
    """Another traverse made of one by the rule `RETAKEN`, and `MISLABELLED` of it in each other's places."""
    shift, noise = RETAKEN
    made = [grainy(seen_as(image, View(rng.uniform(-shift, shift))), noise, rng) for image in images]
    return mislabelled(made, rng)


def shifted(images: Sequence[Image], rng: Random) -> list[Image]:
    """Every image from one of three lanes, nobody says which."""
    return [seen_as(image, View(SHIFT * int(rng.integers(-1, 2)))) for image in images]


def altered(first: int, rng: Random, alter: Callable[[Sequence[Image], Random], list[Image]], times: int) -> Scenario:
    """So many traverses of a section, each altered; the queries as they are."""
    return Scenario([alter(nordland(0, first), rng) for _ in range(times)], nordland(1, first))


def lanes(first: int, rng: Random) -> Scenario:
    """Five traverses and a query, each image from one of three lanes."""
    made = altered(first, rng, shifted, 5)
    return made._replace(queries=shifted(made.queries, rng))


def seasons(world: int, *conditions: str) -> Scenario:
    """A synthetic world, learned in some conditions and asked in winter."""
    return Scenario([synthetic(condition, world) for condition in conditions], synthetic("winter", world))


def wrongly(scenario: Scenario, rng: Random) -> Scenario:
    """A scenario of which `MISLABELLED` of each traverse stands under a wrong label."""
    return scenario._replace(references=[mislabelled(images, rng) for images in scenario.references])


SCENARIOS: Mapping[str, tuple[Callable[[int, Random], Scenario], Sequence[int]]] = {
    "one clean traverse": (
        lambda first, rng: Scenario([nordland(0, first)], nordland(1, first)),
        SECTIONS,
    ),
    "one traverse, pixel noise of 25 grey levels, a quarter of each image hidden": (
        lambda first, rng: altered(first, rng, noisy, 1),
        SECTIONS,
    ),
    "five such traverses": (lambda first, rng: altered(first, rng, noisy, 5), SECTIONS),
    "the same traverse five times, each time 30 % of it under a wrong label": (
        lambda first, rng: altered(first, rng, mislabelled, 5),
        SECTIONS,
    ),
    "five traverses made of one (images shifted by up to 5 %, pixel noise of 10), 30 % of each under a wrong label": (
        lambda first, rng: altered(first, rng, retaken, 5),
        SECTIONS,
    ),
    "five traverses, each image from one of three lanes, nobody says which": (lanes, SECTIONS),
    "the same, STDP with three neurons a place": (
        lambda first, rng: lanes(first, rng)._replace(neurons=3.0, rivals=False),
        SECTIONS,
    ),
    "half as many neurons as places, within one place (templates: of every second place)": (
        lambda first, rng: Scenario([nordland(0, first)], nordland(1, first), tolerance=1, neurons=0.5, kept=2),
        SECTIONS,
    ),
    "synthetic: summer, rain and night learned, 30 % of each under a wrong label, queried in winter": (
        lambda world, rng: wrongly(seasons(world, "summer", "rain", "night"), rng),
        WORLDS,
    ),
    "synthetic: learned in summer, queried in winter": (lambda world, rng: seasons(world, "summer"), WORLDS),
    "synthetic: summer, rain and night learned, queried in winter": (
        lambda world, rng: seasons(world, "summer", "rain", "night"),
        WORLDS,
    ),
}


def medoids(references: Sequence[EncodedTraverse]) -> list[EncodedTraverse]:
    """One traverse, of each place the reference whose responses have the largest cosines with the others' of it."""
    activity = np.stack([one.activity for one in references], axis=1)
    unit = activity / np.maximum(np.linalg.norm(activity, axis=2, keepdims=True), 1e-12)
    central = np.argmax(np.einsum("pti,psi->pt", unit, unit), axis=1)
    return [dataclasses.replace(references[0], activity=activity[np.arange(len(central)), central])]


def answered(scenario: Scenario, config: Config, name: str) -> Recognition:
    """What a network of a way to learn makes of a scenario."""
    template = LEARNERS[name] is TEMPLATES
    config = config if template else update(config, {"network": {"neurons_per_place": scenario.neurons}})
    kept = np.arange(0, PLACES, scenario.kept if template else 1)
    references = [encoded([images[k] for k in kept], config) for images in scenario.references]
    model = train(medoids(references) if name == "medoids" else references, config, pool=ALL_CORES)
    truth = np.abs(np.arange(PLACES)[:, None] - kept) <= scenario.tolerance
    comparison = Comparison(rivals=("cosine",), keep_scores=False)
    return recognise(model, encoded(scenario.queries, config), truth, comparison, pool=ALL_CORES)


def reached(make: Callable[[int, Random], Scenario], point: tuple[int, int]) -> dict[str, Metrics]:
    """What each way to learn reaches in a scenario of a part with a seed, and cosine, as far as that is shown."""
    part, seed = point
    scenario, found = make(part, np.random.default_rng((seed, part))), {}
    several = len(scenario.references) > 1
    for name, learning in LEARNERS.items():
        if (scenario.rivals or learning is not TEMPLATES) and (several or name != "medoids"):
            settings = update(preset("loihi"), {"learning": dict(learning), "seed": seed})
            result = answered(scenario, settings, name)
            found[name] = result.metrics[result.default]
            if scenario.rivals and name in COSINES:
                found[COSINES[name]] = result.metrics["cosine"]
    return found


def compared(make: Callable[[int, Random], Scenario], parts: Sequence[int], seeds: Sequence[int]) -> list[str]:
    """The cells of a scenario: of each way to learn, and of cosine."""
    found = list(compute(reached, list(product(parts, seeds)), shared=make).values())
    return [recall([one[name] for one in found]) if name in found[0] else "" for name in COLUMNS]


def drives(config: Config, world: int, name: str, gated: bool) -> Iterator[Metrics]:
    """Recall in rain, at night and in winter of what was learned in summer and, if ``gated``, from its own answers."""
    references = [encoded(synthetic("summer", world), config)]
    for condition in ("rain", "night", "winter"):
        model = train(medoids(references) if name == "medoids" else references, config, pool=ALL_CORES)
        queries = encoded(synthetic(condition, world), config)
        result = recognise(model, queries, np.eye(PLACES, dtype=bool), DECODERS_ONLY, pool=ALL_CORES)
        yield result.metrics[result.default]
        if gated:
            references.append(learned_from(result, queries, references[0]))


def learned_from(result: Recognition, queries: EncodedTraverse, first: EncodedTraverse) -> EncodedTraverse:
    """The surest of the queries under the places that the network took them for; the first traverse elsewhere."""
    sure = np.argsort(result.confidence, kind="stable")[round((1 - SURE) * len(queries)) :]  # surest last, so it stays
    activity = first.activity.copy()
    for query in sure:
        if result.matches[query] >= 0:
            activity[result.matches[query]] = queries.activity[query]
    return dataclasses.replace(first, activity=activity)


def drifted(gated: bool, seeds: Sequence[int]) -> list[str]:
    """The cells of drives one after another, of the last one, in winter."""
    cells = []
    for name, learning in LEARNERS.items():
        each = (update(preset("loihi"), {"learning": dict(learning), "seed": seed}) for seed in seeds)
        shown = gated or name != "medoids"
        cells.append(recall([list(drives(config, config.seed, name, gated))[-1] for config in each]) if shown else "")
    return [*cells, "", ""]


@program("nordland")
@seeds_option
def main(seeds: Sequence[int]) -> Printed:
    """Print where learning beats templates, and where it does not: R@1 / R@100P / AUC in percent."""
    rows = [[title, *compared(make, parts, seeds)] for title, (make, parts) in SCENARIOS.items()]
    title = "synthetic drives in rain, at night, in winter: winter, as learned in summer"
    rows.append([title, *drifted(False, seeds)])
    rows.append(["the same, learning from the surest half of its answers after each drive", *drifted(True, seeds)])
    yield BenchmarkTable(["references", *COLUMNS], rows, record="learning-pays")
