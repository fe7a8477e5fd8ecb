"""Studies of several networks that answer together: modules without hyperactive neurons, and ensembles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.config import Config, integer_config
from lava_vpr.configfile import update
from lava_vpr.engine.random import presentation_key, uniform
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import ConfigError
from lava_vpr.experiments.grid import Figures, Outcome
from lava_vpr.experiments.task import (
    FACTS,
    MODELLED,
    NETWORK,
    Costs,
    Route,
    baselines,
    counted,
    judged_scores,
    learned,
    modelled,
    references_counted,
)
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching import decoders, ensembles
from lava_vpr.matching.decoders import best
from lava_vpr.matching.ensembles import calibrated_theta, foreign_images, hyperactive, without
from lava_vpr.model import Model, decode
from lava_vpr.studies.study import Point, Study, StudyRequest, StudyTask
from lava_vpr.training.measuring import ALTERED, altered

SEEDED, SHUFFLED = "other seeds", "other seeds and orders"
"""How the members of an ensemble differ."""
REPEATS = 2
"""Each reference is altered so often to calibrate theta_hyper."""


class Modules(NamedTuple):
    """Networks whose outputs are put side by side.

    Attributes:
        counts: Spikes on the queries, int32 (queries, neurons of all modules).
        references: Spikes on the references, traverse after traverse, int32 (images, neurons).
        calibration: Spikes on altered references, `REPEATS` times all places, int32 (presentations, neurons).
        responses: S^R, int (neurons, places): each module's own; 0 at the places of the others.
        neuron_modules: The module of each neuron, int64 (neurons,).
        place_modules: The module that learned each place, int64 (places,).
    """

    counts: NDArray[np.int32]
    references: NDArray[np.int32]
    calibration: NDArray[np.int32]
    responses: NDArray[Any]
    neuron_modules: NDArray[np.int64]
    place_modules: NDArray[np.int64]


def _altered(model: Model, route: Route) -> NDArray[np.int32]:
    """Spikes of ``model`` on altered references of ``route``, int32 (`REPEATS` places, neurons)."""
    encoder, activity = model.config.encoder, route.references[0].activity
    channels = encoder.layout.channels if INPUTS[encoder.kind].sees == "vector" else 1
    places = np.arange(route.places)
    shown = [altered(activity, places, model.config.seed, k, ALTERED, channels) for k in range(REPEATS)]
    rates = query_rates(np.concatenate(shown), model.config)
    return HostBackend().count_spikes(model, Presentations(rates, model.config.seed, "calibration"))[0]


def side_by_side(route: Route, config: Config, size: int) -> Modules:
    """A module for each ``size`` places in a row, each a network of its own that learned nothing else.

    Where they do not come out even, the last module has fewer places, or one more.
    """
    starts = range(0, route.places - 1, size)  # a last place alone joins the module before it
    sections = zip(starts, [*starts[1:], route.places], strict=True)
    models = [learned(route.section(*section), update(config, {"stretch": 0})) for section in sections]
    spikes = (np.concatenate(of, axis=1) for of in zip(*(_spikes(model, route) for model in models), strict=True))
    return _modules(spikes, block_diag(*(model.responses for model in models)), models)


def as_one(model: Model, route: Route) -> Modules:
    """One network whose stretches, learned apart, are the modules, all under one inhibition."""
    return _modules(_spikes(model, route), model.responses, model.stretches)


def _spikes(model: Model, route: Route) -> Iterable[NDArray[np.int32]]:
    """Spikes of ``model`` on queries, references and altered references of ``route``."""
    return counted(model, route), references_counted(model, route, "response"), _altered(model, route)


def _modules(spikes: Iterable[NDArray[np.int32]], responses: NDArray[Any], parts: Sequence[Any]) -> Modules:
    """Modules of so many neurons and places as each of ``parts`` has."""
    neurons, places = [part.neurons for part in parts], [part.places for part in parts]
    numbers, (counts, references, calibration) = np.arange(len(parts)), spikes
    return Modules(counts, references, calibration, responses, np.repeat(numbers, neurons), np.repeat(numbers, places))


def theta_of(modules: Modules, decoder: str, gamma: float) -> tuple[int, NDArray[np.bool_]]:
    """theta_hyper by the recall of altered references, and the neurons that it takes out, bool (neurons,)."""
    traverses = len(modules.references) // len(modules.place_modules)
    foreign = foreign_images(modules.references, np.tile(modules.place_modules, traverses), modules.neuron_modules)
    places = np.tile(np.arange(len(modules.place_modules)), REPEATS)

    def worth(theta: int) -> float:
        scores = _scored(modules.calibration, modules.responses, hyperactive(foreign, theta), decoder, gamma)
        return float(np.mean(best(scores) == places))

    theta = calibrated_theta(foreign, worth)
    return theta, hyperactive(foreign, theta)


def _scored(
    counts: NDArray[np.int32], responses: NDArray[Any], removed: NDArray[np.bool_], decoder: str, gamma: float
) -> NDArray[np.float64]:
    """Scores (n, places) of spikes (n, neurons) of which those of the ``removed`` neurons are 0."""
    kept = responses.copy()
    kept[removed] = 0
    return decoders.decode(decoder, kept, without(counts, removed), gamma=gamma)


def hyperactive_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """For each number of places of a module, networks apart and one network."""
    points = []
    for value in asked.values or asked.study.values:
        size = int(value)
        if not 2 <= size < asked.route.places:
            raise ConfigError(
                f"modules of {size} places, but the route has {asked.route.places}; choose --values of at least 2, "
                "below that"
            )
        cut = integer_config(update(config, {"stretch": size}), "the study hyperactive")
        if len(cut.views.views) > 1:
            raise ConfigError("the study hyperactive takes one view; set views.shifts and views.scales to 1")
        points.append([Point(f"modules of {size}", cut, size)])
    return points


def measure_hyperactive(route: Route, task: StudyTask) -> list[Outcome]:
    """Recall of modules side by side and of one network, as they are and without their hyperactive neurons."""
    (point,) = task.points
    decoder, size = point.config.decoder, int(point.value or 0)
    whole = learned(route, point.config)
    beside = baselines(whole, route) if task.first else {}
    apart = side_by_side(route, point.config, size)
    outcomes = []
    for kind, modules in (("one network", as_one(whole, route)), ("apart", apart)):
        theta, removed = theta_of(modules, decoder.default, decoder.gamma)
        found: Figures = {FACTS: {"theta_hyper": float(theta), "removed": float(removed.mean())}}
        for label, out, facts in (("as they are", np.zeros_like(removed), {}), ("without", removed, found)):
            scores = _scored(modules.counts, modules.responses, out, decoder.default, decoder.gamma)
            recall = judged_scores(decoder.default, scores, route.truth)._asdict()
            title = f"{point.label}, {kind}, {label}"
            outcomes.append(point.outcome(task.seed, {NETWORK: recall, **beside, **facts}, title))
    return outcomes


def ensemble_points(asked: StudyRequest, config: Config) -> list[list[Point]]:
    """One task, in which each member is learned once for all sizes."""
    sizes = [int(value) for value in asked.values or asked.study.values]
    if min(sizes) < 1:
        raise ConfigError(f"an ensemble of {min(sizes)} members; choose --values of at least 1")
    config = integer_config(config, "the study ensemble")
    return [[Point(f"{size} member{'s' if size > 1 else ''}", config, size) for size in sizes]]


def member_seed(seed: int, member: int) -> int:
    """The seed of a member of the ensemble of ``seed``; the first has that seed itself."""
    return seed if member == 0 else presentation_key(seed, "start", member) >> 1


def shuffled_order(places: int, seed: int) -> NDArray[np.int64]:
    """The order in which the member of ``seed`` learns, int64 (places,)."""
    return np.argsort(uniform(presentation_key(seed, "start", -1), places), kind="stable")


def measure_ensemble(route: Route, task: StudyTask) -> list[Outcome]:
    """Recall of ensembles whose members differ in their seeds, and in the order of the places, too."""
    config = task.points[0].config
    most, decoder = max(int(point.value or 1) for point in task.points), config.decoder.default
    beside: Figures = {}
    scores: dict[str, list[NDArray[np.float64]]] = {SEEDED: [], SHUFFLED: []}
    costs: list[Costs | None] = []
    for member in range(most):
        seed = member_seed(config.seed, member)
        for kind in (SEEDED, SHUFFLED) if member else (SEEDED,):
            order = shuffled_order(route.places, seed) if kind == SHUFFLED else np.arange(route.places)
            model = learned(route.shuffled(order), update(config, {"seed": seed}))
            scored = decode(model, counted(model, route), decoder)
            scores[kind].append(ensembles.in_order(scored, order))
            if kind == SEEDED and task.first:
                costs.append(modelled(model, route))
                beside = beside or baselines(model, route)
    scores[SHUFFLED].insert(0, scores[SEEDED][0])
    outcomes = []
    for kind, point in product(scores, task.points):
        size = int(point.value or 1)
        if size == 1 and kind == SHUFFLED:
            continue
        recall = judged_scores(decoder, ensembles.together(scores[kind][:size]), route.truth)._asdict()
        cost = _all(costs[:size]) if kind == SEEDED else {}
        label = point.label + (f", {kind}" if size > 1 else "")
        outcomes.append(point.outcome(task.seed, {NETWORK: recall, **beside, **cost}, label))
    return outcomes


def _all(costs: list[Costs | None]) -> Figures:
    """Energy of all members, and the time of the slowest: each has a board of its own."""
    known = [cost for cost in costs if cost is not None]
    if not known or len(known) < len(costs):
        return {}
    board, dynamic, times = zip(*known, strict=True)
    return {MODELLED: Costs(sum(board), sum(dynamic), max(times))._asdict()}


HYPERACTIVE = Study(
    "hyperactive",
    title="Without hyperactive neurons",
    varied="places of a module, and how modules stand together",
    values=(25, 50),
    points=hyperactive_points,
    measure=measure_hyperactive,
    note="A module learns so many places and nothing else. apart: each is a network of its own, their outputs side by "
    "side, as in the follow-up papers; one network: all under one inhibition, as models are here. without: spikes of "
    "neurons are 0 that fire for at least theta_hyper references outside their module; theta_hyper is the one with "
    "most recall of altered references, no query is asked. removed: share of the neurons.",
    drawn="rows",
)
ENSEMBLE = Study(
    "ensemble",
    title="Ensembles",
    varied="members",
    values=(1, 2, 3, 5),
    points=ensemble_points,
    measure=measure_ensemble,
    note="The sum of the scores of members that learned with other seeds, or also in another order of the places, so "
    "that other places compete. Energy is that of all members, time that of the slowest: each has a board.",
    drawn="rows",
)
