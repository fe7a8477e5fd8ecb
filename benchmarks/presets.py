"""The search that chose the presets: the encoder, what learning does, and the network of each preset.

    LAVA_VPR_DATA=... python -m benchmarks presets [--log benchmarks/presets.log]

It sees places 0:200 of Nordland (as two sections and as one model) and 0:50 of Gardens Point (within two places), each
season asked of the map of the other, and seeds that no table uses; everything else is computed once, by `make results`.
Three stages, each a coordinate descent
in the order of `ENCODER`, `LEARNING` and `NETWORK`: settings take their values in turn, round after round, and a value
is kept if it raises the score by more than `MARGIN` points. The encoder is chosen with templates, so that learning does
not speak for it; learning with the network of the search's start; then each preset of `GOALS` has its network chosen
under a limit of steps and of modelled energy. A last stage shows what recruiting brings. The log has a line for every
setting that was tried.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from benchmarks.places import TEMPLATES, PlacesSection, learned, near, places
from benchmarks.program import MARGIN, RECALL, Log, Printed, program, recalls
from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_dict, update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.engine.presentations import cores
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import InputError
from lava_vpr.experiments.search import Settings, Trial, descend
from lava_vpr.experiments.task import Case, Run, configured, current, figures, run_of
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.matching.baselines import cosine_similarities
from lava_vpr.matching.evaluation import Recall
from lava_vpr.model import Model

SEEDS = tuple(range(3, 7))
FRESH = tuple(range(11, 15))
"""Seeds with which a network that won must win again: the luckiest of many is not the best."""
ENERGY_OF = 2
"""So many sections decide about energy, those of 100 places: what presets promise is per query of 100 places."""
PLACES = {
    PlacesSection("nordland", 0, 100): 0,
    PlacesSection("nordland", 100, 200): 0,
    PlacesSection("nordland", 0, 200): 0,
    PlacesSection("gardens", 0, 50): 2,
}
"""How many places off an answer may be, by what is learned."""
SEASONS = (0, 1)
"""The season that is learned; the other one is asked."""
WEIGHTS = np.repeat(np.array(((0.25,), (0.25,), (0.35,), (0.15,))) * RECALL / len(SEASONS), len(SEASONS), axis=0)
"""What R@1, R@100P and AUC of each of `PLACES`, learned in each of `SEASONS`, count in the score."""
CEILING = 0.1
"""What R@1 of `cosine` of the same inputs counts where networks are chosen: what the inputs carry, for longer maps."""
MOST_INPUTS = 4096

ENCODER: Mapping[str, Sequence[Any]] = {
    "image_size, cell, orientations, query_inputs": (
        *((64, 4, orientations, 65 * orientations) for orientations in (8, 10, 12, 14, 16)),
        *((52, 4, 12, 520), (65, 5, 12, 520), (56, 4, 10, 490), (56, 4, 12, 600), (56, 4, 16, 800)),
        *((96, 6, 12, 780), (80, 5, 12, 780), (72, 6, 14, 520), (84, 6, 10, 490)),
    ),
    "window": (9, 13, 17, 21, 25),
    "blur": (0.0, 0.7, 1.0),
    "pool_floor": (0.05, 0.1, 0.2),
}
LEARNING: Mapping[str, Sequence[Any]] = {
    "train_spikes": (12.0, 18.0, 24.0, 30.0),
    "consolidation_x_target, consolidation_eta": (
        *((0.0, eta) for eta in (0.02, 0.03, 0.05)),
        (0.3, 0.03),
        (0.6, 0.03),
    ),
    "consolidation_tau_trace": (5.0, 10.0, 20.0),
    "epochs": (8, 12),
    "threshold": (5.0, 10.0, 15.0),
}
NETWORK: Mapping[str, Sequence[Any]] = {
    "threshold": (0.35, 0.5, 0.7, 1.0, 1.4),
    "inhibition": (0.35, 0.67, 1.0, 1.5),
    "tau_membrane": (8, 12, 20, 40, 100),
    "query_inputs": (420, 520, 780, 1040, 3072),
    "weight_bits, query_spikes": tuple((bits, spikes) for bits in (2, 3) for spikes in (12, 16, 17, 20, 25, 30)),
    "prune, query_spikes": tuple((share, spikes) for share in (0.25, 0.5) for spikes in (16, 20, 25)),
}
"""Names and the values that they take in turn; names with a comma between them take values together."""


class Goal(NamedTuple):
    """What a preset must keep to.

    Attributes:
        steps: Steps of a query.
        microjoules: Most modelled dynamic energy of a query of 100 places on Kapoho Bay, inputs and clearing counted.
        start: Settings that its search starts from, beside the encoder's and learning's.
    """

    steps: int
    microjoules: float
    start: Mapping[str, float]


START = {
    "encoder": {"query_inputs": 520, "query_spikes": 20},
    "network": {"steps": 128, "threshold": 1.0, "inhibition": 0.67, "tau_membrane": 12, "weight_bits": 3, "prune": 0},
    "learning": {"consolidation_x_target": 0.0, "consolidation_eta": 0.03, "threshold": 10.0, "recruit": True},
}
"""The network that chooses encoder and learning, and where their search and those of the presets start."""
GOALS = {
    "loihi": Goal(128, np.inf, {"query_inputs": 520, "query_spikes": 20}),
    "balanced": Goal(64, 4.0, {"query_inputs": 420, "query_spikes": 14, "threshold": 0.7}),
    "fast": Goal(32, 1.2, {"query_inputs": 420, "query_spikes": 16, "weight_bits": 2, "threshold": 0.35}),
    "accurate": Goal(128, np.inf, {"query_inputs": 780, "query_spikes": 25}),
}

FINALS: Mapping[str, Mapping[str, Sequence[float]]] = {
    "fast": {
        "tau_membrane": (12, 20, 40, 100),
        "threshold": (0.35, 0.5, 0.7),
        "query_inputs": (420, 520),
        "query_spikes": (16, 17),
    },
    "accurate": {"prune": (0, 0.25, 0.5, 0.65), "query_spikes": (16, 20, 25)},
}
"""Values around those where the search of a network ended, too alike for its margin; all combinations are tried."""


class PresetMeans(NamedTuple):
    """Means over seeds of one setting.

    Attributes:
        figures: (R@1, R@100P, AUC) of each of `PLACES`, learned in each of `SEASONS`, in percent.
        ceiling: R@1 of `cosine` of the same inputs, mean over these, in percent; 0 where it does not count.
        microjoules: Modelled energy of a query.
        kilobytes: Synapse memory of a place on Kapoho Bay.
    """

    figures: np.ndarray[Any, np.dtype[np.float64]]
    ceiling: float
    microjoules: float
    kilobytes: float

    @property
    def score(self) -> float:
        """One number of all figures, in percent."""
        return float((WEIGHTS * self.figures).sum() + CEILING * self.ceiling)

    def __str__(self) -> str:
        costs = f"{self.microjoules:6.2f} uJ  {self.kilobytes:5.2f} kB"
        return f"{recalls(self.figures)}  {self.ceiling:5.1f}  {costs}  score {self.score:6.2f}"


def cases_of(config: Config, seeds: Sequence[int] = SEEDS) -> list[Case]:
    """A model of each of `PLACES`, learned in each of `SEASONS`, for each of ``seeds``, with its queries."""
    cases = []
    for (section, tolerance), season in itertools.product(PLACES.items(), SEASONS):
        truth = near(section.end - section.first, tolerance)
        (queries,) = places(section, 1 - season, config, ViewsConfig())
        models = (learned(section, dataclasses.replace(config, seed=seed), season) for seed in seeds)
        cases += [Case(model, queries, truth) for model in models]
    return cases


def preset_means(cases: Sequence[Case], settings: Mapping[str, float], ceiling: bool = True) -> PresetMeans:
    """What the models of ``cases`` recall with ``settings``."""
    runs = [run_of(case, dict(settings), KAPOHO_BAY, cores()) for case in cases]
    results = [figures(run, (np.inf,))[0] for run in runs]
    of_places = np.array([Recall.of(one.metrics) for one in results]).reshape(-1, len(SEEDS), 3).mean(axis=1)
    costed = slice(ENERGY_OF * len(SEASONS) * len(SEEDS))
    energy = float(np.mean([one.microjoules for one in results[costed]]))
    memory = float(np.mean([_kilobytes(run) for run in runs[costed]]))
    firsts = range(0, len(cases) if ceiling else 0, len(SEEDS))
    ceilings = [_ceiling(cases[k], runs[k].model) for k in firsts]
    return PresetMeans(100 * of_places, 100 * float(np.mean(ceilings or 0.0)), energy, memory)


def as_learned(cases: Sequence[Case]) -> PresetMeans:
    """What models recall as they are."""
    return preset_means(cases, current(cases[0].model), ceiling=False)


def _kilobytes(run: Run) -> float:
    """Synapse memory of a place."""
    words = sum(core.needs.synapse_words or 0 for core in run.plan.cores)
    return 8 * words / 1000 / run.model.places


def _ceiling(case: Case, model: Model) -> float:
    """The share of the queries that `cosine` of the inputs recognises, whatever the seed."""
    rates = [query_rates(activity, model.config) for activity in (model.activity, case.queries.activity)]
    best = cosine_similarities(*rates, model.labels).argmax(axis=1)
    return float(case.truth[np.arange(len(best)), best].mean())


def better(
    log: Log, most: float = np.inf, again: Callable[[Settings], PresetMeans] | None = None
) -> Callable[[Trial[PresetMeans], Trial[PresetMeans]], bool]:
    """When a setting is better: its score is, by `MARGIN`, and it takes no more energy than ``most``.

    With ``again``, what a setting brings with fresh seeds, it must win with these, too.
    """

    def wins(trial: Trial[PresetMeans], best: Trial[PresetMeans]) -> bool:
        result, top = trial.result, best.result
        if result is None or top is None or result.microjoules > most:
            return False
        dear = top.microjoules > most
        if not dear and result.score <= top.score + MARGIN:
            return False
        if again is None:
            return True
        ours, standing = again(trial.settings).score, again(best.settings).score
        kept = dear or ours > standing + MARGIN / 2
        said = "stands" if kept else "does not stand"
        log.write(f"    {trial.name} with fresh seeds {ours:.2f} against {standing:.2f}: {said}")
        return kept

    return wins


def held(base: Config, part: str, values: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """The settings that ``values`` names, those of a part of ``base``, or of its encoder where the part has none."""
    settings = to_dict(base)
    return {name: (settings["encoder"] | settings[part])[name] for names in values for name in names.split(", ")}


def sections(part: str, settings: Settings) -> dict[str, Any]:
    """``settings`` by section: what learning shows, ``train_spikes``, is a setting of the encoder."""
    shown = {name: value for name, value in settings.items() if name == "train_spikes"}
    return {"encoder": shown} | {part: {name: value for name, value in settings.items() if name not in shown}}


def choose(base: Config, part: str, values: Mapping[str, Sequence[Any]], log: Log) -> Config:
    """``base`` with the settings of a part that serve best: the encoder's with templates, or those of learning."""

    def measure(settings: Settings) -> PresetMeans:
        config = update(base, sections(part, settings) | ({"learning": TEMPLATES} if part == "encoder" else {}))
        if config.encoder.inputs > MOST_INPUTS:
            raise InputError(f"{config.encoder.inputs:,} inputs; choose at most {MOST_INPUTS:,}")
        return as_learned(cases_of(config))

    trials = descend(held(base, part, values), values, measure, better(log))
    return update(base, sections(part, log.chosen(trials, str)))


def begun(cases: Sequence[Case], goal: Goal) -> dict[str, float]:
    """The settings from which the search of a network within ``goal`` starts."""
    return {**current(cases[0].model), **goal.start, "steps": float(goal.steps)}


def choose_network(base: Config, cases: Sequence[Case], fresh: Sequence[Case], goal: Goal, log: Log) -> Config:
    """``base`` with the network of the best recall within ``goal``; ``fresh`` are cases of other seeds."""
    wins = better(log, goal.microjoules, lambda settings: preset_means(fresh, settings))
    trials = descend(begun(cases, goal), NETWORK, lambda settings: preset_means(cases, settings), wins)
    return configured(base, log.chosen(trials, str))


def show_finals(name: str, cases: Sequence[Case], fresh: Sequence[Case], log: Log) -> None:
    """What all of `FINALS` recall with the search's seeds, and its score with these, with fresh ones and with all."""
    start = begun(cases, GOALS[name])
    for values in itertools.product(*FINALS[name].values()):
        settings = dict(zip(FINALS[name], values, strict=True))
        means = [preset_means(some, start | settings) for some in (cases, fresh)]
        scores = [each.score for each in means]
        title = ", ".join(f"{key} = {value:g}" for key, value in settings.items())
        log.write(f"  {title:60s} {means[0]}, fresh {scores[1]:.2f}, mean {float(np.mean(scores)):.2f}")


def show_recruiting(base: Config, log: Log) -> None:
    """What recruiting brings, with either seeds. It is no setting that is chosen: without it places have no neuron."""
    for recruit in (False, True):
        for seeds in (SEEDS, FRESH):
            cases = cases_of(update(base, {"learning": {"recruit": recruit}}), seeds)
            without = sum(case.model.places - int(case.model.training["places_covered"]) for case in cases)
            name = f"recruit = {recruit}, {without} places without"
            log.write(f"  {name:44s} {as_learned(cases)}")


STAGES = ("encoder", "learning", "network", "finals", "recruiting")


@program(*(section.dataset for section in PLACES))
@click.option("--log", "path", type=click.Path(path_type=Path), default=Path("benchmarks/presets.log"))
@click.option("--stage", "stages", type=click.Choice(STAGES), multiple=True, default=STAGES, show_default=True)
@click.option("--preset", "names", type=click.Choice(list(GOALS)), multiple=True, help="Networks to choose (all).")
@click.option("--orientations", type=int, default=0, help="Start from so many orientations, and spikes to match.")
def main(path: Path, stages: Sequence[str], names: Sequence[str], orientations: int) -> Printed:
    """Choose the presets' settings, and log all that was tried; a stage that is left out stands as presets have it."""
    log, titles = Log(path), ", ".join(map(str, PLACES))
    log.write(f"R@1/R@100P/AUC of {titles}, each learned in summer and in winter; R@1 of cosine, where networks are")
    log.write(f"chosen; modelled energy; synapse memory of a place; seeds {', '.join(map(str, SEEDS))}; * kept")
    config = update(preset("loihi"), {name: START[name] for name in ("encoder", "network")})
    if orientations:
        of_each = {"orientations": orientations, "query_inputs": 65 * orientations, "train_spikes": 1.5 * orientations}
        config = update(config, {"encoder": of_each})
    if "encoder" in stages:
        log.write("encoder, with templates")
        config = choose(config, "encoder", ENCODER, log)
    if "learning" in stages:
        log.write("learning")
        config = choose(update(config, {"learning": START["learning"]}), "learning", LEARNING, log)
    if "recruiting" in stages:
        log.write("recruiting: each with the seeds above, and with fresh ones")
        show_recruiting(config, log)
    cases, fresh = (cases_of(config), cases_of(config, FRESH)) if {"network", "finals"} & set(stages) else ([], [])
    for name in names or GOALS:
        if "network" in stages:
            log.write(f"network of {name}: {GOALS[name].steps} steps, at most {GOALS[name].microjoules:g} uJ")
            chosen = choose_network(config, cases, fresh, GOALS[name], log)
            log.write(f"{name}: {chosen.encoder} {chosen.network} {chosen.learning}")
        if "finals" in stages and name in FINALS:
            log.write(f"finals of {name}")
            show_finals(name, cases, fresh, log)
    yield f"{path}: written"
