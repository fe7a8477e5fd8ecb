"""From pixels to places in one run: neurons that hear the cells of the front end, beside the host's rates of the same.

    LAVA_VPR_DATA=... python -m benchmarks front_end.direct [--record] [--choose]

Nordland, summer learned and winter asked, exact matches. Lengths, threshold and inhibition were chosen on places 0:200
in both directions and on Gardens Point 0:50, both drives learned (at most three places off): ``--choose`` makes that
search, benchmarks/front_end/direct.log is its log. Each length has as many steps as a presentation may take: with 53,
accesses of all neurons of the front end stay below 2,097,152; those of `fast` are 32.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import click
import numpy as np

from benchmarks.places import ALL_CORES, SECTIONS, TEMPLATES, PlacesSection, answer, learn, learned, near, places
from benchmarks.program import BenchmarkTable, Printed, fraction, program, recall, seeds_option
from lava_vpr.config import Config, integer_config, preset
from lava_vpr.configfile import update
from lava_vpr.inputs.front_end import front_end
from lava_vpr.matching.evaluation import Metrics, Recall
from lava_vpr.model import Model, integer_model
from lava_vpr.recognition import DECODERS_ONLY, recognise
from lava_vpr.training.loop import integer_network
from lava_vpr.training.measuring import reference_responses

DIRECT = {"encoder": {"kind": "frontend-direct"}}
LENGTHS: Mapping[str, Sequence[tuple[int, int, int]]] = {
    "loihi": (
        *((26, 14, 8), (24, 12, 12), (22, 14, 12), (22, 12, 14), (20, 14, 14)),
        *((20, 12, 16), (20, 10, 18), (18, 14, 16), (16, 14, 18), (16, 12, 20)),
    ),
    "fast": ((16, 8, 3), (14, 8, 5), (12, 10, 5), (12, 9, 6), (12, 8, 7), (10, 10, 7), (10, 9, 8)),
}
"""Levels, race and steps of reading of each preset that are tried."""
THRESHOLDS, INHIBITIONS = (0.45, 0.67, 1.0, 1.5), (0.45, 0.67, 1.0)
"""Multiples of a preset's own threshold, and inhibitions, that are tried."""
CHOOSING = ((PlacesSection("nordland", 0, 200), 0), (PlacesSection("gardens", 0, 50), 3))
"""Where settings are chosen, and how many places off an answer may be."""


@program("nordland", "nordland_long", "gardens")
@click.option("--choose", is_flag=True, help="The search for lengths, threshold and inhibition.")
@seeds_option
def main(seeds: Sequence[int], choose: bool) -> Printed:
    """Recall of neurons that hear the cells themselves."""
    if choose:
        for name in LENGTHS:
            yield chosen(name)
    else:
        yield compared(seeds)


def tuned(model: Model, config: Config) -> Model:
    """``model`` with the settings of queries in ``config``."""
    own = integer_model(model, "the search")
    network = integer_network(own.learned, config, own.stretches, own.activity)
    responses = reference_responses(network, own.activity, own.places, config, ALL_CORES)
    return dataclasses.replace(model, config=config, network=network, responses=responses)


def figures(models: Mapping[tuple[int, int], Model], config: Config) -> list[float]:
    """R@1 and AUC of each case in percent, one after another."""
    found = []
    for number, (section, off) in enumerate(CHOOSING):
        for season in (0, 1):
            queries = places(section, 1 - season, config)[0]
            model = tuned(models[number, season], config)
            metrics = recognise(model, queries, near(len(queries), off), DECODERS_ONLY, pool=ALL_CORES).metrics
            own = Recall.of(metrics[config.decoder.default])
            found += [100 * own.recall_at_1, 100 * own.auc]
    return found


def trials(name: str) -> Iterator[tuple[list[Any], float]]:
    """Every trial of a preset, and its score: the mean of R@1 and AUC, Nordland and Gardens alike, of both rules."""
    own = integer_config(preset(name), "the search").network
    for levels, race, reading in LENGTHS[name]:
        lengths = {"direct_levels": levels, "direct_race": race, "read_steps": reading}
        base = update(update(preset(name), DIRECT), {"encoder": lengths})
        rules = [update(base, {"learning": TEMPLATES}), base]
        models = [
            {
                (k, season): learned(section, config, season)
                for k, (section, _) in enumerate(CHOOSING)
                for season in (0, 1)
            }
            for config in rules
        ]
        for threshold, inhibition in itertools.product(THRESHOLDS, INHIBITIONS):
            changes = {"threshold": round(threshold * own.threshold, 4), "inhibition": inhibition}
            pairs = zip(models, rules, strict=True)
            found = [figures(each, update(config, {"network": changes})) for each, config in pairs]
            score, steps = float(np.mean(found)), front_end(levels, race, reading).steps
            cells = [" ".join(f"{value:.1f}" for value in one) for one in found]
            yield [levels, race, reading, steps, *changes.values(), f"{score:.2f}", *cells], score


def chosen(name: str) -> BenchmarkTable:
    """The trials of a preset, the best first."""
    rows = sorted(trials(name), key=lambda row: -row[1])
    heads = ["levels", "race", "reading", "steps", "threshold", "inhibition", "score", "templates", "STDP"]
    return BenchmarkTable(heads, [[str(cell) for cell in row] for row, _ in rows], (SEARCHED.format(name),))


SEARCHED = "preset {}; R@1, AUC of nordland, of its other direction, of gardens, of its other; score: mean of all, both"


WAYS: tuple[tuple[str, str, str], ...] = (
    ("loihi", "frontend-direct", "stdp"),
    ("loihi", "frontend-direct", "template"),
    ("loihi", "frontend", "stdp"),
    ("loihi", "frontend", "template"),
    ("fast", "frontend-direct", "stdp"),
    ("fast", "frontend", "stdp"),
)
"""Preset, input and rule of each row."""


def compared(seeds: Sequence[int]) -> BenchmarkTable:
    """Neurons that hear the cells beside those that get rates of their counts, and beside HOG."""
    rows, hog = [], None
    for name, kind, rule in WAYS:
        config = update(
            preset(name), {"encoder": {"kind": kind}, **({"learning": TEMPLATES} if rule == "template" else {})}
        )
        found = [_of_seed(dataclasses.replace(config, seed=seed), () if hog else ("hog",)) for seed in seeds]
        before = config.encoder.front_end
        steps = 0 if before is None else before.steps + (0 if config.encoder.direct else preset(name).network.steps)
        decoder = config.decoder.default
        rows.append(
            [f"`--preset {name} --input {kind}`", rule, str(steps), *_columns(found, decoder), _spread(found, decoder)]
        )
        hog = hog or ["HOG of the same images", "", "", *_columns(found, "hog"), _spread(found, "hog")]
    heads = ["network", "learned by", "steps", "five sections", "500 in one map", "R@1 of 500, range of seeds"]
    return BenchmarkTable(heads, [*rows, hog or []], record="front-end-direct")


Found = list[list[Mapping[str, Metrics]]]


def _of_seed(config: Config, rivals: tuple[str, ...]) -> Found:
    """Figures by matcher of the five sections, and of 500 places in one map."""
    found = [answer(learn(part, config), part, rivals=rivals).metrics for part in (*SECTIONS, (0, 500))]
    return [found[:-1], found[-1:]]


def _columns(found: Sequence[Found], matcher: str) -> list[str]:
    return [recall([one[matcher] for part in parts for one in part]) for parts in zip(*found, strict=True)]


def _spread(found: Sequence[Found], matcher: str) -> str:
    values = [one[1][0][matcher].recall_at_1 for one in found]
    return f"{fraction(min(values))} to {fraction(max(values))}"
