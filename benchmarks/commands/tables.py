"""Tables that commands of lava-vpr print, taken into their records: studies, the paper's table, the largest maps.

    N=FOLDER python -m benchmarks commands.tables study-bits [NAME...] --record

Each record in docs/results names its command, whose shell variables (``$N``: the folder of the images) are set; each
command is run once. A record takes one of the tables, and of that the columns that it has.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from functools import cache

import click

from benchmarks import figures
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr.cli import main as lava_vpr
from lava_vpr.show.table import Table

NAMES = [name for name in figures.names() if figures.read(name).command.startswith("lava-vpr ")]


@cache
def printed(command: str) -> list[Table]:
    """The tables that a command of lava-vpr prints."""
    made: list[Table] = lava_vpr.main(shlex.split(os.path.expandvars(command))[1:], standalone_mode=False)
    return made


@program()
@click.argument("names", nargs=-1, required=True, type=click.Choice(NAMES))
def main(names: Sequence[str]) -> Printed:
    """Run the commands of some records."""
    for name in names:
        record = figures.read(name)
        table = printed(record.command)[record.table]
        yield BenchmarkTable(table.columns, table.rows, title=name, record=name)
