"""The search for cheaper settings: recall on calibration images against modelled energy and time on a board.

Each point goes through all of a deployment: the network is quantised again from the learned float weights for the
board, its responses to the references are measured again (role ``response``), the queries run (role ``query``), and the
counted spikes of the partitioned network enter the cost model. The search starts from the points of the current front:
it moves one to three settings to a neighbouring value, measures the result and updates the front. The search is seeded,
so equal input gives equal points. Every network is also measured with early stopping (`lava_vpr.experiments.task`).

Nothing here is measured on a chip: energies and times are modelled, with nominal constants.
"""

from __future__ import annotations

import random
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from lava_vpr.bench.results import SweepPoint
from lava_vpr.cluster.tasks import ONE_THREAD, Pool, Standing
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.bundle.compression import UNCHANGED, with_settings
from lava_vpr.errors import NetworkLimitError
from lava_vpr.experiments.search import key_of, on_front, wander
from lava_vpr.experiments.task import MARGINS, Case, Measurement, Settings, current, fast_settings, measured
from lava_vpr.model import Model, as_integer
from lava_vpr.neurons.models import CONDUCTANCE

BUDGET = 240
"""Points that a search measures, not counting those with early stopping."""

LATTICE: dict[str, tuple[float, ...]] = {
    "steps": (8, 16, 32, 64, 128, 256),
    "query_spikes": (5, 8, 10, 12, 14, 16, 18, 20, 21),
    "query_inputs": (100, 150, 200, 250, 330, 420, 520, 700, 0),
    "weight_bits": (1, 2, 3, 4, 5, 6),
    "prune": (0, 0.5, 0.7, 0.8, 0.85, 0.9),
    "threshold": (0.6, 0.8, 1, 1.2, 1.4, 1.7, 2, 2.5),
    "inhibition": (0.1, 0.2, 0.33, 0.5, 0.67, 1, 1.4),
    "tau_membrane": (4, 6, 8, 12, 16, 20, 30, 45),
    "neurons_per_place": (0.5, 0.75, 1, 1.5, 2),
}
"""Values that each setting moves between. More than 21 input spikes a step are more than Kapoho Bay's host can send
(50 a chip, six standard deviations above the mean)."""

AHEAD = 8
"""Points that a cluster measures at once. When one of them moves the front, the points after it are drawn again, so
that the search is the same as one that measures point by point."""

MODEL, FAST = "this model", "preset fast"
"""The two texts that `SweepPoint.chosen` can hold."""

USEFUL = 0.75
"""The search continues from settings whose recall is at least this share of the best: points far below it are cheap but
useless."""

Advance = Callable[[int], None]


Point = tuple[Settings, float, Measurement]
"""Settings, margin of early stopping (inf: none), and figures."""


def sweepable(model: Model) -> str | None:
    """Why settings of ``model`` cannot be searched; None if they can."""
    if as_integer(model) is None:
        return str(CONDUCTANCE.refusal("the search of settings"))
    if model.config.encoder.direct is not None:
        return "these neurons hear the cells of the front end themselves; train with --input frontend"
    if not model.learned.size:
        return "a bundle has no float weights to quantise again; give the model that was deployed"
    return None


def front(points: Sequence[Point]) -> list[Point]:
    """The front of the points without early stopping, then the front of all points."""
    best = []
    for kind in ([point for point in points if point[1] == np.inf], points):
        if kind:
            keep = on_front(np.array([measurement.objectives for *_, measurement in kind]))
            best += [point for point, kept in zip(kind, keep, strict=True) if kept]
    return best


def _moved(settings: Settings, rng: random.Random, retrain: bool) -> Settings:
    """``settings`` with one to three of them at a near value of `LATTICE`."""
    changed = dict(settings)
    names = [name for name in LATTICE if retrain or name != "neurons_per_place"]
    for name in rng.sample(names, rng.choice((1, 1, 2, 2, 3))):
        values = LATTICE[name]
        order = [value or np.inf for value in values] if name == "query_inputs" else list(values)
        at = bisect_left(order, (settings[name] or np.inf) if name == "query_inputs" else settings[name])
        at = max(0, min(len(values) - 1, at + rng.choice((-2, -1, -1, 1, 1, 2))))
        changed[name] = values[at]
    return changed


def sweep(
    case: Case,
    *,
    budget: int = BUDGET,
    retrain: bool = True,
    board: Board = KAPOHO_BAY,
    pool: Pool = ONE_THREAD,
    advance: Advance | None = None,
) -> tuple[SweepPoint, ...]:
    """Points around a model and preset ``fast``, and which of them form the front.

    Args:
        case: A model with an integer network and its float weights, and its queries.
        budget: Points to measure; those that the board refuses count, early stopping does not.
        retrain: Also try other numbers of neurons, for which the references are learned again.
        board: The board; its energies and times must be published.
        pool: The pool that measures, which does not change the result; a cluster's workers measure `AHEAD` points at
            once, the next ones if the front does not move.
        advance: Called after each of ``budget`` points with how many more are done.
    Returns:
        Every point, the model first. The front is over R@1, energy and time of the mean query. No backend stops
        early yet, so points without early stopping also have a front of their own.
    Raises:
        ConfigError: the model has no integer network, or no float weights.
        NetworkLimitError: no network that was tried fits the board.
    """
    margins = (np.inf, *MARGINS)
    shared = case, board, margins, pool.threads if pool.here else 1
    as_learned, fast = current(case.model), fast_settings(case.model)
    with_settings(case.model, UNCHANGED)  # refuse what cannot be quantised again

    def moved(settings: Settings, rng: random.Random) -> Settings:
        return _moved(settings, rng, retrain)

    def measure(some: Sequence[Settings]) -> Iterable[list[Point]]:
        found = pool.map(measured, some, shared=shared, called="points", progress=_nobody)
        for settings, each in zip(some, found, strict=True):  # none where a network cannot be
            yield [(settings, margin, one) for margin, one in zip(margins, each, strict=False)]

    points: list[Point] = []
    for _, each in wander([as_learned, fast], moved, measure, parents, budget, 1 if pool.here else AHEAD):
        points += each
        if advance is not None:
            advance(1)
    if not points:
        raise NetworkLimitError(f"nothing that was tried fits {board.title}; learn fewer places, or use another board")
    best, chosen = {id(point) for point in front(points)}, {key_of(fast): FAST, key_of(as_learned): MODEL}
    return tuple(
        _candidate(as_learned, point, id(point) in best, chosen.get(key_of(point[0]), "") if point[1] == np.inf else "")
        for point in points
    )


def parents(found: Mapping[Any, list[Point]]) -> list[Settings]:
    """Settings of the front, except those with low recall (`USEFUL`)."""
    points = list(chain.from_iterable(found.values()))
    least = USEFUL * max((measurement.metrics.recall_at_1 for *_, measurement in points), default=0.0)
    known = {key_of(s): s for s, _, measurement in front(points) if measurement.metrics.recall_at_1 >= least}
    return [known[key] for key in sorted(known)]


def _nobody(standing: Standing) -> None:
    """Progress callback of tasks whose points report themselves."""


def _candidate(as_learned: Settings, point: Point, best: bool, chosen: str) -> SweepPoint:
    """A point for the report: the settings that differ from the model's, whole numbers as integers."""
    settings, margin, measurement = point
    changed: dict[str, Any] = {
        name: int(value) if float(value).is_integer() else value
        for name, value in settings.items()
        if value != as_learned[name]
    }
    if margin < np.inf:
        changed["stop_margin"] = margin
    return SweepPoint(
        changed,
        measurement.metrics,
        measurement.microjoules,
        measurement.milliseconds,
        measurement.steps,
        measurement.board_microjoules,
        front=best,
        chosen=chosen,
    )
