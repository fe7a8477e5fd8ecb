"""The registry of studies, and those of one network: learned again at every point, or once and then quantised again,
decoded by the steps of the paper's weighted decoder, or shown the noise of other seeds."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import compress, product

from lava_vpr.config import Config, integer_config
from lava_vpr.configfile import update
from lava_vpr.deploy.bundle.compression import requantised
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.grid import Outcome
from lava_vpr.experiments.task import FACTS, NETWORK, Route, baselines, counted, judged, judged_scores, learned, measure
from lava_vpr.matching import equations
from lava_vpr.model import decode
from lava_vpr.rows.registry import Registry
from lava_vpr.studies import several
from lava_vpr.studies.study import Point, Study, StudyRequest, StudyTask

SECTIONS = 8
"""A number of places is measured on so many sections of the route at most."""
PLACES = (25, 50, 100, 200, 400)
"""Numbers of places; twice the last, and so on, as far as images go."""


def _place_numbers(asked: StudyRequest) -> list[int]:
    """The numbers of places: those asked for, or `PLACES` and their doubles, and all that there are."""
    whole_route = asked.route.places
    if asked.values:
        numbers = [int(value) for value in asked.values]
        wrong = next((number for number in numbers if not 2 <= number <= whole_route), None)
        if wrong is not None:
            raise ConfigError(
                f"--values: {wrong} places, but there are images of 2 to {whole_route}; choose such numbers"
            )
        return numbers
    numbers = [*PLACES]
    while numbers[-1] < whole_route:
        numbers.append(2 * numbers[-1])
    return [*(number for number in numbers if number < whole_route), whole_route]


def sections(places: int, number: int) -> list[tuple[int, int]]:
    """As many sections of ``number`` places as hold a route of ``places``, at most `SECTIONS`, evenly spread.

    Where they do not come out even, neighbours share places.
    """
    count = min(SECTIONS, -(-places // number))
    starts = [round(k * (places - number) / max(1, count - 1)) for k in range(count)]
    return [(start, start + number) for start in starts]


def place_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """A model of each section, for each number of places."""
    return [
        [Point(f"{number:,}", config, number, part)]
        for number in _place_numbers(asked)
        for part in sections(asked.route.places, number)
    ]


def neuron_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """A model for each number of neurons a place."""
    return [
        [Point(f"{value:g}", update(config, {"network": {"neurons": 0, "neurons_per_place": float(value)}}), value)]
        for value in asked.values or asked.study.values
    ]


def measure_learned(route: Route, task: StudyTask) -> list[Outcome]:
    """Learn the point, and ask it the queries."""
    (point,) = task.points
    model = learned(route, point.config)
    facts = {"neurons": model.neurons, "covered": model.training["places_covered"] / model.places}
    return [point.outcome(task.seed, {**measure(model, route, whole=task.first), FACTS: facts})]


def requantised_points(key: str, asked: StudyRequest, config: Config) -> list[list[Point]]:
    """One learned model, quantised again with every value of the setting ``network.key``."""
    config = integer_config(config, f"the study {asked.study.name}")
    values = asked.values or asked.study.values
    return [[Point("", config), *(Point(f"{v:g}", update(config, {"network": {key: int(v)}}), v) for v in values)]]


def measure_requantised(route: Route, task: StudyTask) -> list[Outcome]:
    """Learn the first point once; quantise what it learned again for the others, and ask each the queries."""
    source, *points = task.points
    model = learned(route, source.config)
    made = ((point, requantised(replace(model, config=point.config))) for point in points)
    return [point.outcome(task.seed, measure(one, route, whole=task.first)) for point, one in made]


BESIDE = ("standard", "contrast")
"""Decoders that the combinations are compared with."""
COMBINATIONS = {
    " + ".join(compress("abc", steps)) or "none": steps for steps in sorted(product((True, False), repeat=3), key=sum)
}
"""Which of involvement (a), strength (b) and penalty (c) each combination takes, by its name: fewest first."""


def weighting_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """One model."""
    return [[Point("", config)]]


def measure_weighting(route: Route, task: StudyTask) -> list[Outcome]:
    """Decode the same spikes by every combination of steps, and by the decoders beside."""
    (point,) = task.points
    model = learned(route, point.config)
    counts, gamma = counted(model, route), point.config.decoder.gamma
    beside = baselines(model, route) if task.first else {}
    made = {
        label: (
            "weighted",
            equations.weighted(model.responses, gamma=gamma, involvement=a, strength=b, penalty=c)(counts),
        )
        for label, (a, b, c) in COMBINATIONS.items()
    }
    made |= {f"decoder {name}": (name, decode(model, counts, name)) for name in BESIDE}
    recalls = {label: judged_scores(*scored, route.truth)._asdict() for label, scored in made.items()}
    return [point.outcome(task.seed, {NETWORK: recall, **beside}, label) for label, recall in recalls.items()]


QUERIES, TRAINING, BOTH = "the same model, other query noise", "other training, the same query noise", "both"


def seed_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """A model, asked with noise of its seed and of the first; the first model, asked with all noise."""
    others = asked.seeds if config.seed == asked.seeds[0] else ()
    noise = [Point(QUERIES, update(config, {"seed": other})) for other in others]
    again = Point(TRAINING, update(config, {"seed": asked.seeds[0]}))
    return [[Point("", config), *noise, again, Point(BOTH, config)]]


def measure_seeds(route: Route, task: StudyTask) -> list[Outcome]:
    """Learn the first point; ask it with the query noise of each of the others."""
    model = learned(route, task.points[0].config)
    beside = baselines(model, route) if task.first else {}
    outcomes = []
    for point in task.points[1:]:
        noise = point.config.seed
        recall = judged(model, counted(model, route, noise), route.truth)
        seed = noise if point.label == QUERIES else task.seed
        outcomes.append(point.outcome(seed, {NETWORK: recall._asdict(), **beside}))
    return outcomes


STUDIES: Registry[Study] = Registry("study", ConfigError)
"""All studies by name."""
for _study in (
    Study(
        "places",
        title="Number of places",
        varied="places",
        values=PLACES,
        points=place_points,
        measure=measure_learned,
        note=f"A model of so many places; where the route has more, the mean of sections that hold all of it, "
        f"up to {SECTIONS}, evenly spread. covered: places that some neuron responds to most.",
    ),
    Study(
        "neurons",
        title="Number of neurons",
        varied="neurons a place",
        values=(0.5, 0.75, 1, 1.5, 2, 3),
        points=neuron_points,
        measure=measure_learned,
        note="Excitatory neurons for each place (network.neurons_per_place), learned again for each number. covered: "
        "places that some neuron responds to most.",
        whole=False,
        costed=True,
    ),
    Study(
        "weighting",
        title="Steps of the weighted decoder",
        varied="steps",
        values=(),
        points=weighting_points,
        measure=measure_weighting,
        note="The paper's weighted decoder, as its code was released, on the same spikes. a: spikes of a neuron that "
        "is involved in more than gamma of the places are divided by how many they are; b: times the share of its "
        "spikes that the place had; c: times the share of the place's spikes that come from neurons which fire now. "
        "All three are the decoder weighted.",
        drawn="rows",
    ),
    Study(
        "bits",
        title="Bits of a weight",
        varied="bits",
        values=(1, 2, 3, 4, 5, 6, 7),
        points=partial(requantised_points, "weight_bits"),
        measure=measure_requantised,
        costed=True,
        note="One learned model for each seed, quantised again; a sign takes a bit more. All else is as the settings "
        "say.",
    ),
    Study(
        "steps",
        title="Steps of a query",
        varied="steps",
        values=(8, 16, 32, 64, 128, 256),
        points=partial(requantised_points, "steps"),
        measure=measure_requantised,
        costed=True,
        note="One learned model for each seed, asked in queries of so many steps, the silent ones included. All else "
        "is as the settings say, so short queries also have fewer input spikes.",
    ),
    Study(
        "seeds",
        title="Noise of seeds",
        varied="what changes with the seed",
        values=(),
        points=seed_points,
        measure=measure_seeds,
        note="How far figures scatter that differ in their seeds alone; the first seed is the one that stays the same.",
        drawn="rows",
    ),
    several.HYPERACTIVE,
    several.ENSEMBLE,
):
    STUDIES.register(_study)
