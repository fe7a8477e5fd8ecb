"""What a study is made of: points that are measured for each seed, and the row that tells the rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from lava_vpr.config import Config
from lava_vpr.experiments.rows import Figures, Outcome
from lava_vpr.experiments.task import Route


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
        first: Whether what does not depend on the seed is measured, too: baselines and modelled costs.
    """

    points: tuple[Point, ...]
    seed: int
    first: bool


@dataclass(frozen=True)
class StudyRequest:
    """What a study is asked.

    Attributes:
        route: The places.
        config: Settings; the seed is replaced.
        seeds: Seeds, each once.
        values: Points of the study; empty: those of its row.
    """

    route: Route = field(repr=False)
    config: Config = field(repr=False)
    seeds: tuple[int, ...]
    values: tuple[float, ...] = ()


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
