"""From pixels to places in one run: neurons that hear the cells of the front end, beside the host's rates of the same.

    LAVA_VPR_DATA=... python -m benchmarks front_end.direct [--record] [--choose]

Nordland, learned in summer and queried in winter, exact matches. Numbers of the front end, lengths, threshold and
inhibition were chosen on places 0:200 in both directions and on Gardens Point 0:50, both drives learned (at most three
places off): ``--choose`` makes that search, benchmarks/front_end/direct.log is its log. Scores within 1.2 of the best,
the standard error of 400 answers, do not differ for sure; among these trials we took the one that is highest on
Nordland. With 49 steps the board takes at most 150 uJ as modelled; `fast` has 32.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import click
import numpy as np

from benchmarks.places import ALL_CORES, SECTIONS, TEMPLATES, PlacesSection, answer, learn, near, places
from benchmarks.program import BenchmarkTable, Printed, fraction, program, recall, seeds_option
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.inputs.encoder import Keep
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_settings import front_end
from lava_vpr.matching.evaluation import Metrics, Recall
from lava_vpr.model import Model, integer_model
from lava_vpr.recognition import DECODERS_ONLY, recognise
from lava_vpr.training.loop import integer_network, train
from lava_vpr.training.measuring import reference_responses

DIRECT = {"encoder": {"kind": "frontend-direct"}}
LENGTHS: Mapping[str, Sequence[tuple[int, int, int]]] = {
    "loihi": ((26, 10, 8), (24, 12, 8), (22, 14, 8), (22, 12, 10), (26, 12, 6), (24, 14, 6), (23, 13, 8)),
    "fast": ((12, 9, 6), (12, 8, 7), (13, 9, 5), (11, 10, 6), (11, 8, 8)),
}
"""Levels, race and steps of reading of each preset that are tried."""
THRESHOLDS, INHIBITIONS = (1.8, 2.4, 3.2, 4.2, 5.2), (0.11, 0.17, 0.25)
"""Thresholds and inhibitions that are tried."""
FORMS = {"top": (0.85, 1.0), "pixel_octaves": (3.5, 4.0, 4.5, 5.0), "budget": (105, 120)}
"""Numbers of the front end that are tried, at the lengths of ``loihi``, with both inhibitions of `FIRMNESS`."""
FIRMNESS = (0.17, 0.25)
CHOOSING = ((PlacesSection("nordland", 0, 200), 0), (PlacesSection("gardens", 0, 50), 3))
"""Where settings are chosen, and how many places off an answer may be."""


@program("nordland", "gardens")
@click.option("--choose", is_flag=True, help="The search for the front end, lengths and threshold.")
@seeds_option
def main(seeds: Sequence[int], choose: bool) -> Printed:
    """Recall of neurons that hear the cells themselves."""
    if choose:
        yield forms_chosen()
        for name in LENGTHS:
            yield chosen(name)
    else:
        yield compared(seeds)


class SearchCase(NamedTuple):
    """A model, with which of the rules it learned, and the queries that it is asked, right up to ``off`` places off."""

    rule: int
    model: Model
    queries: EncodedTraverse
    off: int


def tuned(model: Model, config: Config) -> Model:
    """``model`` with the settings of queries in ``config``."""
    own = integer_model(model, "the search")
    network = integer_network(own.learned, config, own.stretches, own.activity)
    responses = reference_responses(network, own.activity, own.places, config, ALL_CORES)
    return dataclasses.replace(model, config=config, network=network, responses=responses)


def places_of(section: PlacesSection, which: int, config: Config, form: FrontEnd | None) -> EncodedTraverse:
    """References (0) or queries (1) of a section, as ``form`` of the front end sees them; None: the configured one."""
    (found,) = places(section, which, config)
    if form is None:
        return found
    bursts = [form.bursts_of(grey).reshape(-1) for grey in found.kept(Keep.GREY, "the search")]
    return dataclasses.replace(found, activity=np.array(bursts, np.float32))


def cases_of(rules: Sequence[Config], form: FrontEnd | None = None) -> list[SearchCase]:
    """A model of each section, season and rule, and the queries of the other season."""
    every = itertools.product(range(len(rules)), CHOOSING, (0, 1))
    return [
        SearchCase(
            number,
            train([places_of(section, season, rules[number], form)], rules[number], pool=ALL_CORES),
            places_of(section, 1 - season, rules[number], form),
            off,
        )
        for number, (section, off), season in every
    ]


def figures(cases: Sequence[SearchCase], rules: Sequence[Config]) -> list[list[float]]:
    """R@1 and AUC of each case in percent, one after another, of each of ``rules``, the settings of queries."""
    found: list[list[float]] = [[] for _ in rules]
    for case in cases:
        config = rules[case.rule]
        truth = near(len(case.queries), case.off)
        metrics = recognise(tuned(case.model, config), case.queries, truth, DECODERS_ONLY, pool=ALL_CORES).metrics
        own = Recall.of(metrics[config.decoder.default])
        found[case.rule] += [100 * own.recall_at_1, 100 * own.auc]
    return found


def row(named: Sequence[object], found: Sequence[Sequence[float]]) -> tuple[list[str], float]:
    """A row of a search, and its score."""
    score = scored(found)
    cells = [" ".join(f"{value:.1f}" for value in one) for one in found]
    return [*map(str, named), f"{score:.2f}", *cells], score


def trials(name: str) -> Iterator[tuple[list[str], float]]:
    """Every trial of lengths, threshold and inhibition of a preset, and its score."""
    for levels, race, reading in LENGTHS[name]:
        lengths = {"direct_levels": levels, "direct_race": race, "read_steps": reading}
        base = update(update(preset(name), DIRECT), {"encoder": lengths})
        rules = [update(base, {"learning": TEMPLATES}), base]
        cases = cases_of(rules)
        for threshold, inhibition in itertools.product(THRESHOLDS, INHIBITIONS):
            changes = {"read_threshold": threshold, "read_inhibition": inhibition}
            found = figures(cases, [update(config, {"encoder": changes}) for config in rules])
            yield row([levels, race, reading, front_end(levels, race, reading).steps, *changes.values()], found)


def forms_chosen() -> BenchmarkTable:
    """Numbers of the front end, the best first: each is the mean of two inhibitions."""
    base = update(preset("loihi"), DIRECT)
    spec = base.encoder.direct
    rules, found = [update(base, {"learning": TEMPLATES}), base], []
    for values in itertools.product(*FORMS.values()):
        cases = cases_of(rules, dataclasses.replace(spec, **dict(zip(FORMS, values, strict=True))))
        both = [
            figures(cases, [update(rule, {"encoder": {"read_inhibition": each}}) for rule in rules])
            for each in FIRMNESS
        ]
        found.append(row(values, np.mean(both, axis=0).tolist()))
    found.sort(key=lambda one: -one[1])
    return BenchmarkTable(
        [*FORMS, "score", "templates", "STDP"], [cells for cells, _ in found], (SEARCHED.format("loihi"),)
    )


def scored(found: Sequence[Sequence[float]]) -> float:
    """The mean of the figures of several rules, in which each query counts alike: 200 of Nordland, 50 of Gardens."""
    half = len(found[0]) // 2
    return float(np.mean([0.8 * np.mean(one[:half]) + 0.2 * np.mean(one[half:]) for one in found]))


def chosen(name: str) -> BenchmarkTable:
    """The trials of a preset, the best first."""
    rows = sorted(trials(name), key=lambda one: -one[1])
    heads = ["levels", "race", "reading", "steps", "threshold", "inhibition", "score", "templates", "STDP"]
    return BenchmarkTable(heads, [cells for cells, _ in rows], (SEARCHED.format(name),))


SEARCHED = (
    "preset {}; R@1, AUC of nordland, its other direction, gardens, its other; score: mean of all queries, both rules"
)


WAYS: tuple[tuple[str, str, str, tuple[int, ...]], ...] = (
    ("loihi", "frontend-direct", "stdp", ()),
    ("loihi", "frontend-direct", "template", ()),
    *(("loihi", "frontend-direct", "stdp", lengths) for lengths in ((23, 13, 8), (24, 12, 8), (26, 12, 6))),
    ("loihi", "frontend", "stdp", ()),
    ("loihi", "frontend", "template", ()),
    ("fast", "frontend-direct", "stdp", ()),
    ("fast", "frontend", "stdp", ()),
)
"""Preset, input and rule of each row, and its levels, race and reading if they are not the preset's."""


def compared(seeds: Sequence[int]) -> BenchmarkTable:
    """Neurons that hear the cells beside those that get rates of their counts, and beside HOG."""
    rows, hog = [], None
    for name, kind, rule, lengths in WAYS:
        encoder = {"kind": kind, **dict(zip(("direct_levels", "direct_race", "read_steps"), lengths, strict=False))}
        config = update(preset(name), {"encoder": encoder, "learning": TEMPLATES if rule == "template" else {}})
        found = [_of_seed(dataclasses.replace(config, seed=seed), () if hog else ("hog",)) for seed in seeds]
        before = config.encoder.front_end
        steps = config.steps + (0 if before is None or config.encoder.direct else before.steps)
        way = f"`--preset {name} --input {kind}`" + (", lengths {}, {}, {}".format(*lengths) if lengths else "")
        decoder = config.decoder.default
        rows.append([way, rule, str(steps), *_columns(found, decoder), _spread(found, decoder)])
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
