"""Studies that learn anew at every point, or quantise anew what was learned once: places, neurons, bits, steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from lava_vpr.configfile import update
from lava_vpr.deploy.compression.compression import requantised
from lava_vpr.errors import ConfigError
from lava_vpr.gate import integer_config
from lava_vpr.studies.measuring import learned, whole
from lava_vpr.studies.study import Asked, Outcome, Point, Route, Study, Task

SECTIONS = 8
"""A number of places is measured on so many sections of the route at most."""
PLACES = (25, 50, 100, 200, 400)
"""Numbers of places; twice the last, and so on, as far as images go."""


def _place_numbers(asked: Asked) -> list[int]:
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


def place_tasks(asked: Asked) -> list[Task]:
    """A model of each section, for each number of places and each seed."""
    tasks = []
    for number in _place_numbers(asked):
        for seed in asked.seeds:
            point = Point(f"{number:,}", update(asked.config, {"seed": seed}), number)
            tasks += [asked.task([point], seed, part) for part in sections(asked.route.places, number)]
    return tasks


def neuron_tasks(asked: Asked) -> list[Task]:
    """A model for each number of neurons a place and each seed."""
    tasks = []
    for value in asked.values or NEURONS.values:
        for seed in asked.seeds:
            config = update(asked.config, {"seed": seed, "network": {"neurons": 0, "neurons_per_place": float(value)}})
            tasks.append(asked.task([Point(f"{value:g}", config, value)], seed))
    return tasks


def measure_learned(route: Route, task: Task) -> list[Outcome]:
    """Learn each point, and ask it the queries."""
    outcomes = []
    for point in task.points:
        model = learned(route, point.config)
        covered = model.training["places_covered"] / model.places
        outcomes.append(whole(route, task, point, model, neurons=model.neurons, covered=covered))
    return outcomes


def requantised_tasks(key: str, study: str, asked: Asked) -> list[Task]:
    """One learned model for each seed, quantised anew with every value of the setting ``network.key``."""
    tasks = []
    for seed in asked.seeds:
        config = integer_config(update(asked.config, {"seed": seed}), f"the study {study}")
        values = asked.values or BY_SETTING[key].values
        points = [Point(f"{v:g}", update(config, {"network": {key: int(v)}}), v) for v in values]
        tasks.append(asked.task([Point("", config), *points], seed))
    return tasks


def measure_requantised(route: Route, task: Task) -> list[Outcome]:
    """Learn the first point once; quantise what it learned anew for the others, and ask each the queries."""
    source, outcomes = learned(route, task.points[0].config), []
    for point in task.points[1:]:
        model = requantised(replace(source, config=point.config))
        outcomes.append(whole(route, task, point, model))
    return outcomes


PLACES_STUDY = Study(
    "places",
    title="Number of places",
    varied="places",
    values=PLACES,
    tasks=place_tasks,
    measure=measure_learned,
    note=f"A model of so many places; where the route has more, the mean of sections that hold all of it, "
    f"up to {SECTIONS}, evenly spread. covered: places that some neuron responds to most.",
)
NEURONS = Study(
    "neurons",
    title="Number of neurons",
    varied="neurons a place",
    values=(0.5, 0.75, 1, 1.5, 2, 3),
    tasks=neuron_tasks,
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
    tasks=partial(requantised_tasks, "weight_bits", "bits"),
    measure=measure_requantised,
    costed=True,
    note="One learned model for each seed, quantised anew; a sign takes a bit more. All else is as the settings say.",
)
STEPS = Study(
    "steps",
    title="Steps of a query",
    varied="steps",
    values=(8, 16, 32, 64, 128, 256),
    tasks=partial(requantised_tasks, "steps", "steps"),
    measure=measure_requantised,
    costed=True,
    note="One learned model for each seed, asked in queries of so many steps, the silent ones included. All else is as "
    "the settings say, so short queries also have fewer input spikes.",
)
BY_SETTING = {"weight_bits": BITS, "steps": STEPS}
