"""Studies that learn anew at every point, or quantise anew what was learned once: places, neurons, bits, steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from lava_vpr.config import Config
from lava_vpr.configfile import update
from lava_vpr.deploy.compression.compression import requantised
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.rows import Outcome
from lava_vpr.experiments.task import FACTS, Route, learned, measure
from lava_vpr.gate import integer_config
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
        for value in asked.values or NEURONS.values
    ]


def measure_learned(route: Route, task: StudyTask) -> list[Outcome]:
    """Learn the point, and ask it the queries."""
    (point,) = task.points
    model = learned(route, point.config)
    facts = {"neurons": model.neurons, "covered": model.training["places_covered"] / model.places}
    return [point.outcome(task.seed, {**measure(model, route, whole=task.first), FACTS: facts})]


def requantised_points(key: str, study: str, asked: StudyRequest, config: Config) -> list[list[Point]]:
    """One learned model, quantised anew with every value of the setting ``network.key``."""
    config = integer_config(config, f"the study {study}")
    values = asked.values or BY_SETTING[key].values
    return [[Point("", config), *(Point(f"{v:g}", update(config, {"network": {key: int(v)}}), v) for v in values)]]


def measure_requantised(route: Route, task: StudyTask) -> list[Outcome]:
    """Learn the first point once; quantise what it learned anew for the others, and ask each the queries."""
    source, *points = task.points
    model = learned(route, source.config)
    made = ((point, requantised(replace(model, config=point.config))) for point in points)
    return [point.outcome(task.seed, measure(one, route, whole=task.first)) for point, one in made]


PLACES_STUDY = Study(
    "places",
    title="Number of places",
    varied="places",
    values=PLACES,
    points=place_points,
    measure=measure_learned,
    note=f"A model of so many places; where the route has more, the mean of sections that hold all of it, "
    f"up to {SECTIONS}, evenly spread. covered: places that some neuron responds to most.",
)
NEURONS = Study(
    "neurons",
    title="Number of neurons",
    varied="neurons a place",
    values=(0.5, 0.75, 1, 1.5, 2, 3),
    points=neuron_points,
    measure=measure_learned,
    note="Excitatory neurons for each place (network.neurons_per_place), learned anew for each number. covered: places "
    "that some neuron responds to most.",
    whole=False,
    costed=True,
)
BITS = Study(
    "bits",
    title="Bits of a weight",
    varied="bits",
    values=(1, 2, 3, 4, 5, 6, 7),
    points=partial(requantised_points, "weight_bits", "bits"),
    measure=measure_requantised,
    costed=True,
    note="One learned model for each seed, quantised anew; a sign takes a bit more. All else is as the settings say.",
)
STEPS = Study(
    "steps",
    title="Steps of a query",
    varied="steps",
    values=(8, 16, 32, 64, 128, 256),
    points=partial(requantised_points, "steps", "steps"),
    measure=measure_requantised,
    costed=True,
    note="One learned model for each seed, asked in queries of so many steps, the silent ones included. All else is as "
    "the settings say, so short queries also have fewer input spikes.",
)
BY_SETTING = {"weight_bits": BITS, "steps": STEPS}
