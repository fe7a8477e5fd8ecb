"""All the energy of a query: every preset on Kapoho Bay with its host, on a processor alone, and cosine, HOG and SAD.

    LAVA_VPR_DATA=... python -m benchmarks energy.whole [--rounds 5]

Nordland, summer learned, winter recognised, exact matches, seed 0. Recall is the mean of five sections of 100 places,
energy that of the first. What the board takes is modelled; what the processor does is timed here, single queries on one
thread, and multiplied by an assumed power. All take turns, and the quickest round counts: other programs only delay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import click
import numpy as np

from benchmarks.places import SECTIONS, encoded, images_of, learn
from benchmarks.program import BenchmarkTable, Printed, program, turns
from benchmarks.results.rows import ResultRow, measure
from benchmarks.results.tables import FIVE
from lava_vpr.backends.interface import HostBackend
from lava_vpr.bench.measure.matchers import alone, beside_board
from lava_vpr.bench.measure.timing import each_image, measure_encoding
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import AnsweringWay, on_board
from lava_vpr.bench.show.tables import energy
from lava_vpr.config import PRESETS, preset
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost.costs import Modelled, modelled
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.errors import InputError
from lava_vpr.inputs.patches import hog, patch_normalised
from lava_vpr.traverse import open_traverse

BEFORE = {"cosine": "encoding", "hog": "descriptors", "sad": "patches"}
"""What an image goes through before each baseline."""
INTEGER = tuple(name for name in PRESETS if name != "paper")


def recalls(name: str) -> dict[str, float]:
    """R@1 of preset ``name`` (under its own name) and of the baselines, mean over the sections."""
    row = ResultRow(name, preset(name), FIVE, tuple(BEFORE))
    found = [measure(row, section, 0) for section in FIVE]
    named = {name: "network"} | {matcher: matcher for matcher in BEFORE}
    return {own: float(np.mean([one[matcher][0] for one in found])) / 100 for own, matcher in named.items()}


def asked(name: str) -> tuple[QuerySet, Modelled]:
    """The queries of the first section to preset ``name``, and what they cost on Kapoho Bay."""
    model = learn(SECTIONS[0], preset(name))
    queries = QuerySet.of(model, encoded("winter", model.config.encoder).take(slice(*SECTIONS[0])))
    trains = HostBackend().trains(model, queries.shown)
    plan = plan_of(model, KAPOHO_BAY)
    return queries, modelled(plan, count_events(plan, trains))


def timed(queries: Mapping[str, QuerySet]) -> dict[str, Callable[[], float]]:
    """What is timed on the processor, medians of single queries in ms; matchers take the first."""
    first, images = queries[INTEGER[0]], open_traverse(images_of("nordland", "winter"), places=SECTIONS[0])
    made: dict[str, Callable[[], float]] = {
        "encoding": lambda: float(np.median(measure_encoding(images, preset(INTEGER[0])).milliseconds)),
        "descriptors": lambda: float(np.median(each_image(images, hog))),
        "patches": lambda: float(np.median(each_image(images, patch_normalised))),
    }
    made |= {name: partial(alone, first, name) for name in BEFORE}
    for name, some in queries.items():
        made |= {f"{name}, part": partial(beside_board, some), f"{name}, host": partial(alone, some, "lava-vpr")}
    return made


@program("nordland")
@click.option("--rounds", default=5, show_default=True)
def main(rounds: int) -> Printed:
    """What a query costs in all, by preset and matcher."""
    found = {name: recalls(name) for name in INTEGER}
    every = {name: asked(name) for name in INTEGER}
    taken = turns(timed({name: queries for name, (queries, _) in every.items()}), rounds)
    ms = {name: min(values) for name, values in taken.items()}
    boards = []
    for name, (_, costs) in every.items():
        way = on_board(costs, found[name][name], ms[f"{name}, part"], ms["encoding"])
        if way is None:
            raise InputError(f"{name}: {costs.unavailable}")
        boards.append(way)
    ways = [AnsweringWay("host", found[name][name], ms[f"{name}, host"], ms["encoding"]) for name in every]
    ways += [AnsweringWay(name, found[INTEGER[0]][name], ms[name], ms[before]) for name, before in BEFORE.items()]
    titles = [f"{name}, {where}" for where in ("Kapoho Bay", "no board") for name in every]
    table = energy([*boards, *ways], [*titles, "cosine", "HOG", "SAD"])
    columns, *rows = zip(table.columns, *table.rows, strict=True)
    wrapped = frozenset(range(1, len(columns)))
    yield BenchmarkTable(columns, rows, table.notes, table.title, long=wrapped, record="energy")
