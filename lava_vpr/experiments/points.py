"""One point of a search of settings: a model quantised anew for a board, run, its costs modelled, stopped early.

As soon as the best place leads the second by a margin, the rest of the steps of a query can be spared. Whoever stops
must read the counts and decode after every step, which would be the work of the board's embedded processors. Energy and
time are those of the steps that were run and of what is done between two queries; reading and decoding after every step
is not in them. No backend stops early yet: this is what it would bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, integer_config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.compression import requantised
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost.closed_form import step_picojoules
from lava_vpr.deploy.cost.costs import all_microseconds, outside_steps
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.model import Model, decode, integer_model
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import parts_of, references_of

Settings = dict[str, float]

PURPOSE = "the search of settings"
ENCODER = ("query_spikes", "query_inputs")
NETWORK = ("steps", "weight_bits", "prune", "threshold", "inhibition", "tau_membrane")
WHOLE = ("steps", "weight_bits", "query_inputs")
"""Settings by section of `lava_vpr.config`, and whole numbers; beside them ``neurons_per_place``."""


@dataclass(frozen=True)
class Case:
    """A model, queries and their truth, bool (queries, places); ``seed`` of the queries' noise (None: the model's).

    ``learned`` keeps what was learned anew, by neurons per place.
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
    """

    metrics: Metrics
    microjoules: float
    milliseconds: float
    steps: float

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
    """The settings of `ENCODER` and `NETWORK`."""
    parts = ((config.encoder, ENCODER), (config.network, NETWORK))
    return {name: float(getattr(part, name)) for part, names in parts for name in names}


def configured(config: Config, settings: Settings) -> Config:
    """``config`` with ``settings`` in their sections."""
    plain: dict[str, float] = {name: int(value) if name in WHOLE else value for name, value in settings.items()}
    network = {name: plain[name] for name in NETWORK}
    return update(config, {"encoder": {name: plain[name] for name in ENCODER}, "network": network})


def _source(case: Case, settings: Settings, threads: int) -> Model:
    """The model of a case, learned anew from the references that it keeps if neurons per place differ."""
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
        ConfigError: there is nothing to quantise anew, or a value is outside its range.
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
    name = run.model.config.decoder.default
    lead = leads(run.model, total) if np.isfinite(margins).any() else np.zeros(total.shape[:2])
    measurements = []
    for margin in margins:
        steps = stops(lead, margin)
        at = np.arange(len(steps)), steps - 1
        scores = decode(run.model, np.ascontiguousarray(total[at]), name)
        measurements.append(
            Measurement(
                evaluate(scores, confidence(name, scores), run.truth),
                float(energy[at].mean() + outside_microjoules.nominal),
                float(time[at].mean() + outside_milliseconds.nominal),
                float(steps.mean()),
            )
        )
    return measurements


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
