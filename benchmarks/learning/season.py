"""The season, learned: what gains that sure answers teach do to recall, what teaches, and what is carried elsewhere.

    LAVA_VPR_DATA=... python -m benchmarks learning.season [--seeds 0,1,2] [--chosen] [--record]

Causal: an answer comes first and teaches afterwards. Without gains and with them the same network adapts to the last
30 queries and sees the same images, so answers come in pairs. ``--chosen`` prints the settings that were compared, on
places 0:200 and Gardens Point 0:50 in both directions.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple
from unittest.mock import patch

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.cosine import cosines
from benchmarks.places import ALL_CORES, TEMPLATES, PlacesSection, Views, near, places, sections_of
from benchmarks.program import BenchmarkTable, Printed, program, recall, seeds_option
from benchmarks.results.rows import TAU
from lava_vpr import Localizer, train as train_images
from lava_vpr.backends import teaching
from lava_vpr.backends.answering import Turn, in_turn, paired, teachers
from lava_vpr.backends.asking import Asker, Asking, calibration_of
from lava_vpr.backends.interface import HostBackend
from lava_vpr.config import integer_config, preset
from lava_vpr.configfile import update
from lava_vpr.engine import gains
from lava_vpr.engine.gains import RECENT, Season
from lava_vpr.engine.rates import query_rates
from lava_vpr.matching.against_truth import InBlocks, hold
from lava_vpr.matching.answers import Together
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import Calibration, reliability
from lava_vpr.model import Model
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train

OFF = -9
"""The place of an image that shows none."""
ADAPTING = Asking(adapt=TAU)
LEARNING = Asking(adapt=TAU, learn=True)
PRESETS = ("loihi", "accurate")
STDP, COPIED = "STDP", "templates"
RULES: Mapping[str, dict[str, Any]] = {STDP: {}, COPIED: {"learning": TEMPLATES}}
SEEDS = tuple(range(8))
"""Seeds whose range is printed where an error decides."""


class SeasonedMap(NamedTuple):
    """A map, the season that it was learned in (0: summer, 1: winter), and how far an answer may be off."""

    section: PlacesSection
    season: int = 0
    tolerance: int = 0

    def __str__(self) -> str:
        return f"{self.section.first}:{self.section.end}"


NEAR, FAR = SeasonedMap(PlacesSection("nordland_all", 0, 500)), SeasonedMap(PlacesSection("nordland_all", 500, 1500))
WHOLE = SeasonedMap(PlacesSection("nordland_all", 0, 1500))
Ways = tuple[SeasonedMap, ...]
UNSEEN: Mapping[str, Ways] = {
    f"{way.section.end - way.section.first:,} places, queried in {asked}": (way._replace(season=season),)
    for way in (NEAR, FAR, WHOLE)
    for season, asked in enumerate(("winter", "summer"))
} | {
    "five sections of 100, queried in winter": tuple(map(SeasonedMap, sections_of("nordland", 500))),
    "ten further sections of 100, queried in winter": tuple(map(SeasonedMap, sections_of("nordland_long", 1000))),
    "Gardens Point 50:100, queried from the other side": (SeasonedMap(PlacesSection("gardens", 50, 100), 0, 2),),
    "Gardens Point 50:100, queried from the first side": (SeasonedMap(PlacesSection("gardens", 50, 100), 1, 2),),
}
"""Maps by name; of several, each is learned and asked by itself."""
SHORT = tuple(f"{these}, queried in winter" for these in ("500 places", "1,500 places", "ten further sections of 100"))
"""Those that README shows."""
CHOSEN = [
    SeasonedMap(section, season, tolerance)
    for section, tolerance in ((PlacesSection("nordland", 0, 200), 0), (PlacesSection("gardens", 0, 50), 2))
    for season in (0, 1)
]
SETTINGS: Mapping[str, Sequence[float]] = {
    "PRIOR": (5, 20, 40),
    "EPOCH": (10, 40, 80),
    "FORGETTING": (7, 11),
    "ALONE": (0.3, 0.5, 0.9),
}
"""What each number of `lava_vpr.engine.gains` and `lava_vpr.backends.teaching` was compared with."""


class Drive(NamedTuple):
    """A traverse that was answered, turn by turn."""

    turns: list[Turn]

    @property
    def season(self) -> Season | None:
        """What was known of the season at its end."""
        return self.turns[-1].season

    @property
    def scores(self) -> NDArray[np.float64]:
        """Those of all queries, (n, places)."""
        return np.concatenate([turn.scores for turn in self.turns])

    @property
    def least_and_most(self) -> tuple[float, float]:
        """The least and the most of `RECENT` answers in a row that are as sure as a teacher is."""
        answers = [turn.answers for turn in self.turns]
        least = teaching.ALONE if answers[0].off_map is None else teaching.TRACKED
        sure = np.concatenate([some.probability >= least for some in answers])
        shares = np.convolve(sure, np.ones(RECENT) / RECENT, "valid")
        return float(shares.min()), float(shares.max())


@lru_cache(maxsize=4)
def learned(way: SeasonedMap, rule: str, seed: int, name: str = "loihi") -> Model:
    """A model of a map, learned by a rule under a preset."""
    config = dataclasses.replace(update(preset(name), RULES[rule]), seed=seed)
    return train(places(way.section, way.season, config), config, pool=ALL_CORES)


def driven(model: Model, way: SeasonedMap, asking: Asking, motion: str = NONE) -> Drive:
    """What ``model`` answers to the other season of ``way``."""
    return answered(model, places(way.section, 1 - way.season, model.config), asking, motion)


def answered(model: Model, queries: Views, asking: Asking, motion: str = NONE) -> Drive:
    """What ``model`` answers to queries in each of their views."""
    asker = Asker(model, asking)
    together = Together(1, motion, calibration_of(model, ALL_CORES))
    return Drive(list(in_turn(model, asker, [queries], HostBackend(ALL_CORES), together)))


def truth_of(way: SeasonedMap) -> NDArray[np.bool_]:
    """Which answers are right, bool (n, places)."""
    return near(way.section.end - way.section.first, way.tolerance)


def figures(scores: NDArray[np.float64], way: SeasonedMap) -> Metrics:
    """Recall of scores (n, places)."""
    return hold("contrast", InBlocks.made(scores), truth_of(way), Together()).metrics


def right(drive: Drive, way: SeasonedMap) -> NDArray[np.bool_]:
    """Which queries are answered right, bool (n,)."""
    best = drive.scores.argmax(axis=1)
    return np.asarray(truth_of(way)[np.arange(len(best)), best])


class GainsCompared(NamedTuple):
    """Drives of the same maps without gains and with them: the figures of both, queries that became right and wrong,
    answers that taught, and those of them that were wrong."""

    adapted: list[Metrics]
    learning: list[Metrics]
    counts: NDArray[np.int64]

    @property
    def pairs(self) -> list[str]:
        """What is counted, as cells."""
        won, lost, taught, wrong = self.counts.tolist()
        return [f"{won} / {lost}", f"{taught} / {wrong}"]


def drives_compared(ways: Ways, rule: str, name: str, seeds: Sequence[int], motion: str = NONE) -> GainsCompared:
    """What gains do to the answers of maps that were learned by a rule under a preset; who teaches, ``motion`` says:
    answers by their image alone, or those of the filter."""
    without, under, counts = [], [], np.zeros(4, np.int64)
    for way, seed in itertools.product(ways, seeds):
        model = learned(way, rule, seed, name)
        plain, learning = driven(model, way, ADAPTING), driven(model, way, LEARNING, motion)
        before, after = right(plain, way), right(learning, way)
        won, lost = int((after & ~before).sum()), int((before & ~after).sum())
        counts += (won, lost, *teachers(learning.turns, truth_of(way)))
        without.append(figures(plain.scores, way))
        under.append(figures(learning.scores, way))
    return GainsCompared(without, under, counts)


def cosine(ways: Ways, name: str, learning: bool) -> list[Metrics]:
    """`benchmarks.learning.cosine.cosines` of maps under a preset."""
    found, config = [], preset(name)
    for way in ways:
        rates = [query_rates(places(way.section, season, config)[0].activity, config) for season in (0, 1)]
        references, queries = (rates[season].astype(np.float64) for season in (way.season, 1 - way.season))
        network = integer_config(config, "cosine").network
        found.append(cosines(truth_of(way), network, references, queries, learning))
    return found


def compared(seeds: Sequence[int]) -> Printed:
    """The same answers without gains and with them: recall, and what became right and wrong."""
    recalled, pairs, short = [], [], []
    for (title, ways), name in itertools.product(UNSEEN.items(), PRESETS):
        stdp, filtered, copied = (
            drives_compared(ways, rule, name, seeds, motion)
            for rule, motion in ((STDP, NONE), (STDP, "any"), (COPIED, NONE))
        )
        rivals = [cosine(ways, name, learning) for learning in (False, True)]
        found = (stdp.adapted, stdp.learning, filtered.learning, copied.adapted, copied.learning, *rivals)
        recalled.append([title, f"`{name}`", *map(recall, found)])
        if title in SHORT and name == "accurate":
            short.append([title, *(ranged(one, len(ways)) for one in (*found[:3], copied.learning, rivals[1]))])
        pairs.append([title, f"`{name}`", *(cell for one in (stdp, filtered, copied) for cell in one.pairs)])
    shown, rivals_of = ("adapted", "and gains", "and gains that the filter teaches"), (COPIED, "`cosine`")
    ways_to_learn = ("STDP", "STDP, taught by the filter", "templates")
    heads = [*(f"STDP, {what}" for what in shown), *(f"{rule}, {what}" for rule in rivals_of for what in shown[:2])]
    yield BenchmarkTable(["map", "preset", *heads], recalled, record="season")
    heads = [f"{rule}: {what}" for rule in ways_to_learn for what in ("won / lost", "taught / wrong")]
    yield BenchmarkTable(["map", "preset", *heads], pairs, record="season-pairs")
    heads = [*(f"STDP, {what}" for what in shown), *(f"{rule}, and gains" for rule in rivals_of)]
    yield BenchmarkTable(["map", *heads], short, record="season-short")


def ranged(metrics: Sequence[Metrics], maps: int) -> str:
    """R@1 in percent, mean over maps, of each of which there are as many seeds: the mean, and the least to the most."""
    of_seeds = 100 * np.reshape([one.recall_at_1 for one in metrics], (maps, -1)).mean(axis=0)
    mean, least, most = (f"{value:.1f}" for value in (of_seeds.mean(), of_seeds.min(), of_seeds.max()))
    return mean if least == most else f"{mean} ({least} to {most})"


def spread(seeds: Sequence[int]) -> Printed:
    """R@1 and R@100P of 1,500 places by `SEEDS`, whichever are asked for: the median, and the least to the most."""
    rows = []
    for name, motion in itertools.product(PRESETS, (NONE, "any")):
        found = drives_compared((WHOLE,), STDP, name, SEEDS, motion)
        cells = []
        for metrics in (found.adapted, found.learning):
            values = 100 * np.array([(one.recall_at_1, one.recall_at_100_precision) for one in metrics])
            cells += [f"{np.median(row):.1f} ({row.min():.1f} to {row.max():.1f})" for row in values.T]
        rows.append([f"`{name}`", "its image alone" if motion == NONE else "the filter", *cells])
    heads = [f"{what}, {figure}" for what in ("adapted", "and gains") for figure in ("R@1", "R@100P")]
    yield BenchmarkTable(["preset", "an answer teaches by", *heads], rows, record="season-seeds")


def carried(seeds: Sequence[int]) -> Printed:
    """What a drive teaches for other places, by answers of images alone; frozen, while the network adapts."""
    rows = []
    for here, there in ((NEAR, FAR), (FAR, NEAR)):
        cells: list[list[Metrics]] = [[], [], []]
        for seed in seeds:
            taught = driven(learned(here, STDP, seed), here, LEARNING).season
            model, frozen = learned(there, STDP, seed), dataclasses.replace(ADAPTING, season=taught)
            for kept, how in zip(cells, (ADAPTING, frozen, LEARNING), strict=True):
                kept.append(figures(driven(model, there, how).scores, there))
        rows.append([str(here), str(there), *map(recall, cells)])
    columns = ["learned on", "queried", "adapted", "and that season, frozen", "and its own, learned"]
    yield BenchmarkTable(columns, rows, record="season-carried")


def known(seeds: Sequence[int]) -> Printed:
    """What a part of the route teaches in another season, its places known; for other places, frozen."""
    rows = []
    for here, there in ((NEAR, FAR), (FAR, NEAR)):
        cells: list[list[Metrics]] = [[], []]
        taught = 0
        for seed in seeds:
            model, other = learned(here, STDP, seed), learned(there, STDP, seed)
            queries = places(here.section, 1 - here.season, model.config)[0]
            season = paired(model, queries, np.arange(len(queries)), ALL_CORES)
            taught += season.taught
            for kept, how in zip(cells, (ADAPTING, dataclasses.replace(ADAPTING, season=season)), strict=True):
                kept.append(figures(driven(other, there, how).scores, there))
        rows.append([str(here), f"{taught / len(seeds):.0f}", str(there), *map(recall, cells)])
    columns = ["pairs of", "taught", "queried", "adapted", "and that season, frozen"]
    yield BenchmarkTable(columns, rows, record="season-known")


def assured(seeds: Sequence[int]) -> Printed:
    """Whether probabilities hold under gains, and what is recalled before the surest errors; all is on the map."""
    rows = []
    for section in (PlacesSection("nordland_all", 500, 1000), FAR.section):
        for season, asked in enumerate(("winter", "summer")):
            way, row = SeasonedMap(section, season), [f"{section.end - section.first:,} places, queried in {asked}"]
            models = [learned(way, STDP, seed) for seed in seeds]
            calibrations = [calibration_of(model, ALL_CORES) for model in models]
            for how in (ADAPTING, LEARNING):
                drives = [driven(model, way, how) for model in models]
                row += assurance([drive.scores for drive in drives], calibrations)
            rows.append(row)
    heads = ("calibration error", "right / accepted at .95", "recalled before error 1 / 2 / 3")
    columns = ["map", *(f"{how}: {head}" for how in ("adapted", "gains") for head in heads)]
    yield BenchmarkTable(columns, rows, record="season-assured")


def assurance(scores: Sequence[NDArray[np.float64]], calibrations: Sequence[Calibration | None]) -> list[str]:
    """Cells of one way to ask, means over seeds: scores (n, places), of which query i shows place i."""
    found = []
    for some, known in zip(scores, calibrations, strict=True):
        if known is None:
            raise TypeError("an integer model has a calibration")
        chances, right = known.probabilities(some, 0.0), some.argmax(axis=1) == np.arange(len(some))
        good = chances >= known.keeping(0.95, 0.0).probability
        best = np.sort(some, axis=1)
        order = np.argsort(best[:, -2] - best[:, -1], kind="stable")
        before = [np.flatnonzero(~right[order])[k] - k for k in range(3)]
        found.append((reliability(chances, right)[1], right[good].mean(), good.mean(), *np.array(before) / len(some)))
    error, precision, accepted, *recalled = (100 * np.mean(found, axis=0)).tolist()
    return [f"{error:.1f}", f"{precision:.1f} / {accepted:.1f}", " / ".join(f"{value:.1f}" for value in recalled)]


def astray(seeds: Sequence[int]) -> Printed:
    """What teaches on the map, and on a map that has none of the places: after nothing, and after a drive on it."""
    rows = []
    for motion, name in ((NONE, "its image alone"), ("any", "the filter")):
        found: dict[str, list[Drive]] = {str(NEAR): [], str(FAR): [], f"{FAR} after {NEAR}": []}
        for seed in seeds:
            model = learned(NEAR, STDP, seed)
            on = driven(model, NEAR, LEARNING, motion)
            warm = dataclasses.replace(LEARNING, season=on.season)
            drives = (on, driven(model, FAR, LEARNING, motion), driven(model, FAR, warm, motion))
            for kept, drive in zip(found.values(), drives, strict=True):
                kept.append(drive)
        for asked, drives_of in found.items():
            taught = np.mean(np.concatenate([turn.taught for drive in drives_of for turn in drive.turns]))
            shares = [drive.least_and_most for drive in drives_of]
            least, most = min(share[0] for share in shares), max(share[1] for share in shares)
            rows.append([name, asked, f"{100 * taught:.1f}", f"{100 * least:.0f} to {100 * most:.0f}"])
    columns = [
        "an answer by",
        f"queries of a map of {NEAR}",
        "taught, %",
        f"sure of any {RECENT} answers, %",
    ]
    yield BenchmarkTable(columns, rows, record="season-astray")


def guarded(seeds: Sequence[int]) -> Printed:
    """What a drive through the synthetic world teaches in other seasons, stuck, and off the map, whatever the seeds."""
    world, other = World(0, 100), World(1, 100)
    model = train_images(np.stack([render(world, place, "summer") for place in range(100)]))
    drives = {season: [(render(world, k, season), k) for k in range(100)] for season in ("winter", "rain", "night")}
    half, away = drives["winter"][:50], [(render(other, k, "winter"), OFF) for k in range(100)]
    drives |= {"stuck, after 50 images": half + half[-1:] * 100, "off the map, after 50 images": half + away}
    rows = []
    for name, drive in (drives | {"off the map": away}).items():
        robot, taught, wrong = Localizer(model, learn=True), 0, 0
        for number, (image, place) in enumerate(drive):
            before = robot.season
            match, after = robot.update(image), robot.season
            if before is None or after is None:
                raise TypeError("a robot that learns knows a season")
            teaches = after.taught > before.taught and number >= len(drive) - 100
            taught, wrong = taught + teaches, wrong + (teaches and abs(match.place - place) > 1)
        rows.append([name, f"{taught} / {wrong}"])
    yield BenchmarkTable(["100 images", "taught / wrong"], rows, record="season-guard")


def settings(seeds: Sequence[int]) -> BenchmarkTable:
    """The numbers of learning, each changed by itself."""
    changes: list[tuple[str, str, float]] = [("as they are", "PRIOR", gains.PRIOR)]
    changes += [(f"{number} {value:g}", number, value) for number, some in SETTINGS.items() for value in some]
    rows = [["without gains", *(_chosen(way, ADAPTING, seeds) for way in CHOSEN)]]
    for name, number, value in changes:
        with patch.object(teaching if number == "ALONE" else gains, number, value):
            rows.append([name, *(_chosen(way, LEARNING, seeds) for way in CHOSEN)])
    columns = ["numbers", *(f"{way.section}, queried in {'summer' if way.season else 'winter'}" for way in CHOSEN)]
    return BenchmarkTable(columns, rows)


def _chosen(way: SeasonedMap, asking: Asking, seeds: Sequence[int]) -> str:
    """The recall of a map under some settings; how many taught, and how many of them were wrong."""
    drives = [driven(learned(way, STDP, seed), way, asking) for seed in seeds]
    taught, wrong = np.sum([teachers(drive.turns, truth_of(way)) for drive in drives], axis=0).tolist()
    return f"{recall([figures(drive.scores, way) for drive in drives])}; {taught} / {wrong}"


PARTS: Mapping[str, Callable[[Sequence[int]], Printed]] = {
    "compared": compared,
    "spread": spread,
    "carried": carried,
    "known": known,
    "assured": assured,
    "astray": astray,
    "guarded": guarded,
}


@program("nordland", "nordland_long", "gardens")
@click.option("--part", "parts", type=click.Choice(list(PARTS)), multiple=True, help="Print only this (all).")
@click.option("--chosen", is_flag=True, help="The settings that were compared, and the maps of that.")
@seeds_option
def main(seeds: Sequence[int], chosen: bool, parts: Sequence[str]) -> Printed:
    """Recall, R@1 / R@100P / AUC, with gains and without."""
    if chosen:
        yield settings(seeds)
        return
    for part in parts or PARTS:
        yield from PARTS[part](seeds)
