"""The search that chose the presets: the encoder, what learning does, and the network of each preset.

    LAVA_VPR_DATA=... python -m benchmarks.presets [--log benchmarks/presets.log]

It sees places 0:200 of Nordland (as two sections and as one model) and 0:50 of Gardens Point (within two places), and
seeds that no table uses; everything else is computed once, by `make results`. Three stages, each a coordinate descent
in the order of `ENCODER`, `LEARNING` and `NETWORK`: settings take their values in turn, round after round, and a value
is kept if it raises the score by more than `MARGIN` points. The encoder is chosen with templates, so that learning does
not speak for it; learning with the network of the search's start; then each preset of `GOALS` has its network chosen
under a limit of steps and of modelled energy. A last stage shows what recruiting brings. The log has a line for every
setting that was tried.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import click
import numpy as np

from benchmarks.nordland import required
from benchmarks.results.places import TEMPLATES, Section, learn, places
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.encoding import query_rates
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError, LavaVprError
from lava_vpr.experiments.points import Case, configured, current, figures, runs_of
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.matching.baselines import cosine_similarities
from lava_vpr.model import Model

SEEDS = tuple(range(3, 11))
FRESH = tuple(range(11, 19))
"""Seeds with which a network that won must win again: the luckiest of many is not the best."""
ENERGY_OF = 2
"""So many sections decide about energy, those of 100 places: what presets promise is per query of 100 places."""
PLACES = (("nordland", 0, 100, 0), ("nordland", 100, 200, 0), ("nordland", 0, 200, 0), ("gardens", 0, 50, 2))
"""Dataset, first place, end, and how many places off an answer may be."""
WEIGHTS = np.array(((0.25,), (0.25,), (0.35,), (0.15,))) * (0.6, 0.15, 0.25)
"""What R@1, R@100P and AUC of each of `PLACES` count in the score."""
CEILING = 0.1
"""What R@1 of `cosine` of the same inputs counts where networks are chosen: what the inputs carry, for longer maps."""
MARGIN = 0.5
"""Points of score below which a difference is noise: a query in 200, about twice the standard error over the seeds."""
MOST_INPUTS = 2048

ENCODER: Mapping[str, Sequence[Any]] = {
    "image_size, cell": ((64, 4), (48, 4), (56, 4), (72, 6), (80, 5), (96, 6)),
    "window": (9, 13, 17, 21),
    "blur": (0.0, 0.7, 1.0),
    "pool_floor": (0.05, 0.1, 0.2),
    "orientations": (6, 8),
}
LEARNING: Mapping[str, Sequence[Any]] = {
    "trains": ("poisson", "regular"),
    "consolidation_x_target, consolidation_eta": (
        *((0.0, eta) for eta in (0.012, 0.02, 0.03, 0.05)),
        *((target, eta) for target in (0.3, 0.6, 0.9) for eta in (0.012, 0.03)),
    ),
    "consolidation_tau_trace": (5.0, 10.0, 20.0),
    "epochs": (6, 8, 12),
    "threshold": (2.0, 3.0, 5.0, 7.0, 10.0),
    "theta_plus": (0.2, 0.3, 0.5),
}
NETWORK: Mapping[str, Sequence[Any]] = {
    "threshold": (0.35, 0.5, 0.7, 1.0, 1.4),
    "inhibition": (0.35, 0.5, 0.67, 1.0, 1.5, 2.0),
    "tau_membrane": (8, 12, 20, 40),
    "query_inputs": (420, 520, 800, 1200, 2048),
    "weight_bits, query_spikes": tuple((bits, spikes) for bits in (2, 3) for spikes in (12, 14, 16, 18, 20)),
    "prune, query_spikes": tuple((share, spikes) for share in (0.25, 0.5) for spikes in (16, 18, 20)),
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
    "fast": Goal(32, 1.6, {"query_inputs": 420, "query_spikes": 16, "weight_bits": 2, "threshold": 0.35}),
}


class Result(NamedTuple):
    """Means over seeds of one setting.

    Attributes:
        figures: (R@1, R@100P, AUC) of each of `PLACES`, in percent.
        ceiling: R@1 of `cosine` of the same inputs, mean over `PLACES`, in percent.
        microjoules: Modelled energy of a query.
    """

    figures: np.ndarray[Any, np.dtype[np.float64]]
    ceiling: float
    microjoules: float

    @property
    def score(self) -> float:
        """One number of all figures, in percent."""
        return float((WEIGHTS * self.figures).sum() + CEILING * self.ceiling)


class Log:
    """Writes a line for every setting, to the terminal and to a file."""

    def __init__(self, file: TextIO) -> None:
        self.file = file

    def write(self, line: str) -> None:
        """Write a line."""
        click.echo(line)
        self.file.write(line + "\n")
        self.file.flush()

    def result(self, name: str, result: Result | str, kept: bool) -> None:
        """Write what a setting brought, or why it cannot be."""
        if isinstance(result, str):
            self.write(f"  {name:44s} {result}")
            return
        figures = "  ".join("/".join(f"{value:5.1f}" for value in row) for row in result.figures)
        star = " *" if kept else ""
        rest = f"{result.ceiling:5.1f}  {result.microjoules:6.2f} uJ  score {result.score:6.2f}{star}"
        self.write(f"  {name:44s} {figures}  {rest}")


def cases_of(config: Config, seeds: Sequence[int] = SEEDS) -> list[Case]:
    """A model of each of `PLACES` for each of ``seeds``, with its queries."""
    cases = []
    for dataset, first, end, tolerance in PLACES:
        numbers = np.arange(end - first)
        truth = np.abs(numbers[:, None] - numbers) <= tolerance
        (queries,) = places(Section(dataset, first, end), 1, config, ViewsConfig())
        for seed in seeds:
            model = learn(Section(dataset, first, end), dataclasses.replace(config, seed=seed))
            cases.append(Case(model, queries, truth))
    return cases


def measured(cases: Sequence[Case], settings: Mapping[str, float]) -> Result:
    """What the models of ``cases`` recall with ``settings``."""
    runs = runs_of(cases, dict(settings), KAPOHO_BAY, cores())
    results = [figures(run, (np.inf,))[0] for run in runs]
    rows = [(r.metrics.recall_at_1, r.metrics.recall_at_100_precision, r.metrics.auc) for r in results]
    of_places = np.array(rows).reshape(len(PLACES), len(SEEDS), 3).mean(axis=1)
    energy = np.mean([r.microjoules for r in results[: ENERGY_OF * len(SEEDS)]])
    ceilings = [_ceiling(case, run.model) for case, run in zip(cases[:: len(SEEDS)], runs[:: len(SEEDS)], strict=True)]
    return Result(100 * of_places, 100 * float(np.mean(ceilings)), float(energy))


def _ceiling(case: Case, model: Model) -> float:
    """The share of the queries that `cosine` of the inputs recognises, whatever the seed."""
    rates = [query_rates(activity, model.config) for activity in (model.activity, case.queries.activity)]
    best = cosine_similarities(*rates, model.labels).argmax(axis=1)
    return float(case.truth[np.arange(len(best)), best].mean())


def descend(
    start: Mapping[str, Any],
    values: Mapping[str, Sequence[Any]],
    measure: Callable[[Mapping[str, Any]], Result],
    most: float,
    log: Log,
    again: Callable[[Mapping[str, Any]], Result] | None = None,
) -> dict[str, Any]:
    """The settings that a coordinate descent ends at.

    Args:
        start: Where it starts.
        values: What settings take in turn.
        measure: What a setting brings.
        most: No setting that takes more energy is kept.
        log: Told of all that is tried.
        again: What a setting brings with fresh seeds, by which it must win, too; None: that is not asked.
    """
    best = dict(start)
    top = measure(best)
    log.result("start", top, True)
    tried = {tuple(best.items())}
    moved = True
    while moved:
        moved = False
        for names, options in values.items():
            together = names.split(", ")
            for option in options:
                trial = {**best, **dict(zip(together, option if len(together) > 1 else (option,), strict=True))}
                if tuple(trial.items()) in tried:
                    continue
                tried.add(tuple(trial.items()))
                try:
                    result = measure(trial)
                except LavaVprError as error:
                    log.result(f"{names} = {option}", str(error), False)
                    continue
                dear = top.microjoules > most
                kept = result.microjoules <= most and (dear or result.score > top.score + MARGIN)
                log.result(f"{names} = {option}", result, kept)
                if kept and again is not None:
                    ours, standing = again(trial).score, again(best).score
                    kept = dear or ours > standing + MARGIN / 2
                    said = "stands" if kept else "does not stand"
                    log.write(f"    with fresh seeds {ours:.2f} against {standing:.2f}: {said}")
                if kept:
                    best, top, moved = trial, result, True
    return best


def held(part: Any, values: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """The settings of ``part`` that ``values`` names."""
    return {name: getattr(part, name) for names in values for name in names.split(", ")}


def choose_encoder(base: Config, log: Log) -> Config:
    """``base`` with the encoder that serves templates best."""

    def configured_by(settings: Mapping[str, Any]) -> Config:
        return update(base, {"encoder": dict(settings)})

    def measure(settings: Mapping[str, Any]) -> Result:
        config = update(configured_by(settings), {"learning": TEMPLATES})
        if config.encoder.inputs > MOST_INPUTS:
            raise InputError(f"{config.encoder.inputs:,} inputs; choose at most {MOST_INPUTS:,}")
        cases = cases_of(config)
        return measured(cases, current(cases[0].model))._replace(ceiling=0.0)

    return configured_by(descend(held(base.encoder, ENCODER), ENCODER, measure, np.inf, log))


def choose_learning(base: Config, log: Log) -> Config:
    """``base`` with what learning brings most."""

    def configured_by(settings: Mapping[str, Any]) -> Config:
        return update(base, {"learning": dict(settings)})

    def measure(settings: Mapping[str, Any]) -> Result:
        cases = cases_of(configured_by(settings))
        return measured(cases, current(cases[0].model))._replace(ceiling=0.0)

    return configured_by(descend(held(base.learning, LEARNING), LEARNING, measure, np.inf, log))


def choose_network(base: Config, cases: Sequence[Case], fresh: Sequence[Case], goal: Goal, log: Log) -> Config:
    """``base`` with the network of the best recall within ``goal``; ``fresh`` are cases of other seeds."""
    start = {**current(cases[0].model), **goal.start, "steps": float(goal.steps)}

    def measure(settings: Mapping[str, Any]) -> Result:
        return measured(cases, settings)

    def again(settings: Mapping[str, Any]) -> Result:
        return measured(fresh, settings)

    return configured(base, descend(start, NETWORK, measure, goal.microjoules, log, again))


def show_recruiting(base: Config, log: Log) -> None:
    """What recruiting brings, with either seeds. It is no setting that is chosen: without it places have no neuron."""
    for recruit in (False, True):
        for seeds in (SEEDS, FRESH):
            cases = cases_of(update(base, {"learning": {"recruit": recruit}}), seeds)
            without = sum(case.model.places - int(case.model.training["places_covered"]) for case in cases)
            result = measured(cases, current(cases[0].model))._replace(ceiling=0.0)
            log.result(f"recruit = {recruit}, {without} places without", result, recruit)


STAGES = ("encoder", "learning", "network", "recruiting")


@click.command()
@click.option("--log", "path", type=click.Path(path_type=Path), default=Path("benchmarks/presets.log"))
@click.option("--stage", "stages", type=click.Choice(STAGES), multiple=True, default=STAGES, show_default=True)
@click.option("--preset", "names", type=click.Choice(list(GOALS)), multiple=True, help="Networks to choose (all).")
def main(path: Path, stages: Sequence[str], names: Sequence[str]) -> None:
    """Choose the presets' settings, and log all that was tried; a stage that is left out stands as presets have it."""
    required(*(dataset for dataset, *_ in PLACES))
    with path.open("w") as file:
        log = Log(file)
        titles = ", ".join(f"{dataset} {first}:{end}" for dataset, first, end, _ in PLACES)
        log.write(f"R@1/R@100P/AUC of {titles}; R@1 of cosine; seeds {', '.join(map(str, SEEDS))}; * kept")
        config = update(preset("loihi"), {name: START[name] for name in ("encoder", "network")})
        if "encoder" in stages:
            log.write("encoder, with templates")
            config = choose_encoder(config, log)
        if "learning" in stages:
            log.write("learning")
            config = choose_learning(update(config, {"learning": START["learning"]}), log)
        if "recruiting" in stages:
            log.write("recruiting: each with the seeds above, and with fresh ones")
            show_recruiting(config, log)
        if "network" not in stages:
            return
        cases, fresh = cases_of(config), cases_of(config, FRESH)
        for name in names or GOALS:
            log.write(f"network of {name}: {GOALS[name].steps} steps, at most {GOALS[name].microjoules:g} uJ")
            chosen = choose_network(config, cases, fresh, GOALS[name], log)
            log.write(f"{name}: {chosen.encoder} {chosen.network} {chosen.learning}")


if __name__ == "__main__":
    main()
