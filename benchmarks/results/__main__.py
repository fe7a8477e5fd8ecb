"""Compute the figures of the results into docs/results.json, and write all pages again. `make results` calls it.

    LAVA_VPR_DATA=... python -m benchmarks.results [--all]

Rows that were computed under today's settings and from today's sources stay as they are. The file is written after each
section and seed, so an interrupted run continues.
"""

from __future__ import annotations

from collections.abc import Sequence

import click

from benchmarks.results.rows import FILE, Record, ResultRow, name_of, places_of
from benchmarks.results.tables import ROWS
from lava_vpr.errors import LavaVprError
from scripts.pages import bring_up_to_date as write_pages


def bring_up_to_date(record: Record, rows: Sequence[ResultRow], every: bool) -> None:
    """Compute what is out of date of ``rows``, or all, and write each down; what is no row any more goes."""
    names = () if every else {name_of(*place) for place in places_of(rows)}
    record.kept = {name: one for name, one in record.kept.items() if name in names}
    record.bring_up_to_date(rows)
    record.write()


@click.command()
@click.option("--all", "every", is_flag=True, help="Compute rows that are up to date, too.")
def main(every: bool) -> None:
    """Compute the figures of the results."""
    try:
        bring_up_to_date(Record.read(), ROWS, every)
        written = write_pages()
    except LavaVprError as error:
        raise SystemExit(str(error)) from None
    click.echo(f"{', '.join(map(str, [FILE, *written]))}: {len(ROWS)} rows, up to date")


if __name__ == "__main__":
    main()
