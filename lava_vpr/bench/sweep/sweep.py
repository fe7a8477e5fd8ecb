"""The search for cheaper settings: recall on calibration images against modelled energy and time on a board.

Every point is a whole deployment in small: the network quantised anew from the learned float weights for the board, its
responses to the references measured anew (role ``response``), the queries run (role ``query``), partitioned, and its
spikes counted into the cost model. The search goes out from points of the front as it stands: one to three settings
move to a near value, what comes out is measured, and the front moves. The search is seeded, so equal input
gives equal points. Every network is also tried with early stopping (`lava_vpr.bench.sweep.early_stopping`).

Nothing here is measured on a chip: energies and times are modelled, with nominal constants.
"""

from __future__ import annotations

import random
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.bench.results import Candidate
from lava_vpr.bench.sweep.early_stopping import MARGINS
from lava_vpr.bench.sweep.points import Case, Measurement, Settings, current, fast_settings, figures, mean, runs_of
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.compression.compression import UNCHANGED, with_settings
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.model import Model

BUDGET = 240
"""Points that a search measures, early stopping aside."""

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

MODEL, FAST = "this model", "preset fast"
"""The two texts that `Candidate.chosen` can hold."""

USEFUL = 0.75
"""Settings are moved on from if they recall this share of the best: far below, points are cheap and useless."""

Advance = Callable[[int], None]


Point = tuple[Settings, float, Measurement]
"""Settings, margin of early stopping (inf: none), figures."""


@dataclass
class _Search:
    """Points measured so far, by their settings: one for each margin; none where a network cannot be."""

    cases: Sequence[Case]
    board: Board
    threads: int
    margins: tuple[float, ...]
    by_settings: dict[tuple[tuple[str, float], ...], list[Point]] = field(default_factory=dict)

    def measure(self, settings: Settings) -> None:
        """Measure a network of new settings with every margin."""
        points: list[Point] = []
        try:
            runs = runs_of(self.cases, settings, self.board, self.threads)
        except (ConfigError, NetworkLimitError):
            runs = ()
        if runs:
            each = zip(*(figures(run, self.margins) for run in runs), strict=True)
            points = [(settings, m, mean(measurements)) for m, measurements in zip(self.margins, each, strict=True)]
        self.by_settings[_key(settings)] = points

    def points(self) -> list[Point]:
        """All points, in the order in which they were measured."""
        return [point for points in self.by_settings.values() for point in points]

    def parents(self) -> list[Settings]:
        """Settings of the front, those that recall little aside."""
        points = self.points()
        least = USEFUL * max((measurement.metrics.recall_at_1 for *_, measurement in points), default=0.0)
        known = {_key(s): s for s, _, measurement in front(points) if measurement.metrics.recall_at_1 >= least}
        return [known[key] for key in sorted(known)]


def front(points: Sequence[Point]) -> list[Point]:
    """The points that no other outdoes, after the points without early stopping that no other of these outdoes."""
    best = []
    for kind in ([point for point in points if point[1] == np.inf], points):
        if kind:
            keep = on_front(np.array([measurement.objectives for *_, measurement in kind]))
            best += [point for point, kept in zip(kind, keep, strict=True) if kept]
    return best


def on_front(objectives: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points no other outdoes: at least as low in every column and lower in one; bool (n,).

    Args:
        objectives: float64 (n, columns), lower is better.
    """
    kept = np.ones(len(objectives), np.bool_)
    for number, point in enumerate(objectives):
        better = (objectives <= point).all(axis=1) & (objectives < point).any(axis=1)
        kept[number] = not better.any()
    return kept


def _key(settings: Settings) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(settings.items()))


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
    model: Model,
    queries: EncodedTraverse,
    truth: NDArray[np.bool_],
    *,
    seed: int | None = None,
    budget: int = BUDGET,
    retrain: bool = True,
    board: Board = KAPOHO_BAY,
    threads: int = 1,
    advance: Advance | None = None,
) -> tuple[Candidate, ...]:
    """Points around ``model`` and preset ``fast``, and which of them form the front.

    Args:
        model: A model with an integer network and its float weights.
        queries: Calibration images, encoded with the model's settings.
        truth: bool (queries, places).
        seed: The seed of the queries' noise; None: the model's.
        budget: Points to measure; those that the board refuses count, early stopping does not.
        retrain: Also try other numbers of neurons, for which the references are learned again.
        board: One whose energies and times are published.
        threads: Do not change the result.
        advance: Told, after each of ``budget`` points, how many more are done.
    Returns:
        Every point, this model first. The front is over R@1, energy and time of the mean query. No backend stops early
        yet, so points without early stopping also have a front of their own.
    Raises:
        ConfigError: the model has no integer network, or no float weights.
        NetworkLimitError: nothing that was tried fits the board.
    """
    return search([Case(model, queries, truth, seed)], budget, retrain, board, threads, advance)


def search(
    cases: Sequence[Case],
    budget: int = BUDGET,
    retrain: bool = True,
    board: Board = KAPOHO_BAY,
    threads: int = 1,
    advance: Advance | None = None,
) -> tuple[Candidate, ...]:
    """`sweep` over several models of equal settings with queries of their own: figures are means over them."""
    state, rng = _Search(cases, board, threads, (np.inf, *MARGINS)), random.Random(0)
    as_learned, fast = current(cases[0].model), fast_settings(cases[0].model)
    with_settings(cases[0].model, UNCHANGED)  # refuse what cannot be quantised anew
    chosen = {_key(fast): FAST, _key(as_learned): MODEL}
    starts, misses = [as_learned, fast], 0
    while len(state.by_settings) < budget and misses < 50 * budget:
        settings = starts.pop(0) if starts else _moved(rng.choice(state.parents() or [as_learned]), rng, retrain)
        if _key(settings) in state.by_settings:
            misses += 1
            continue
        state.measure(settings)
        if advance is not None:
            advance(1)
    points = state.points()
    if not points:
        raise NetworkLimitError(f"nothing that was tried fits {board.title}; learn fewer places, or use another board")
    best = {id(point) for point in front(points)}
    return tuple(
        _candidate(as_learned, point, id(point) in best, chosen.get(_key(point[0]), "") if point[1] == np.inf else "")
        for point in points
    )


def _candidate(as_learned: Settings, point: Point, best: bool, chosen: str) -> Candidate:
    """A point as the report has it: what differs from the model, whole numbers as such."""
    settings, margin, measurement = point
    changed: dict[str, Any] = {
        name: int(value) if float(value).is_integer() else value
        for name, value in settings.items()
        if value != as_learned[name]
    }
    if margin < np.inf:
        changed["stop_margin"] = margin
    return Candidate(
        changed,
        measurement.metrics,
        measurement.microjoules,
        measurement.milliseconds,
        measurement.steps,
        front=best,
        chosen=chosen,
    )
