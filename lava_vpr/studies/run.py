"""A study from its tasks to its table: measured task by task, then put together by point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.grid import Advance, compute, ignored
from lava_vpr.experiments.rows import Outcome, Row, rows
from lava_vpr.experiments.task import Route
from lava_vpr.studies.study import Study, StudyRequest, StudyTask
from lava_vpr.training.loop import check_size

CALLED = "models"
"""What tasks are called, for people: each learns a model, and asks it all that is asked of it."""


@dataclass(frozen=True)
class Studied:
    """What a study found.

    Attributes:
        study: The study.
        asked: What it was asked.
        rows: The points in order.
        command: How to repeat it.
    """

    study: Study
    asked: StudyRequest
    rows: tuple[Row, ...]
    command: str = ""


def measured(shared: tuple[Route, Callable[[Route, StudyTask], list[Outcome]]], task: StudyTask) -> list[Outcome]:
    """The outcomes of a task, wherever it is run; ``shared`` are the whole route and the study's own function."""
    route, measure = shared
    section = task.points[0].section
    return measure(route if section is None else route.section(*section), task)


def run(
    study: Study,
    asked: StudyRequest,
    *,
    pool: Pool = ONE_THREAD,
    command: str = "",
    advance: Advance = ignored,
) -> Studied:
    """Measure every point of ``study`` with every seed.

    Args:
        study: The study.
        asked: What it is asked.
        pool: Who measures, a thread one task at a time; it changes no figure.
        command: How to repeat it, for the page.
        advance: Called for every task that is done.
    Raises:
        LavaVprError: values that the study does not take, settings that cannot be learned, images that do not fit, or
            the cluster was lost.
    """
    tasks, shared = planned(study, asked), (asked.route, study.measure)
    found = compute(measured, tasks, shared=shared, called=CALLED, pool=pool, advance=advance)
    return Studied(study, asked, rows(outcome for some in found.values() for outcome in some), command)


def planned(study: Study, asked: StudyRequest) -> list[StudyTask]:
    """The tasks of ``study``, each seen to be one that can be learned.

    Raises:
        ConfigError: values that the study does not take, or settings that cannot be learned.
        NetworkLimitError: integer learning that could overflow.
    """
    if asked.values and not study.values:
        raise ConfigError(f"the study {study.name} takes no --values: its points are no numbers; leave them out")
    wrong = next((value for value in asked.values if study.whole and not float(value).is_integer()), None)
    if wrong is not None:
        raise ConfigError(f"--values: {wrong:g} is no whole number, as the study {study.name} takes; correct it")
    tasks = [
        StudyTask(tuple(points), seed, seed == asked.seeds[0])
        for seed in asked.seeds
        for points in study.points(asked, update(asked.config, {"seed": seed}))
    ]
    traverses = len(asked.route.references) // len(asked.config.views.views)
    whole = (0, asked.route.places)
    for (first, end), config in {(point.section or whole, point.config): None for task in tasks for point in task[0]}:
        check_size(end - first, config, traverses)
    return tasks
