"""Sources of the figures of `lava-vpr bench`: what was timed, the constants of the cost model, published results."""

from __future__ import annotations

from collections.abc import Sequence

from lava_vpr.bench import modelling
from lava_vpr.bench.anchors import ANCHORS
from lava_vpr.bench.results import Measured
from lava_vpr.show.numbers import figure, levels, named
from lava_vpr.show.table import Table


def timed(rows: Sequence[Measured]) -> Table:
    """Descriptions of what was timed for each backend."""
    cells = tuple((backend.name, backend.what) for backend in rows if not backend.absent and backend.what)
    return Table(("backend", "from what to what"), cells, title="what was timed", long=frozenset({1}))


def constants() -> Table:
    """Every constant of the cost model, with its source."""
    rows = [(row.what or named(row.name), *levels(row), row.unit, row.source) for row in modelling.constants()]
    heads = ("constant", "low", "nominal", "high", "unit", "source")
    return Table(heads, rows, title="constants of the cost model", long=frozenset({0, 5}))


def anchors() -> Table:
    """Published results, with their citations."""
    rows = []
    for anchor in ANCHORS:
        kind = "" if anchor.kind == "measured" else f" ({anchor.kind})"
        cited = f"{anchor.citation}, doi {anchor.doi}"
        task = f"{anchor.task}; on {anchor.board}{kind}" + (f"; {anchor.note}" if anchor.note else "")
        rows.append((anchor.name, figure(anchor.microjoules), figure(anchor.milliseconds), task, cited))
    heads = ("published", "uJ", "ms", "task and board", "where")
    return Table(heads, rows, title="published figures, none of them the same task", long=frozenset({3, 4}))
