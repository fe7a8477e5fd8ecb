"""Studies of one learned model: the steps of the paper's weighted decoder, and the noise of seeds."""

from __future__ import annotations

from itertools import product

from lava_vpr.configfile import update
from lava_vpr.matching import equations
from lava_vpr.model import decode
from lava_vpr.studies.measuring import baselines, counted, judged, judged_scores, learned
from lava_vpr.studies.study import Asked, Outcome, Point, Route, Study, Task

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


def weighting_tasks(asked: Asked) -> list[Task]:
    """One model for each seed."""
    return [asked.task([Point("", update(asked.config, {"seed": seed}))], seed) for seed in asked.seeds]


def measure_weighting(route: Route, task: Task) -> list[Outcome]:
    """Decode the same spikes by every combination of steps, and by the decoders beside."""
    config = task.points[0].config
    model = learned(route, config)
    counts = counted(model, route)
    beside = baselines(model, route) if task.first else {}
    found = []
    for label, (involvement, strength, penalty) in COMBINATIONS.items():
        scores_of = equations.weighted(
            model.responses,
            gamma=config.decoder.gamma,
            involvement=involvement,
            strength=strength,
            penalty=penalty,
        )
        found.append((label, judged_scores("weighted", scores_of(counts), route.truth)))
    for name in BESIDE:
        found.append((f"decoder {name}", judged_scores(name, decode(model, counts, name), route.truth)))
    return [Outcome(label, None, task.seed, recall, beside) for label, recall in found]


QUERIES, TRAINING, BOTH = "the same model, other query noise", "other training, the same query noise", "both"


def seed_tasks(asked: Asked) -> list[Task]:
    """For each seed a model, asked with noise of that seed and of the first; the first model, asked with all noise."""
    tasks = []
    for seed in asked.seeds:
        config = update(asked.config, {"seed": seed})
        noise = [Point(QUERIES, update(asked.config, {"seed": other})) for other in asked.seeds]
        others = noise if seed == asked.seeds[0] else []
        again = Point(TRAINING, update(asked.config, {"seed": asked.seeds[0]}))
        tasks.append(asked.task([Point("", config), *others, again, Point(BOTH, config)], seed))
    return tasks


def measure_seeds(route: Route, task: Task) -> list[Outcome]:
    """Learn the first point; ask it with the query noise of each of the others."""
    model = learned(route, task.points[0].config)
    beside = baselines(model, route) if task.first else {}
    outcomes = []
    for point in task.points[1:]:
        noise = point.config.seed
        recall = judged(model, counted(model, route, noise), route.truth)
        outcomes.append(Outcome(point.label, None, noise if point.label == QUERIES else task.seed, recall, beside))
    return outcomes


WEIGHTING = Study(
    "weighting",
    title="Steps of the weighted decoder",
    varied="steps",
    values=(),
    tasks=weighting_tasks,
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
    tasks=seed_tasks,
    measure=measure_seeds,
    note="How far figures scatter that differ in their seeds alone; the first seed is the one that stays the same.",
    drawn="rows",
)
