"""All the energy of a query: on Kapoho Bay with its host, on a processor alone, and by cosine, HOG and SAD there.

    LAVA_VPR_DATA=... python -m benchmarks energy.whole [--rounds 5] [--record]

Every preset, and the longer maps and views of the results; recall is that of docs/results.json, energy that of the
first section with seed 0. What the board takes is modelled; what the processor does is timed here, single queries on
one thread, and multiplied by an assumed power. All take turns, and the quickest round counts: other programs only
delay. `make pages` then shows the energies beside recall on all pages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import click
import numpy as np

from benchmarks.places import FOLDERS, images_of, learned, places
from benchmarks.program import BenchmarkTable, Printed, program, turns
from benchmarks.results.rows import Record, ResultRow
from benchmarks.results.tables import DEFAULT, ENERGY_OF, GARDENS, LEARNED, SIMPLER
from lava_vpr.backends.interface import HostBackend
from lava_vpr.bench.measure.matchers import alone, beside_board
from lava_vpr.bench.measure.timing import each_image, measure_encoding
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import AnsweringWay, on_board
from lava_vpr.bench.show.tables import energy
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost.costs import Modelled, modelled
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.errors import InputError
from lava_vpr.inputs.patches import hog, patch_normalised
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.traverse import open_traverse

BEFORE = {"hog": "descriptors", "sad": "patches"}
"""What an image goes through before baselines that do not compare the inputs."""
COUNTED = 100
"""Queries whose spikes are counted, and that are timed: the first ones."""


def rivals(case: str) -> tuple[str, ...]:
    """The baselines that are timed on the places of a case: those of the other presets are the default one's."""
    return ("cosine", *BEFORE) if case == DEFAULT else () if case in LEARNED else ("cosine",)


def asked(row: ResultRow) -> tuple[QuerySet, Modelled]:
    """The first queries to a model of the first section, and what they cost on Kapoho Bay."""
    model = learned(row.sections[0], row.config)
    (images,) = places(row.sections[0], 1, model.config, ViewsConfig())
    queries = QuerySet.of(model, images.take(slice(COUNTED)))
    trains = HostBackend().trains(model, queries.shown)
    return queries, modelled(plan := plan_of(model, KAPOHO_BAY), count_events(plan, trains))


def dataset_of(row: ResultRow) -> str:
    """The dataset of a row of the results."""
    return "gardens" if row.sections == GARDENS else "nordland"


def encoding_of(row: ResultRow) -> str:
    """What encodes a row's images: the presets' encoders differ in their orientations, and each is timed once."""
    return f"{dataset_of(row)}, encoding in {row.config.encoder.orientations} orientations"


def stages() -> dict[str, Callable[[], float]]:
    """What an image goes through, medians of single images in ms."""
    images = {name: open_traverse(images_of(name, FOLDERS[name][1])) for name in ("nordland", "gardens")}

    def encoding(row: ResultRow) -> float:
        return float(np.median(measure_encoding(images[dataset_of(row)], row.config).milliseconds))

    return {encoding_of(row): partial(encoding, row) for row in ENERGY_OF.values()} | {
        "descriptors": lambda: float(np.median(each_image(images["nordland"], hog))),
        "patches": lambda: float(np.median(each_image(images["nordland"], patch_normalised))),
    }


def matchers(every: Mapping[str, QuerySet]) -> dict[str, Callable[[], float]]:
    """What is done for a query after that, by case, medians of single queries in ms."""
    made: dict[str, Callable[[], float]] = {}
    for case, queries in every.items():
        made |= {f"{case}, part": partial(beside_board, queries), f"{case}, host": partial(alone, queries, "lava-vpr")}
        made |= {f"{case}, {name}": partial(alone, queries, name) for name in rivals(case)}
    return made


@program("nordland", "nordland_long", "gardens")
@click.option("--rounds", default=5, show_default=True)
def main(rounds: int) -> Printed:
    """What a query costs in all, by preset, map and matcher."""
    record, every = Record.read(), {case: asked(row) for case, row in ENERGY_OF.items()}
    timed = stages() | matchers({case: queries for case, (queries, _) in every.items()})
    ms = {name: min(values) for name, values in turns(timed, rounds).items()}
    ways: dict[str, AnsweringWay] = {}
    cells = []
    for case, row in ENERGY_OF.items():
        recall, encoding = record.mean(row)[0] / 100, ms[encoding_of(row)]
        way = on_board(every[case][1], recall, ms[f"{case}, part"], encoding)
        if way is None:
            raise InputError(f"{case}: {every[case][1].unavailable}")
        ways |= {
            f"{case}, Kapoho Bay": way,
            f"{case}, no board": AnsweringWay("", recall, ms[f"{case}, host"], encoding),
        }
        cells += [record.cell(row, figures=1)] * 2
        for name in rivals(case):
            before = ms[BEFORE[name]] if name in BEFORE else encoding
            ways[f"{case}, {SIMPLER[name]}"] = AnsweringWay(
                "", record.mean(row, name)[0] / 100, ms[f"{case}, {name}"], before
            )
            cells.append(record.cell(row, name, figures=1))
    table = energy([*ways.values()], [*ways])
    columns, *rows = zip(table.columns, ("R@1, percent", *cells), *table.rows[1:], strict=True)
    wrapped = frozenset(range(1, len(columns)))
    yield BenchmarkTable(columns, rows, table.notes, table.title, long=wrapped, record="energy")
