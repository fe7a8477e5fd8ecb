"""Long maps: 500 and 1,500 Nordland places in one model of the default preset."""

from __future__ import annotations

from benchmarks.figures import markdown
from benchmarks.places import Section
from benchmarks.results.record import SIMPLER_TITLES, Record
from benchmarks.results.rows import Row
from benchmarks.results.sections import DEFAULT, SIMPLER
from lava_vpr.config import preset
from lava_vpr.configfile import update

ALL_INPUTS = {"encoder": {"query_inputs": 0}}
SHORT, LONG = (Section("nordland_all", 0, 500),), (Section("nordland_all", 0, 1500),)
TITLED = {
    "500": Row("500 places", preset(DEFAULT), SHORT, SIMPLER, costs=True),
    "500, in sequences of 5": Row("500 places, sequences of 5", preset(DEFAULT), SHORT, SIMPLER, sequence=5),
    "1,500": Row("1,500 places", preset(DEFAULT), LONG, SIMPLER, costs=True),
    "1,500, all inputs spike in queries": Row(
        "1,500 places, all inputs", update(preset(DEFAULT), ALL_INPUTS), LONG, SIMPLER, costs=True
    ),
}
ROWS = tuple(TITLED.values())


def lines(record: Record) -> str:
    """The table."""
    rows = [["places in one model", "as learned", *SIMPLER_TITLES.values(), "µJ"]]
    for title, row in TITLED.items():
        simpler = [record.cell(row, name) for name in SIMPLER_TITLES]
        cost = f"{record.mean(row, 'costs')[0]:.1f}" if row.costs else ""
        rows.append([title, f"**{record.cell(row)}**", *simpler, cost])
    return markdown(rows[0], rows[1:])
