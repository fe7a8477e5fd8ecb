"""The tables of `lava-vpr bench` for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.markup import escape
from rich.table import Table

from lava_vpr.bench.results import Bench
from lava_vpr.bench.show import grids
from lava_vpr.bench.show.document import absent
from lava_vpr.bench.show.grids import Grid

WIDEST = 60
"""Characters of a column of long text before it wraps."""


def table(grid: Grid) -> Table:
    """A grid for rich."""
    made = Table(title=escape(grid.title), title_justify="left", caption=escape(grid.note), caption_justify="left")
    for k, name in enumerate(grid.columns):
        wraps = k in grid.long
        made.add_column(
            escape(name),
            justify="left" if k < grid.words or wraps else "right",
            no_wrap=not wraps,
            max_width=WIDEST if wraps else None,
        )
    for k, row in enumerate(grid.rows):
        made.add_row(*map(escape, row), style="bold" if k in grid.strong else None)
    return made


def tables(bench: Bench) -> Iterator[Table]:
    """What stands on the terminal, in order: recall first, then what was measured, then what is modelled."""
    yield table(grids.recall(bench))
    if any(not one.absent for one in bench.measured):
        yield table(grids.measured(bench.measured))
    if any(one.board for one in bench.measured):
        yield table(grids.on_boards(bench.measured))
    for one in bench.targets.values():
        if not one.unavailable:
            yield table(grids.modelled(one))
    yield table(grids.counted(bench))
    if bench.workload is not None:
        yield table(grids.workload(bench.workload))
    if any(not one.absent for one in bench.peers):
        yield table(grids.peers(bench.peers))
    if bench.sweep:
        yield table(grids.sweep(bench.sweep))


def absences(bench: Bench) -> list[str]:
    """A line for everything that the report lacks."""
    return [f"absent: {row['what']}: {row['reason']}" for row in absent(bench)]
