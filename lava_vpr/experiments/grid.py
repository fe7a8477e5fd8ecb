"""A grid of tasks: figures that are kept are taken, the others computed on threads or by a cluster, and kept.

A task is a pure function of a shared value and a point of the grid (`lava_vpr.cluster.tasks`), so its figures are the
same wherever it runs. The rows of results, each on its sections with every seed, are such a grid::

    points = [(row, section, seed) for row in rows for section in row.sections for seed in seeds]
    figures = compute(measure, points, pool=Pool(cores()))  # figures by point
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from contextlib import closing
from typing import Any, TypeVar

from lava_vpr.cluster.tasks import ONE_THREAD, Pool, Standing
from lava_vpr.experiments.cache import Cache

T = TypeVar("T", bound=Hashable)
R = TypeVar("R")

Advance = Callable[[int, str], None]
"""A function that is told how many more tasks are done, and what is being done."""


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
