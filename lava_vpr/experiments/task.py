"""A task: what a route, settings and a seed bring. It depends on nothing else, and any process can be given it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.backends.rivals import Rivals, chosen, decoded
from lava_vpr.config import Config
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.encoding import query_rates
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.experiments.points import Run, figures
from lava_vpr.inputs.encoder import EncodedTraverse
from lava_vpr.inputs.vectors import Standard
from lava_vpr.matching.answers import InBlocks, hold
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import Recall
from lava_vpr.model import Model
from lava_vpr.training.loop import train

NETWORK, MODELLED, FACTS = "network", "modelled", "facts"
"""Groups of figures: of the model's own decoder, costs, and what only some tasks say; a baseline has its name."""
BOARD: Board = KAPOHO_BAY
"""The board whose costs are modelled."""
COSTED = 100
"""Costs are those of so many queries, the first ones."""
BESIDE = ("cosine", "sad", "standardised")
"""The cheap baselines, of which those stand beside that the model can be compared with."""


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


class Costs(NamedTuple):
    """What a query costs on the board, modelled with nominal constants.

    Attributes:
        microjoules: Dynamic energy, clearing of states included, host I/O not.
        milliseconds: Time on the chip, the same.
    """

    microjoules: float
    milliseconds: float


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


def baselines(model: Model, route: Route) -> dict[str, dict[str, float]]:
    """Figures of the cheap baselines on the same images, by name."""
    names = tuple(name for name in BESIDE if name in chosen(model, None))
    rivals = Rivals(model, route.queries, query_presentations(model, route.queries), names)
    held = {scored.name: hold(scored.matcher, scored.scores, route.truth) for scored in rivals.scored()}
    return {name: Recall.of(one.metrics)._asdict() for name, one in held.items()}


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


def measure(model: Model, route: Route, *, whole: bool = True) -> dict[str, dict[str, float]]:
    """The figures of a model with its own noise.

    Args:
        model: A model of the route.
        route: The route.
        whole: Whether what hardly depends on the seed is measured, too: baselines, by name, and costs, ``modelled``.
    """
    found = {NETWORK: judged(model, counted(model, route), route.truth)._asdict()}
    if not whole:
        return found
    costs = modelled(model, route)
    return found | baselines(model, route) | ({} if costs is None else {MODELLED: costs._asdict()})
