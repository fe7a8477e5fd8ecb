"""A task: what a route, settings and a seed bring. It depends on nothing else, and any process can be given it.

A point of a search is a model quantised again for a board, run, its costs modelled, stopped early. As soon as the best
place leads the second by a margin, the rest of the steps of a query can be spared. Whoever stops must read the counts
and decode after every step, which would be the work of the board's embedded processors. Energy and time are those of
the steps that were run and of what is done between two queries; reading and decoding after every step is not in them.
No backend stops early yet: this is what it would bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.backends.rivals import Rivals, chosen, decoded
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, integer_config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.boards.constants import CostConstants, Estimate
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.compression import requantised
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost.between_queries import outside_steps
from lava_vpr.deploy.cost.closed_form import step_picojoules
from lava_vpr.deploy.cost.costs import all_microseconds, static_millijoules, wall_milliseconds
from lava_vpr.deploy.cost.embedded import host_milliseconds
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.inputs.vectors import Standard
from lava_vpr.matching.against_truth import InBlocks, hold
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.evaluation import Metrics, Recall, evaluate
from lava_vpr.model import Model, decode, integer_model
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import parts_of, references_of

Settings = dict[str, float]

PURPOSE = "the search of settings"
ENCODER = ("query_spikes", "query_inputs")
VARIED = ("steps", "weight_bits", "prune", "threshold", "inhibition", "tau_membrane")
WHOLE = ("steps", "weight_bits", "query_inputs")
"""Settings by section of `lava_vpr.config`, and whole numbers; beside them ``neurons_per_place``."""


@dataclass(frozen=True)
class Case:
    """A model, queries and their truth, bool (queries, places); ``seed`` of the queries' noise (None: the model's).

    ``learned`` keeps what was learned again, by neurons per place.
    """

    model: Model = field(repr=False)
    queries: EncodedTraverse = field(repr=False)
    truth: NDArray[np.bool_] = field(repr=False)
    seed: int | None = None
    learned: dict[float, Model] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Run:
    """The queries of a case through the network of a point.

    Attributes:
        model: The model as it runs.
        plan: Where its neurons stand.
        trains: Every spike.
        truth: bool (queries, places).
    """

    model: Model = field(repr=False)
    plan: Plan = field(repr=False)
    trains: Trains = field(repr=False)
    truth: NDArray[np.bool_] = field(repr=False)


@dataclass(frozen=True)
class Measurement:
    """Figures of a point: of the default decoder, and modelled costs of a query.

    Attributes:
        metrics: Figures of the default decoder.
        microjoules, milliseconds: Dynamic energy and time on the board, clearing of states included, host I/O not.
        steps: Steps of a query, silent ones included.
        board_microjoules: All energy on the board: dynamic, and static until the host has the counts.
    """

    metrics: Metrics
    microjoules: float
    milliseconds: float
    steps: float
    board_microjoules: float

    @property
    def objectives(self) -> tuple[float, float, float]:
        """The figures that decide about the front; lower is better."""
        return -self.metrics.recall_at_1, self.microjoules, self.milliseconds


def current(model: Model) -> Settings:
    """The settings of ``model`` that a sweep varies.

    Raises:
        ConfigError: it has no integer network.
    """
    config = integer_model(model, PURPOSE).config
    return _named(config) | {"neurons_per_place": model.neurons / model.places}


def fast_settings(model: Model) -> Settings:
    """The settings of ``model`` with those of preset ``fast``; its neurons per place stay."""
    return current(model) | _named(integer_config(preset("fast"), PURPOSE))


def _named(config: Config) -> Settings:
    """The settings of `ENCODER` and `VARIED`."""
    parts = ((config.encoder, ENCODER), (config.network, VARIED))
    return {name: float(getattr(part, name)) for part, names in parts for name in names}


def configured(config: Config, settings: Settings) -> Config:
    """``config`` with ``settings`` in their sections."""
    plain: dict[str, float] = {name: int(value) if name in WHOLE else value for name, value in settings.items()}
    network = {name: plain[name] for name in VARIED}
    return update(config, {"encoder": {name: plain[name] for name in ENCODER}, "network": network})


def _source(case: Case, settings: Settings, threads: int) -> Model:
    """The model of a case, learned again from the references that it keeps if neurons per place differ."""
    number = settings["neurons_per_place"]
    if number == current(case.model)["neurons_per_place"]:
        return case.model
    if number not in case.learned:
        config = update(case.model.config, {"network": {"neurons": 0, "neurons_per_place": number}})
        references, cut = references_of(case.model), parts_of(case.model)
        made = train(references, config, route_images=case.model.route_images, parts=cut, pool=Pool(threads))
        case.learned[number] = made
    return case.learned[number]


def run_of(case: Case, settings: Settings, board: Board, threads: int) -> Run:
    """The queries of ``case`` through its network under ``settings`` (all that `current` names).

    Raises:
        ConfigError: there is nothing to quantise again, or a value is outside its range.
        NetworkLimitError: ``board`` cannot run it.
    """
    source = _source(case, settings, threads)
    model = requantised(replace(source, config=configured(source.config, settings)), threads=threads)
    trains = HostBackend(Pool(threads)).trains(model, query_presentations(model, case.queries, case.seed))
    return Run(model, plan_of(model, board), trains, case.truth)


def figures(run: Run, margins: Sequence[float]) -> list[Measurement]:
    """Recall and modelled costs of the queries of ``run``, stopped early by each of ``margins`` (inf: not at all).

    Raises:
        ConfigError: no energies and times are public for the board.
    """
    constants = run.plan.board.constants
    if constants is None:
        raise ConfigError(f"no energy or time of {run.plan.board.title} is public; search on another board")
    events = count_events(run.plan, run.trains)
    energy = np.cumsum(np.sum(list(step_picojoules(events, constants, "nominal").values()), axis=0), axis=1) / 1e6
    time = np.cumsum(all_microseconds(run.plan, events, constants, "nominal"), axis=1) / 1e3
    outside_microjoules, outside_milliseconds = outside_steps(run.plan, constants)
    total = np.cumsum(run.trains.exc, axis=1, dtype=np.int32)
    sent, counts = host_milliseconds(run.plan, events, constants)
    traffic = next(iter(sent.values())), counts
    name = run.model.config.decoder.default
    lead = leads(run.model, total) if np.isfinite(margins).any() else np.zeros(total.shape[:2])
    measurements = []
    for margin in margins:
        steps = stops(lead, margin)
        at = np.arange(len(steps)), steps - 1
        scores = decode(run.model, np.ascontiguousarray(total[at]), name)
        microjoules = float(energy[at].mean() + outside_microjoules.nominal)
        in_steps, milliseconds = float(time[at].mean()), float(time[at].mean() + outside_milliseconds.nominal)
        whole = microjoules + _static_microjoules(run, in_steps, milliseconds, float(steps.mean()), traffic, constants)
        judged = evaluate(scores, confidence(name, scores), run.truth)
        measurements.append(Measurement(judged, microjoules, milliseconds, float(steps.mean()), whole))
    return measurements


def _static_microjoules(
    run: Run,
    in_steps: float,
    milliseconds: float,
    steps: float,
    traffic: tuple[Estimate, Estimate],
    constants: CostConstants,
) -> float:
    """Static energy until the host has the counts of a query that was stopped after so many ``steps``."""
    (sent, counts), network = traffic, run.plan.network
    taken = 0.0 if network.bias_input else min(steps, network.steps)
    alone, step = (Estimate(x, x, x) for x in (milliseconds, 1e3 * in_steps / steps))
    wall = wall_milliseconds(alone, sent * (taken / network.steps) if taken else sent, counts, step, taken)
    return 1e3 * static_millijoules(run.plan, wall, constants).nominal


def measured(shared: tuple[Case, Board, Sequence[float], int], settings: Settings) -> list[Measurement]:
    """The network of some settings with each margin: a task; nothing where it cannot be, or not on the board.

    Args:
        shared: The case, the board, margins of early stopping (inf: none), and threads, which change no figure.
        settings: The settings.
    """
    case, board, margins, threads = shared
    try:
        return figures(run_of(case, settings, board, threads), margins)
    except (ConfigError, NetworkLimitError):
        return []


MARGINS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Leads, in the default decoder's scores (``contrast``: spikes), that a sweep tries."""


def leads(model: Model, total: NDArray[np.int32]) -> NDArray[np.float64]:
    """Best minus second score after each step, float64 (n, steps).

    Args:
        model: With at least two places.
        total: Spikes up to each step, (n, steps, neurons).
    """
    name = model.config.decoder.default
    lead = np.zeros(total.shape[:2])
    for step in range(total.shape[1]):
        scores = decode(model, np.ascontiguousarray(total[:, step]), name)
        top = np.partition(scores, scores.shape[1] - 2, axis=1)
        lead[:, step] = top[:, -1] - top[:, -2]
    return lead


def stops(lead: NDArray[np.float64], margin: float) -> NDArray[np.int64]:
    """Steps that each query is run, int64 (n,): to the first whose lead is above ``margin``; all if there is none."""
    decided = lead > margin
    return np.where(decided.any(axis=1), decided.argmax(axis=1) + 1, lead.shape[1]).astype(np.int64)


NETWORK, MODELLED, FACTS = "network", "modelled", "facts"
"""Groups of figures: of the model's own decoder, costs, and what only some tasks say; a baseline has its name."""
BOARD: Board = KAPOHO_BAY
"""The board whose costs are modelled."""
COSTED = 100
"""Costs are those of so many queries, the first ones."""
BESIDE = ("cosine", "sad", "standardised")
"""The cheap baselines; a model is compared with those that it allows."""


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
        board_microjoules: All energy on the board: dynamic, and static until the host has the counts.
        microjoules: Dynamic energy, clearing of states included, host I/O not.
        milliseconds: Time on the chip, the same.
    """

    board_microjoules: float
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
    return Costs(found.board_microjoules, found.microjoules, found.milliseconds)


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
