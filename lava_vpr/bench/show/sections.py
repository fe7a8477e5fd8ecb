"""The tables of a benchmark in their order, and what stands on the terminal: what it leads with, then all else."""

from __future__ import annotations

from lava_vpr.bench.results import Bench
from lava_vpr.bench.show import tables as every
from lava_vpr.bench.show.json_values import absent
from lava_vpr.show.table import Table


def sections(bench: Bench, page: bool = True) -> dict[str, tuple[Table, ...]]:
    """All tables with rows, by section, in the terminal's order; only a page has what was timed, anchors, constants."""
    on_board = (every.modelled(costs, costs.figures) for costs in bench.targets.values() if costs.figures)
    tables_of: dict[str, tuple[Table, ...]] = {
        "recall": (every.recall(bench),),
        "probability": (every.thresholds(bench),),
        "energy": (every.energy(bench.energy),),
        "measured": (every.measured(bench.measured), every.on_boards(bench.measured)),
        "modelled": (*on_board, every.counted(bench), every.asked(bench.asked)),
        "workload": () if bench.workload is None else (every.workload(bench.workload),),
        "peers": (every.peers(bench.peers),),
        "sweep": (every.sweep(bench.sweep),),
    }
    if page:
        tables_of["measured"] += (every.timed(bench.measured),)
        tables_of |= {"anchors": (every.anchors(),), "model": (every.constants(bench),)}
    return {name: tuple(table for table in chosen if table.rows) for name, chosen in tables_of.items()}


def tables(bench: Bench) -> list[Table]:
    """What stands on the terminal, in order: recall first, then what was measured, then what is modelled."""
    return [table for section in sections(bench, page=False).values() for table in section]


def absences(bench: Bench) -> list[str]:
    """A line for everything that the report lacks."""
    return [f"absent: {row['what']}: {row['reason']}" for row in absent(bench)]
