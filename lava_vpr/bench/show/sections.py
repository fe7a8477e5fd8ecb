"""The tables of a benchmark in their order: what it leads with, then everything else."""

from __future__ import annotations

from lava_vpr.bench.results import Bench
from lava_vpr.bench.show import energy, tables
from lava_vpr.show.table import Table


def sections(bench: Bench, page: bool = True) -> dict[str, tuple[Table, ...]]:
    """All tables with rows, by section, in the terminal's order; only a page has what was timed, anchors, constants."""
    on_board = (tables.modelled(costs, costs.figures) for costs in bench.targets.values() if costs.figures)
    tables_of: dict[str, tuple[Table, ...]] = {
        "recall": (tables.recall(bench),),
        "probability": (tables.thresholds(bench),),
        "energy": (energy.table(bench.energy),),
        "measured": (tables.measured(bench.measured), tables.on_boards(bench.measured)),
        "modelled": (*on_board, tables.counted(bench), tables.asked(bench.asked)),
        "workload": () if bench.workload is None else (tables.workload(bench.workload),),
        "peers": (tables.peers(bench.peers),),
        "sweep": (tables.sweep(bench.sweep),),
    }
    if page:
        tables_of["measured"] += (tables.timed(bench.measured),)
        tables_of |= {"anchors": (tables.anchors(),), "model": (tables.constants(bench),)}
    return {name: tuple(table for table in chosen if table.rows) for name, chosen in tables_of.items()}
