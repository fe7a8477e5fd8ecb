"""All the energy of a query with the spiking front end on Kapoho Bay, beside the same and cosine on a processor alone.

    LAVA_VPR_DATA=... python -m benchmarks front_end.energy [--rounds 5] [--record]

Frames of Nordland, and windows of events of LENS's example: a map of 100 places each, seed 0, one view. The board runs
both networks, one after the other; the host reads an image, makes grey levels or counts of events of it, draws spikes
of the counts that it has read back, and decodes. Where neurons hear the cells themselves, all is one run, and the host
decodes alone. As in `benchmarks.energy.whole`, its work is timed, times an assumed power, and what the board does is
modelled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.events.lens import ALL, WAYS, drive, truth
from benchmarks.places import ALL_CORES, FOLDERS, images_of, near
from benchmarks.program import BenchmarkTable, Printed, program, turns
from lava_vpr.backends.interface import HostBackend
from lava_vpr.bench.measure.matchers import alone, beside_board
from lava_vpr.bench.measure.timing import each_image, measure_encoding
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import AnsweringWay, from_pixels, on_board
from lava_vpr.bench.show.tables import energy
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.constants import Estimate, total
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.bundle.front_end import front_end_of
from lava_vpr.deploy.cost.costs import modelled
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.deploy.cost.front_end import front_end_costs
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import InputError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, open_traverse

SEEN = slice(0, 100, 5)
"""Queries whose spikes in the front end are counted."""
COSINE = Comparison(rivals=("cosine",))


def asked(
    config: Config, references: Traverse, queries: Traverse, right: NDArray[np.bool_]
) -> tuple[QuerySet, Metrics, Metrics]:
    """Queries to a model of the references, and what it and cosine recall."""
    model = train([encode_traverse(references, config.encoder, Keep.ALL)], config, pool=ALL_CORES)
    images = encode_traverse(queries, config.encoder, Keep.ALL)
    found = recognise(model, images, right, COSINE, pool=ALL_CORES)
    return QuerySet.of(model, images), found.metrics[found.default], found.metrics["cosine"]


def with_front_end(way: AnsweringWay | None, spec: FrontEnd, grey: NDArray[np.uint8]) -> AnsweringWay:
    """A way through Kapoho Bay with the front end before it on the same board: its steps, registers and packets."""
    if way is None:
        raise InputError(f"{KAPOHO_BAY.title}: has no energies")
    costs = front_end_costs(spec, placed(spec, KAPOHO_BAY), PixelBlock(grey))
    nothing = Estimate(0, 0, 0)
    dynamic = [*(costs.dynamic_microjoules or {}).values(), *(costs.between_microjoules or {}).values()]
    return replace(
        way,
        dynamic=total([way.dynamic or nothing, *dynamic]),
        static=(way.static or nothing) + (costs.static_millijoules or nothing) * 1e3,
    )


def ways(
    title: str, config: Config, references: Traverse, queries: Traverse, right: NDArray[np.bool_], rounds: int
) -> dict[str, AnsweringWay]:
    """The ways to answer the queries, by what they are called."""
    plain = update(config, {"encoder": {"kind": preset("loihi").encoder.kind}})
    (spiking, own, _), (other, _, cosine) = (asked(one, references, queries, right) for one in (config, plain))
    spec = config.encoder.front_end or FrontEnd()
    timed: dict[str, Callable[[], float]] = {
        "seen": lambda: float(np.median(each_image(queries, spec.seen))),
        "spiking": lambda: float(np.median(measure_encoding(queries, config).milliseconds)),
        "plain": lambda: float(np.median(measure_encoding(queries, plain).milliseconds)),
        "part": partial(beside_board, spiking),
        "host": partial(alone, spiking, "lava-vpr"),
        "cosine": partial(alone, other, "cosine"),
    }
    ms = {name: min(values) for name, values in turns(timed, rounds).items()}
    plan, trains = plan_of(spiking.model, KAPOHO_BAY), HostBackend().trains(spiking.model, spiking.shown)
    behind = on_board(modelled(plan, count_events(plan, trains)), own.recall_at_1, ms["part"], ms["seen"])
    title = f"{title}, {spec.steps} steps"
    return {
        f"{title}, Kapoho Bay": with_front_end(behind, spec, spiking.images.kept(Keep.GREY, title)[SEEN]),
        f"{title}, no board": AnsweringWay("", own.recall_at_1, ms["host"], ms["spiking"]),
        f"{title}, `cosine` of `orientation`": AnsweringWay("", cosine.recall_at_1, ms["cosine"], ms["plain"]),
    }


def in_one_run(
    title: str, config: Config, references: Traverse, queries: Traverse, right: NDArray[np.bool_], rounds: int
) -> dict[str, AnsweringWay]:
    """The way from pixels to places in one run, and the same without a board, by what they are called."""
    asked_of, own, _ = asked(config, references, queries, right)
    spec = front_end_of(asked_of.model)
    if spec is None:
        raise InputError(f"{title}: has no front end")
    timed: dict[str, Callable[[], float]] = {
        "seen": lambda: float(np.median(each_image(queries, spec.seen))),
        "spiking": lambda: float(np.median(measure_encoding(queries, config).milliseconds)),
        "part": partial(beside_board, asked_of),
        "host": partial(alone, asked_of, "lava-vpr"),
    }
    ms = {name: min(values) for name, values in turns(timed, rounds).items()}
    grey = asked_of.images.kept(Keep.GREY, title)[SEEN]
    costs = front_end_costs(spec, placed(spec, KAPOHO_BAY), PixelBlock(grey))
    board = from_pixels("", costs, own.recall_at_1, ms["part"], ms["seen"])
    if board is None:
        raise InputError(f"{KAPOHO_BAY.title}: has no energies")
    alone_way = AnsweringWay("", own.recall_at_1, ms["host"], ms["spiking"])
    title = f"{title}, {spec.steps} steps in one run"
    return {f"{title}, Kapoho Bay": board, f"{title}, no board": alone_way}


@program("nordland", "lens_example")
@click.option("--rounds", default=5, show_default=True)
def main(rounds: int) -> Printed:
    """What a query costs in all with a spiking front end on the board, for frames and for events."""
    frames = update(preset("loihi"), {"encoder": {"kind": "frontend"}})
    nordland = [open_traverse(images_of("nordland", name), places=(0, 100)) for name in FOLDERS["nordland"]]
    lens = (drive(which, ALL, WAYS["front end, one view"]) for which in FOLDERS["lens_example"])
    found = ways("`frontend`", frames, *nordland, near(100), rounds)
    direct = update(preset("loihi"), {"encoder": {"kind": "frontend-direct"}})
    found |= in_one_run("`frontend-direct`", direct, *nordland, near(100), rounds)
    found |= ways("`frontend-events`", WAYS["front end, one view"].config, *lens, truth(ALL), rounds)
    table = energy([*found.values()], [*found])
    columns, *rows = zip(table.columns, *table.rows, strict=True)
    wrapped = frozenset(range(1, len(columns)))
    yield BenchmarkTable(columns, rows, table.notes, table.title, long=wrapped, record="front-end-energy")
