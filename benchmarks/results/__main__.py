"""Compute the figures of the results into docs/results.json, and write all pages anew. `make results` calls it.

    LAVA_VPR_DATA=... python -m benchmarks.results [--all]

Rows that were computed under today's settings and from today's sources stay as they are. The file is written after
each row, so an interrupted run goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import click

from benchmarks.results.record import FILE, Record, key, sources
from benchmarks.results.rows import SEEDS, ResultRow, measure
from benchmarks.results.tables import ROWS
from lava_vpr.errors import LavaVprError
from scripts.pages import bring_up_to_date as write_pages


def bring_up_to_date(record: Record, rows: Sequence[ResultRow], file: Path, every: bool) -> None:
    """Compute what is out of date of ``rows``, or all, and write each down; what is no row any more goes."""
    today, names = sources(), {row.name for row in rows}
    record.rows = {name: row for name, row in record.rows.items() if name in names}
    for row in rows:
        if not every and record.current(row, today):
            continue
        started = time.perf_counter()
        places = [(section, seed) for section in row.sections for seed in SEEDS]
        record.put(row, today, {key(*place): measure(row, *place) for place in places})
        record.write(file)
        click.echo(f"{row.name}: {record.cell(row)} ({time.perf_counter() - started:.0f} s)")
    record.write(file)


@click.command()
@click.option("--all", "every", is_flag=True, help="Compute rows that are up to date, too.")
def main(every: bool) -> None:
    """Compute the figures of the results."""
    try:
        bring_up_to_date(Record.read(), ROWS, FILE, every)
        written = write_pages()
    except LavaVprError as error:
        raise SystemExit(str(error)) from None
    click.echo(f"{', '.join(map(str, [FILE, *written]))}: {len(ROWS)} rows, up to date")


if __name__ == "__main__":
    main()
