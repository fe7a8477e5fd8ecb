"""A grid of tasks: figures that are kept are taken, the others computed on threads or by a cluster, kept, put together.

A task is a pure function of a shared value and a point of the grid (`lava_vpr.cluster.tasks`), so its figures are the
same wherever it runs. The rows of results, each on its sections with every seed, are such a grid::

    points = [(row, section, seed) for row in rows for section in row.sections for seed in seeds]
    figures = compute(measure, points, pool=Pool(cores()))  # figures by point

What tasks measured of one row over repetitions, the seeds or the sections of a route, is put together by `rows`."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from lava_vpr.cluster.tasks import ONE_THREAD, Pool, Standing
from lava_vpr.experiments.cache import Cache

T = TypeVar("T", bound=Hashable)
R = TypeVar("R")

Advance = Callable[[int, str], None]
"""A function called with how many more tasks are done, and with what is being done."""


def ignored(done: int, note: str) -> None:
    """The `Advance` of whoever shows no progress."""


def compute(
    task: Callable[[Any, Any], R],
    points: Sequence[T],
    *,
    shared: Any = None,
    cache: Cache[T, R] | None = None,
    kept_only: bool = False,
    read: Callable[[T], Any] | None = None,
    called: str = "points",
    in_words: Callable[[T], str] | None = None,
    pool: Pool = ONE_THREAD,
    advance: Advance = ignored,
) -> dict[T, R]:
    """The figures of every point, in the order of ``points``.

    Args:
        task: Figures of ``shared`` and a point: a function of a module.
        points: What is computed, plain values.
        shared: What every task takes first.
        cache: Where figures are kept; None: nowhere.
        kept_only: Compute nothing: points whose figures are not kept are left out.
        read: Makes of a point what the task takes, on its thread, or here if a cluster computes, whose workers see no
            files; None: the task takes the point itself.
        called: What the points are, in the plural, for ``advance``.
        in_words: A point, for ``advance``; None: ``called``.
        pool: Who computes, a thread one point at a time; it changes no figure.
        advance: Called for every point that is done, and when the number of workers changes.
    Raises:
        LavaVprError: what a task raises, figures that cannot be kept, or the cluster was lost.
    """
    found: dict[T, R] = {}
    missing: list[tuple[T, str]] = []
    for point in points:
        key = "" if cache is None else cache.key(point)
        before = None if cache is None else cache.find(point, key)
        if before is not None:
            found[point] = before
            advance(1, f"{called if in_words is None else in_words(point)} (kept)")
        elif not kept_only:
            missing.append((point, key))

    def standing(now: Standing) -> None:
        if now.workers or not now.done:
            advance(0, f"{called}, {now.workers} workers" if now.workers else called)

    def on_thread(shared: Any, point: T) -> R:
        return task(shared, point if read is None else read(point))

    due = (point if read is None or pool.here else read(point) for point, _ in missing)
    function = on_thread if pool.here else task
    with closing(pool.as_done(function, due, shared=shared, called=called, progress=standing)) as done:
        for number, figures in done:
            point, key = missing[number]
            if cache is not None:
                cache.keep(point, key, figures)
            found[point] = figures
            advance(1, called if in_words is None else in_words(point))
    return {point: found[point] for point in points if point in found}


Figures = Mapping[str, Mapping[str, float]]
"""Figures by name, in groups: of the network, of a baseline, modelled costs."""


class Spread(NamedTuple):
    """A figure over repetitions: seeds, or sections.

    Attributes:
        mean: Of all repetitions.
        deviation: The sample standard deviation; None of one repetition.
        by_seed: The figure by the number of the repetition, in order.
    """

    mean: float
    deviation: float | None
    by_seed: Mapping[int, float]

    @classmethod
    def of(cls, by_seed: Mapping[int, float]) -> Spread:
        """That of figures by seed, at least one; sums are exact, so that every Python rounds them alike."""
        mean = mean_of(by_seed.values())
        if len(by_seed) == 1:
            return cls(mean, None, by_seed)
        squares = math.fsum((value - mean) ** 2 for value in by_seed.values())
        return cls(mean, math.sqrt(squares / (len(by_seed) - 1)), by_seed)

    @classmethod
    def over(cls, figures: Iterable[tuple[int, float]]) -> Spread:
        """That of figures, each with its seed; several of one seed count as their mean."""
        by_seed: dict[int, list[float]] = {}
        for seed, value in figures:
            by_seed.setdefault(seed, []).append(float(value))
        return cls.of({seed: mean_of(values) for seed, values in by_seed.items()})

    def as_json(self) -> dict[str, Any]:
        """It as plain JSON values."""
        return self._asdict() | {"by_seed": {str(seed): value for seed, value in self.by_seed.items()}}


def mean_of(values: Iterable[float]) -> float:
    """The mean of at least one value, the same in any order."""
    some = list(values)
    return math.fsum(some) / len(some)


class Outcome(NamedTuple):
    """What a task measured of one row.

    Attributes:
        label: The row, as tables call it.
        value: Its place on an axis; None: it has none.
        seed: The number of the repetition.
        figures: The figures; a repetition need not have those of the others.
    """

    label: str
    value: float | None
    seed: int
    figures: Figures


@dataclass(frozen=True)
class Row:
    """A row over all repetitions.

    Attributes:
        label, value: As in `Outcome`.
        figures: The figures that any repetition has, in groups.
    """

    label: str
    value: float | None
    figures: Mapping[str, Mapping[str, Spread]]

    def mean(self, group: str, name: str) -> float | None:
        """The mean of a figure; None if no repetition has it."""
        found = self.figures.get(group, {}).get(name)
        return None if found is None else found.mean


def rows(outcomes: Iterable[Outcome]) -> tuple[Row, ...]:
    """Outcomes by label, in the order of their first; of one label and seed the mean is taken."""
    by_label: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_label.setdefault(outcome.label, []).append(outcome)
    return tuple(Row(label, some[0].value, _spreads(some)) for label, some in by_label.items())


def _spreads(some: list[Outcome]) -> dict[str, dict[str, Spread]]:
    """Every figure of the outcomes of a row over their seeds."""
    seen: dict[str, dict[str, list[tuple[int, float]]]] = {}
    for one in some:
        for group, figures in one.figures.items():
            for name, value in figures.items():
                seen.setdefault(group, {}).setdefault(name, []).append((one.seed, value))
    return {group: {name: Spread.over(values) for name, values in figures.items()} for group, figures in seen.items()}
