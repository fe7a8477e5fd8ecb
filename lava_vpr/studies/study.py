"""What a study is made of: a route, points on it that are measured for each seed, and the row that tells the rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.inputs.encoded import EncodedTraverse
from lava_vpr.inputs.vectors import Standard
from lava_vpr.matching.figures import Recall


@dataclass(frozen=True)
class Route:
    """Places, as they are learned and asked.

    Attributes:
        references: Traverses of the places, each in all views of the settings, view after view.
        queries: The queries; query i shows place i.
        truth: Which places are correct for each query, bool (queries, places).
        standard: What vectors were measured by when they were encoded; None of images.
    """

    references: tuple[EncodedTraverse, ...] = field(repr=False)
    queries: EncodedTraverse = field(repr=False)
    truth: NDArray[np.bool_] = field(repr=False)
    standard: Standard | None = field(default=None, repr=False)

    @property
    def places(self) -> int:
        """The number of places."""
        return len(self.references[0])

    def section(self, first: int, end: int) -> Route:
        """The places ``first`` .. ``end`` - 1 and their queries, as a route of their own."""
        part = slice(first, end)
        references = tuple(reference.take(part) for reference in self.references)
        return replace(self, references=references, queries=self.queries.take(part), truth=self.truth[part, part])

    def shuffled(self, order: NDArray[np.int64]) -> Route:
        """The same route learned in another order: its k-th place is place ``order[k]``; queries stay as they are."""
        references = tuple(reference.take(order) for reference in self.references)
        return replace(self, references=references, truth=self.truth[:, order])


@dataclass(frozen=True)
class Point:
    """What is measured.

    Attributes:
        label: What tables call it.
        config: Settings, the seed included.
        value: Its place on the axis of a plot; None: it has none.
    """

    label: str
    config: Config = field(repr=False)
    value: float | None = None


@dataclass(frozen=True)
class Task:
    """Some points that are measured together, since they share what was learned: plain values, for any process.

    Attributes:
        points: What is measured, at least one point.
        seed: The seed that the figures are counted under.
        first: Whether what does not depend on the seed is measured, too: baselines and modelled costs.
        section: The places ``(A, B)`` of the route that it is about; None: all.
    """

    points: tuple[Point, ...]
    seed: int
    first: bool
    section: tuple[int, int] | None = None

    def route_of(self, whole: Route) -> Route:
        """The part of the ``whole`` route that it is about."""
        return whole if self.section is None else whole.section(*self.section)


class Costs(NamedTuple):
    """What a query costs on the board, modelled with nominal constants.

    Attributes:
        microjoules: Dynamic energy, clearing of states included, host I/O not.
        milliseconds: Time on the chip, the same.
    """

    microjoules: float
    milliseconds: float


@dataclass(frozen=True)
class Outcome:
    """What was measured of a point with one seed.

    Attributes:
        point: The point's label.
        value: The point's value.
        seed: The seed.
        network: Figures of the network.
        baselines: Those of baselines on the same images, by name; empty where they were not measured.
        costs: Modelled costs; None: not measured, or the board cannot run the network.
        facts: Further figures of the point by name.
    """

    point: str
    value: float | None
    seed: int
    network: Recall
    baselines: dict[str, Recall] = field(default_factory=dict)
    costs: Costs | None = None
    facts: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Asked:
    """What a study is asked.

    Attributes:
        route: The places.
        config: Settings; the seed is replaced.
        seeds: Seeds, each once.
        values: Points of the study; empty: those of its row.
    """

    route: Route
    config: Config
    seeds: tuple[int, ...]
    values: tuple[float, ...] = ()

    def task(self, points: Sequence[Point], seed: int, section: tuple[int, int] | None = None) -> Task:
        """A task of this study."""
        return Task(tuple(points), seed, seed == self.seeds[0], section)


@dataclass(frozen=True)
class Study:
    """A study as users choose it.

    Attributes:
        name: How the command line calls it.
        title: What it is about, for people.
        varied: The heading of what is varied.
        values: The points that are measured unless others are asked for; empty: they are not a matter of numbers.
        tasks: What is to be measured, in the order of the table.
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
    tasks: Callable[[Asked], Sequence[Task]]
    measure: Callable[[Route, Task], list[Outcome]]
    note: str
    drawn: Literal["curve", "rows"] = "curve"
    whole: bool = True
    costed: bool = False
