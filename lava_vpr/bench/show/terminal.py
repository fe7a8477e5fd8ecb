"""The text of `lava-vpr bench` on the terminal."""

from __future__ import annotations

from lava_vpr.bench.results import Bench
from lava_vpr.bench.show.json_values import absent
from lava_vpr.bench.show.sections import sections
from lava_vpr.show.table import Table


def tables(bench: Bench) -> list[Table]:
    """What stands on the terminal, in order: recall first, then what was measured, then what is modelled."""
    return [table for section in sections(bench, page=False).values() for table in section]


def absences(bench: Bench) -> list[str]:
    """A line for everything that the report lacks."""
    return [f"absent: {row['what']}: {row['reason']}" for row in absent(bench)]
