"""Studies of one learned model: the steps of the paper's weighted decoder, and the noise of seeds."""

from __future__ import annotations

from itertools import product

from lava_vpr.config import Config
from lava_vpr.configfile import update
from lava_vpr.experiments.rows import Outcome
from lava_vpr.experiments.task import NETWORK, Route, baselines, counted, judged, judged_scores, learned
from lava_vpr.matching import equations
from lava_vpr.model import decode
from lava_vpr.studies.study import Point, Study, StudyRequest, StudyTask

STEPS = ("a", "b", "c")
"""Involvement, strength and penalty, as `equations.weighted` takes them."""
BESIDE = ("standard", "contrast")
"""Decoders that stand beside the combinations."""


def _combination(steps: tuple[bool, ...]) -> str:
    """What a table calls a combination of steps."""
    used = [step for step, on in zip(STEPS, steps, strict=True) if on]
    return " + ".join(used) or "none"


COMBINATIONS = {_combination(steps): steps for steps in sorted(product((True, False), repeat=3), key=sum)}
"""Which of the three steps each combination takes, by its name: fewest first."""


def weighting_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """One model."""
    return [[Point("", config)]]


def measure_weighting(route: Route, task: StudyTask) -> list[Outcome]:
    """Decode the same spikes by every combination of steps, and by the decoders beside."""
    (point,) = task.points
    model = learned(route, point.config)
    counts, gamma = counted(model, route), point.config.decoder.gamma
    beside = baselines(model, route) if task.first else {}
    found = []
    for label, (involvement, strength, penalty) in COMBINATIONS.items():
        scores_of = equations.weighted(
            model.responses, gamma=gamma, involvement=involvement, strength=strength, penalty=penalty
        )
        found.append((label, judged_scores("weighted", scores_of(counts), route.truth)))
    for name in BESIDE:
        found.append((f"decoder {name}", judged_scores(name, decode(model, counts, name), route.truth)))
    return [point.outcome(task.seed, {NETWORK: recall._asdict(), **beside}, label) for label, recall in found]


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


WEIGHTING = Study(
    "weighting",
    title="Steps of the weighted decoder",
    varied="steps",
    values=(),
    points=weighting_points,
    measure=measure_weighting,
    note="The paper's weighted decoder, as its code was released, on the same spikes. a: spikes of a neuron that is "
    "involved in more than gamma of the places are divided by how many they are; b: times the share of its spikes "
    "that the place had; c: times the share of the place's spikes that come from neurons which fire now. All three "
    "are the decoder weighted.",
    drawn="rows",
)
SEEDS = Study(
    "seeds",
    title="Noise of seeds",
    varied="what changes with the seed",
    values=(),
    points=seed_points,
    measure=measure_seeds,
    note="How far figures scatter that differ in their seeds alone; the first seed is the one that stays the same.",
    drawn="rows",
)
