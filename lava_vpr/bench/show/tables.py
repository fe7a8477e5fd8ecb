"""Every table of `lava-vpr bench`, once, as plain text cells: terminal and page only render them (`terminal`: shorter).

Every figure of the cost model is in a row or column whose heading contains "modelled".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from lava_vpr.bench.results import (
    AnsweringWay,
    Bench,
    Measured,
    Peer,
    SweepPoint,
    Workload,
)
from lava_vpr.bench.show.costs import asked_for, modelled, title_of
from lava_vpr.bench.show.json_values import PERCENTILES, counts, percentiles
from lava_vpr.bench.show.sources import anchors, constants, timed
from lava_vpr.deploy.boards.constants import HOST_POWER, Estimate
from lava_vpr.matching.evaluation import TITLES, Metrics, values_of
from lava_vpr.show.numbers import NONE, count, figure, named, percent, ranged, size
from lava_vpr.show.table import Table

_WAYS = {
    "host": "this network, no board",
    "cosine": "cosine, no network",
    "sad": "SAD, no network",
    "hog": "HOG, no network",
}
WATTS = "{:g} W ({:g} to {:g})".format(*(HOST_POWER.at(level) / 1e3 for level in ("nominal", "low", "high")))

WHOLE, WITHOUT_ENCODING, DYNAMIC = "a whole query", "all but the encoding", "board, dynamic, modelled"
_ENERGIES: tuple[tuple[str, Callable[[AnsweringWay], Estimate | None]], ...] = (
    (WHOLE, lambda way: way.whole),
    (WITHOUT_ENCODING, lambda way: way.without_encoding),
    ("processor, encoding of the image, timed here", lambda way: way.encoding),
    ("processor, match or its part of it, timed here", lambda way: way.work),
    ("board, static while its chips work, modelled", lambda way: way.static),
    ("board, static while its chips wait for host I/O, modelled", lambda way: way.io_static),
    (DYNAMIC, lambda way: way.dynamic),
)

_ENERGY_NOTE = (
    "Nominal (low to high). Board: modelled, all its chips, used or not. Processor: median time of single queries on "
    f"one thread of this machine, measured, times an assumed {WATTS}. Its idle power, packing for USB, and a camera "
    "are in no figure."
)


def figures_of(metrics: Metrics | None) -> tuple[str, ...]:
    """The cells below `TITLES`."""
    return (NONE,) * len(TITLES) if metrics is None else tuple(map(percent, values_of(metrics)))


def recall(bench: Bench) -> Table:
    """Recall of the queries, also with views, adaptation or gains."""
    model, decoder = bench.model, str(bench.model.get("decoder", "default"))
    rows = [(decoder, *figures_of(bench.recall))]
    if bench.asked is not None:
        views = f", in {bench.asked.views} views" if bench.asked.views > 1 else ""
        rows += [(decoder + views, *figures_of(bench.asked.recall))] if views else []
        if bench.asked.adapted is not None:
            how = "gains" if bench.asked.adapt is None else "adapted"
            rows.append((f"{decoder}{views}, {how}", *figures_of(bench.asked.adapted)))
    return Table(
        title=f"recall of {bench.images} queries, {model.get('places')} places, percent",
        columns=("decoder", *TITLES.values()),
        rows=tuple(rows),
        strong=frozenset({0}),
        notes=(
            "R@100P: the largest recall without a single wrong match.",
            "P@100R: precision when every query is answered.",
        ),
    )


def thresholds(bench: Bench) -> Table:
    """The matches that each target precision accepts; no rows without probabilities."""
    rows = tuple(
        (percent(row.target), figure(row.probability), *map(percent, (row.accepted, row.precision, row.kept)))
        for found in bench.trust.values()
        for row in found.thresholds
    )
    heads = ("target precision", "threshold", "accepted", "precision", "kept")
    note = (
        "Percent, but for the probability. accepted: of all queries; precision: of the accepted; kept: accepted and "
        "right, of the queries on the map. Calibrated on the references alone."
    )
    return Table(heads, rows, (note,), "accepted by --target-precision")


def timings(rows: Sequence[Measured]) -> Table:
    """The backends that were timed on this machine."""
    cells = [
        (
            backend.name,
            *map(figure, (percentiles(backend) or dict.fromkeys(PERCENTILES)).values()),
            figure(backend.queries_per_second),
            f"{backend.threads}",
            f"{backend.queries:,}",
            size(backend.peak_bytes),
            NONE if backend.joules_per_query is None else figure(1e3 * backend.joules_per_query),
        )
        for backend in rows
        if not backend.absent
    ]
    heads = (*(f"p{q} ms" for q in PERCENTILES), "queries/s", "threads", "queries", "memory", "mJ (CPU)")
    notes = (
        "ms: percentiles of single queries, one after another on one thread.",
        "queries/s: all queries in one batch.",
    )
    return Table(("backend", *heads), cells, notes, "measured here, a query", aside_columns=frozenset({3, 5, 6, 8}))


def on_boards(rows: Sequence[Measured]) -> Table:
    """The figures of the boards' own profilers."""
    boards = {backend.name: backend.board for backend in rows if backend.board}
    names = dict.fromkeys(name for board in boards.values() for name in board)
    cells = [(named(name), *(figure(board.get(name), 4) for board in boards.values())) for name in names]
    note = "By the vendor's profiler, idle power subtracted where it says dynamic; host's input and read-out included."
    return Table(("figure", *boards), cells, (note,), "measured on a board")


def counted(bench: Bench) -> Table:
    """Events of a query, on every board and by the host engine."""
    boards = {name: costs.counts for name, costs in bench.targets.items() if costs.counts}
    sources = boards or {"host": {**bench.events}}
    names = dict.fromkeys((*counts(bench), *(name for values in boards.values() for name in values)))
    rows = [(named(name), *(count(values.get(name)) for values in sources.values())) for name in names]
    most = {name: bench.targets[name].busiest_core or {} for name in boards}
    rows += [
        (f"busiest core, a step: {named(name)}", *(count(values.get(name)) for values in most.values()))
        for name in dict.fromkeys(name for values in most.values() for name in values)
    ]
    remarks = [text for name in boards if bench.targets[name].unavailable for text in bench.targets[name].assumptions]
    if boards:
        remarks.insert(
            0, "Counted from every spike of the queries; messages and hops depend on where the neurons stand."
        )
    return Table(("event", *sources), rows, (" ".join(remarks),), "counted events, mean of a query")


def peers(rows: Sequence[Peer]) -> Table:
    """Other matchers on the same images."""
    cells = []
    for peer in rows:
        at, rate = figures_of(peer.metrics), figure(peer.queries_per_second)
        cells.append((peer.name, at[0], at[3], at[5], rate, f"{peer.threads}", size(peer.bytes), peer.what))
    heads = ("matcher", "R@1", "R@100P", "AUC", "queries/s", "threads", "of references", "what")
    note = "Recall in percent. queries/s: measured here, from preprocessed image to match, all queries in one batch."
    return Table(heads, cells, (note,), "peers on the same images", long=frozenset({7}))


def sweep(rows: Sequence[SweepPoint], ways: Sequence[AnsweringWay] = ()) -> Table:
    """The front of the sweep, the most expensive point first, and the chosen points; the host's part is that of the
    board in ``ways``."""
    host = next((way for way in ways if way.dynamic is not None), None)
    beside = (math.nan, math.nan) if host is None else (host.encoding.nominal + host.work.nominal, host.work.nominal)
    shown = sorted(
        (candidate for candidate in rows if candidate.front or candidate.chosen),
        key=lambda candidate: -candidate.microjoules,
    )
    cells: dict[tuple[object, ...], tuple[str, ...]] = {}
    for candidate in shown:
        energies = (*(candidate.board_microjoules + part for part in beside), candidate.microjoules)
        costs = map(figure, (*energies, candidate.milliseconds, candidate.mean_steps))
        at = figures_of(candidate.metrics)
        kind = "front, stops early" if "stop_margin" in candidate.settings else "front"
        row = (candidate.chosen or kind, at[0], at[3], at[5], *costs, _settings(candidate.settings))
        # Settings that change nothing, such as a margin that is never reached, would fill the table.
        cells.setdefault(
            (candidate.chosen, candidate.metrics.recall_at_1, candidate.microjoules, candidate.milliseconds), row
        )
    lines = tuple(cells.values())
    return Table(
        title=f"sweep: the front of {len(rows)} points",
        columns=(
            *("point", "R@1", "R@100P", "AUC", "uJ: a whole query, partly modelled"),
            *("uJ: all but the encoding, partly modelled", "uJ: board, dynamic, modelled"),
            *("modelled ms", "mean steps", "unlike this model"),
        ),
        rows=lines,
        strong=frozenset(k for k, row in enumerate(lines) if not row[0].startswith("front")),
        long=frozenset({9}),
        aside_columns=frozenset({3, 5}),
        notes=(
            "Recall in percent, on the very queries that the search chose on: judge a choice on others. Dynamic energy "
            "and time on the chip modelled for Kapoho Bay, nominal, clearing included, host I/O not; the host's part "
            f"as in the table of energies, at {HOST_POWER.nominal / 1e3:g} W. Of points with equal figures, one. No "
            "backend stops early yet.",
        ),
    )


def _settings(values: dict[str, Any]) -> str:
    """The settings that differ from the model's, as words."""
    changed = {name: value for name, value in values.items() if value is not None}
    return ", ".join(
        f"{named(name)} {value:g}" if isinstance(value, float) else f"{named(name)} {value}"
        for name, value in changed.items()
    )


def workload(metrics: Workload) -> Table:
    """The metrics by NeuroBench's definitions."""
    rows = (
        ("footprint", size(metrics.footprint_bytes)),
        ("parameters", f"{metrics.parameters:,}"),
        ("connection sparsity", figure(metrics.connection_sparsity)),
        ("activation sparsity", figure(metrics.activation_sparsity, 4)),
        ("synaptic operations a query, dense", figure(metrics.dense_operations, 4)),
        ("effective multiply-accumulates a query", figure(metrics.effective_macs, 4)),
        ("effective accumulates a query", figure(metrics.effective_acs, 4)),
        ("membrane updates a query", figure(metrics.membrane_updates, 4)),
    )
    return Table(("metric", "value"), rows, title="workload metrics by NeuroBench's definitions")


def heading(name: str) -> str:
    """The heading of a column for the way ``name``, adapted or not."""
    way, comma, adapted = name.partition(", ")
    return _WAYS.get(way, title_of(way).partition(" (")[0]) + comma + adapted


def energy(
    ways: Sequence[AnsweringWay], titles: Sequence[str] | None = None, pixels: tuple[int, int] | None = None
) -> Table:
    """All the energy of a query, a column for each way; no rows without ways, no rows of boards without a board.

    Args:
        ways: Every way to answer a query.
        titles: Their headings; None: by their names.
        pixels: Width and height of the images; None: they are vectors.
    """
    heads = titles or [heading(way.name) for way in ways]
    images = "" if pixels is None else f", images of {pixels[0]} x {pixels[1]} pixels"
    rows = [("R@1, percent", *(percent(way.recall) for way in ways))]
    rows += [(name, *(ranged(of(way)) for way in ways)) for name, of in _ENERGIES if any(of(way) for way in ways)]
    times = (("processor's time, ms: match or its part", "work"), ("processor's time, ms: encoding", "encoding"))
    rows += [(text, *(figure(getattr(way, f"{name}_milliseconds")) for way in ways)) for text, name in times]
    return Table(
        title=f"energy of a query, all of it, uJ: a processor of {WATTS}{images}",
        columns=("energy, uJ", *heads),
        rows=tuple(rows) if ways else (),
        strong=frozenset(k for k, row in enumerate(rows) if row[0] in (WHOLE, WITHOUT_ENCODING)),
        notes=(_ENERGY_NOTE,),
    )


def sections(bench: Bench) -> dict[str, tuple[Table, ...]]:
    """All tables with rows, by section of a page."""
    on_board = (modelled(costs, costs.figures) for costs in bench.targets.values() if costs.figures)
    tables_of: dict[str, tuple[Table, ...]] = {
        "recall": (recall(bench),),
        "probability": (thresholds(bench),),
        "energy": (energy(bench.energy, pixels=bench.pixels),),
        "measured": (timings(bench.measured), on_boards(bench.measured), timed(bench.measured)),
        "modelled": (*on_board, counted(bench), *asked_for(bench)),
        "workload": () if bench.workload is None else (workload(bench.workload),),
        "peers": (peers(bench.peers),),
        "sweep": (sweep(bench.sweep, bench.energy),),
        "anchors": (anchors(),),
        "model": (constants(),),
    }
    return {name: tuple(table for table in chosen if table.rows) for name, chosen in tables_of.items()}
