"""What every study measures of a model: recall of its own decoder, baselines beside, modelled costs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.interface import Presentations, query_presentations
from lava_vpr.backends.rivals import Rivals, chosen, decoded
from lava_vpr.config import Config
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.encoding import query_rates
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.experiments.points import Run, figures
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.figures import Recall
from lava_vpr.matching.held import InBlocks, hold
from lava_vpr.model import Model
from lava_vpr.studies.study import Costs, Outcome, Point, Route, Task
from lava_vpr.training.loop import train

BOARD: Board = KAPOHO_BAY
"""The board whose costs are modelled."""
COSTED = 100
"""Costs are those of so many queries, the first ones."""
BESIDE = ("cosine", "sad", "standardised")
"""The cheap baselines, of which those stand beside that the model can be compared with."""


def learned(route: Route, config: Config) -> Model:
    """A model of ``route``."""
    return train(route.references, config, standard=route.standard)


def counted(model: Model, route: Route, seed: int | None = None) -> NDArray[np.int32]:
    """Spike counts of the queries, int32 (queries, neurons), with the noise of ``seed`` (None: the model's)."""
    return HostBackend().count_spikes(model, query_presentations(model, route.queries, seed))[0]


def references_counted(model: Model, route: Route, role: str) -> NDArray[np.int32]:
    """Spike counts of all references of ``route``, traverse after traverse, int32 (images, neurons).

    Args:
        model: A model of these places or of others.
        route: The references.
        role: What the noise is for (`lava_vpr.engine.random.ROLES`).
    """
    activity = np.concatenate([reference.activity for reference in route.references])
    shown = Presentations(query_rates(activity, model.config), model.config.seed, role)
    return HostBackend().count_spikes(model, shown)[0]


def judged(model: Model, counts: NDArray[Any], truth: NDArray[np.bool_]) -> Recall:
    """Figures of the model's own decoder on spike counts (queries, neurons)."""
    name = model.config.decoder.default
    return Recall.of(hold(name, decoded(model, counts, name), truth).metrics)


def judged_scores(matcher: str, scores: Scores, truth: NDArray[np.bool_]) -> Recall:
    """Figures of scores (queries, places) whose answers have the confidence of ``matcher``."""
    return Recall.of(hold(matcher, InBlocks.made(scores), truth).metrics)


def baselines(model: Model, route: Route) -> dict[str, Recall]:
    """Figures of the cheap baselines on the same images, by name."""
    names = tuple(name for name in BESIDE if name in chosen(model, None))
    rivals = Rivals(model, route.queries, query_presentations(model, route.queries), names)
    return {
        scored.name: Recall.of(hold(scored.matcher, scored.scores, route.truth).metrics) for scored in rivals.plain()
    }


def modelled(model: Model, route: Route) -> Costs | None:
    """What a query costs on `BOARD`, mean of the first `COSTED`; None: the board cannot run the network."""
    try:
        plan = plan_of(model, BOARD)
    except (ConfigError, NetworkLimitError):
        return None
    some = slice(0, min(COSTED, len(route.queries)))
    trains = HostBackend().trains(model, query_presentations(model, route.queries).part(some))
    (found,) = figures(Run(model, plan, trains, route.truth[some]), (np.inf,))
    return Costs(found.microjoules, found.milliseconds)


def whole(route: Route, task: Task, point: Point, model: Model, *, costed: bool = True, **facts: float) -> Outcome:
    """All that is measured of a model at a point, with the model's own noise."""
    return Outcome(
        point.label,
        point.value,
        task.seed,
        judged(model, counted(model, route), route.truth),
        baselines(model, route) if task.first else {},
        modelled(model, route) if task.first and costed else None,
        facts,
    )
