"""The tables of `lava-vpr bench` on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

import rich.table

from lava_vpr.bench.results import Bench
from lava_vpr.bench.show.json_values import absent
from lava_vpr.bench.show.sections import sections
from lava_vpr.bench.show.tables import Table

WIDEST = 60
"""Characters of a column of long text before it wraps."""


def rendered(table: Table) -> rich.table.Table:
    """``table`` as rich prints it."""
    made = rich.table.Table(title=table.title, title_justify="left", caption=table.note, caption_justify="left")
    for k, name in enumerate(table.columns):
        wraps = k in table.long
        made.add_column(
            name,
            justify="left" if k < table.words or wraps else "right",
            no_wrap=not wraps,
            max_width=WIDEST if wraps else None,
        )
    for k, row in enumerate(table.rows):
        made.add_row(*row, style="bold" if k in table.strong else None)
    return made


def tables(bench: Bench) -> Iterator[rich.table.Table]:
    """What stands on the terminal, in order: recall first, then what was measured, then what is modelled."""
    for section in sections(bench).values():
        for table in section:
            if not table.page_only:
                yield rendered(table)


def absences(bench: Bench) -> list[str]:
    """A line for everything that the report lacks."""
    return [f"absent: {row['what']}: {row['reason']}" for row in absent(bench)]
