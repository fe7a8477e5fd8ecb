"""What a study is, from its points, which are measured for each seed, to its rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.grid import Advance, Figures, Outcome, Row, compute, ignored, rows
from lava_vpr.experiments.task import Route
from lava_vpr.training.loop import check_size


class Point(NamedTuple):
    """What is measured.

    Attributes:
        label: What tables call it.
        config: Settings, the seed included.
        value: Its place on the axis of a plot; None: it has none.
        section: The places ``(A, B)`` of the route that it is about; None: all.
    """

    label: str
    config: Config
    value: float | None = None
    section: tuple[int, int] | None = None

    def outcome(self, seed: int, figures: Figures, label: str | None = None) -> Outcome:
        """What was measured of it, or of a row of its own."""
        return Outcome(self.label if label is None else label, self.value, seed, figures)


class StudyTask(NamedTuple):
    """Points that are measured together, since they share what was learned: plain values, for any process.

    Attributes:
        points: What is measured, at least one point, all on the same section.
        seed: The seed that the figures are counted under.
        first: Whether to measure what no seed changes, too: baselines and modelled costs.
    """

    points: tuple[Point, ...]
    seed: int
    first: bool


@dataclass(frozen=True)
class Study:
    """A study as users choose it.

    Attributes:
        name: How the command line calls it.
        title: What it is about, for people.
        varied: The heading of what is varied.
        values: The points that are measured unless others are asked for; empty: they are not a matter of numbers.
        points: With the settings of a seed, the points of each task, in the order of the table.
        measure: Measures a task on its part of the route; a function of a module, so that any process can be given it.
        note: What is to be known about the figures.
        drawn: ``curve``: points along an axis; ``rows``: one below the other.
        whole: Whether values are whole numbers.
        costed: Whether recall is drawn against modelled costs.
    """

    name: str
    title: str
    varied: str
    values: tuple[float, ...]
    points: Callable[[StudyRequest, Config], Sequence[Sequence[Point]]]
    measure: Callable[[Route, StudyTask], list[Outcome]]
    note: str
    drawn: Literal["curve", "rows"] = "curve"
    whole: bool = True
    costed: bool = False


@dataclass(frozen=True)
class StudyRequest:
    """What a study is to find.

    Attributes:
        study: The study.
        route: The places.
        config: Settings; the seed is replaced.
        seeds: Seeds, each once.
        values: Points of the study; empty: those of its row.
        tolerance: Places that a correct match may be off, in the ground truth of ``route``.
    """

    study: Study
    route: Route = field(repr=False)
    config: Config = field(repr=False)
    seeds: tuple[int, ...]
    values: tuple[float, ...] = ()
    tolerance: int = 0


def measure_task(shared: tuple[Route, Callable[[Route, StudyTask], list[Outcome]]], task: StudyTask) -> list[Outcome]:
    """The outcomes of a task, wherever it is run; ``shared`` are the whole route and the study's own function."""
    route, measure = shared
    section = task.points[0].section
    return measure(route if section is None else route.section(*section), task)


def study_rows(asked: StudyRequest, *, pool: Pool = ONE_THREAD, advance: Advance = ignored) -> tuple[Row, ...]:
    """Measure every point of a study with every seed: the points in order.

    Args:
        asked: What it is to find.
        pool: Who measures, a thread one task at a time; it changes no figure.
        advance: Called for every task that is done.
    Raises:
        LavaVprError: values that the study does not take, settings that cannot be learned, images that do not fit, or
            the cluster was lost.
    """
    shared = (asked.route, asked.study.measure)
    found = compute(measure_task, planned(asked), shared=shared, called="models", pool=pool, advance=advance)
    return rows(outcome for some in found.values() for outcome in some)


def planned(asked: StudyRequest) -> list[StudyTask]:
    """The tasks of a study, each seen to be one that can be learned.

    Raises:
        ConfigError: values that the study does not take, or settings that cannot be learned.
        NetworkLimitError: integer learning that could overflow.
    """
    study = asked.study
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
