"""The tables of a benchmark in their order: what it leads with, then everything else."""

from __future__ import annotations

from lava_vpr.bench.results import Bench
from lava_vpr.bench.show import energy, tables
from lava_vpr.bench.show.tables import Table


def sections(bench: Bench) -> dict[str, tuple[Table, ...]]:
    """All tables that have anything to say, by section, in the terminal's order."""
    on_board = (tables.modelled(costs) for costs in bench.targets.values() if not costs.unavailable)
    tables_of = {
        "recall": (tables.recall(bench),),
        "probability": (tables.thresholds(bench),),
        "energy": (energy.table(bench.energy),),
        "measured": (tables.measured(bench.measured), tables.on_boards(bench.measured), tables.timed(bench.measured)),
        "modelled": (*on_board, tables.counted(bench), tables.asked(bench.asked)),
        "workload": () if bench.workload is None else (tables.workload(bench.workload),),
        "peers": (tables.peers(bench.peers),),
        "sweep": (tables.sweep(bench.sweep),),
        "anchors": (tables.anchors(),),
        "model": (tables.constants(bench),),
    }
    return {name: tuple(table for table in chosen if table.rows) for name, chosen in tables_of.items()}
