"""A study from its tasks to its table: measured task by task, then put together by point."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from lava_vpr.cluster.tasks import Cluster, Told, run_tasks
from lava_vpr.config import Config
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.spread import Spread, mean_of
from lava_vpr.matching.figures import Recall
from lava_vpr.studies.study import Asked, Costs, Outcome, Route, Study, Task
from lava_vpr.training.loop import check_size

CALLED = "models"
"""What tasks are called, for people: each learns a model, and asks it all that is asked of it."""


@dataclass(frozen=True)
class Row:
    """A point of a study over all seeds.

    Attributes:
        point: Its label.
        value: Its place on an axis; None: it has none.
        network: R@1, R@100P and AUC of the network.
        baselines: Figures of baselines, by name.
        costs: Modelled costs; None: not modelled, or the board cannot run it.
        facts: Further figures by name.
    """

    point: str
    value: float | None
    network: dict[str, Spread]
    baselines: dict[str, Recall]
    costs: Costs | None
    facts: dict[str, Spread]


@dataclass(frozen=True)
class Studied:
    """What a study found.

    Attributes:
        study: The study.
        places, queries: Numbers of the route.
        seeds: The seeds.
        config: Settings; each seed took the place of theirs.
        rows: The points in order.
        command: How to repeat it.
    """

    study: Study
    places: int
    queries: int
    seeds: tuple[int, ...]
    config: Config = field(repr=False)
    rows: tuple[Row, ...]
    command: str = ""


class Shared(NamedTuple):
    """What every task of a study takes.

    Attributes:
        route: The whole route.
        measure: The study's own function.
    """

    route: Route
    measure: Callable[[Route, Task], list[Outcome]]


def measured(shared: Shared, task: Task) -> list[Outcome]:
    """The outcomes of a task, wherever it is run."""
    return shared.measure(task.route_of(shared.route), task)


def run(
    study: Study,
    asked: Asked,
    *,
    jobs: int = 1,
    cluster: Cluster | None = None,
    command: str = "",
    progress: Told | None = None,
) -> Studied:
    """Measure every point of ``study`` with every seed.

    Args:
        study: The study.
        asked: What it is asked.
        jobs: Threads, each at one task; they change no figure.
        cluster: Whose workers measure instead.
        command: How to repeat it, for the page.
        progress: Told where tasks stand.
    Raises:
        LavaVprError: values that the study does not take, settings that cannot be learned, images that do not fit, or
            the cluster was lost.
    """
    tasks, shared = planned(study, asked), Shared(asked.route, study.measure)
    outcomes = run_tasks(measured, tasks, shared=shared, cluster=cluster, jobs=jobs, called=CALLED, progress=progress)
    found = rows([outcome for some in outcomes for outcome in some])
    route = asked.route
    return Studied(study, route.places, len(route.queries), asked.seeds, asked.config, found, command)


def planned(study: Study, asked: Asked) -> Sequence[Task]:
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
    tasks = study.tasks(asked)
    traverses = len(asked.route.references) // len(asked.config.views.views)
    whole = (0, asked.route.places)
    for (first, end), config in {
        (task.section or whole, point.config): None for task in tasks for point in task.points
    }:
        check_size(end - first, config, traverses)
    return tasks


def rows(outcomes: Iterable[Outcome]) -> tuple[Row, ...]:
    """Outcomes by point, in the order of their first; of one point and seed the mean is taken."""
    by_point: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_point.setdefault(outcome.point, []).append(outcome)
    return tuple(_row(point, some) for point, some in by_point.items())


def _row(point: str, some: Sequence[Outcome]) -> Row:
    """The row of the outcomes of one point."""
    network = {name: Spread.over([(one.seed, getattr(one.network, name)) for one in some]) for name in Recall._fields}
    names = dict.fromkeys(name for one in some for name in one.baselines)
    baselines = {name: _means(Recall, [one.baselines[name] for one in some if name in one.baselines]) for name in names}
    costs = [one.costs for one in some if one.costs is not None]
    facts = {
        name: Spread.over([(one.seed, one.facts[name]) for one in some if name in one.facts])
        for name in dict.fromkeys(name for one in some for name in one.facts)
    }
    return Row(point, some[0].value, network, baselines, _means(Costs, costs) if costs else None, facts)


def _means(kind: Any, values: Sequence[Any]) -> Any:
    """The means of each figure of ``values``, at least one, as a ``kind``."""
    return kind(*(mean_of(figures) for figures in zip(*values, strict=True)))
