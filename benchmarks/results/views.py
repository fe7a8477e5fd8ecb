"""Views: Gardens Point walked on the other side of the path, and what several views of a place cost Nordland."""

from __future__ import annotations

from typing import Any

from benchmarks.figures import markdown
from benchmarks.places import Section
from benchmarks.results.record import SIMPLER_TITLES, Record
from benchmarks.results.rows import Row
from benchmarks.results.sections import DEFAULT, FIVE, LEARNED, SIMPLER
from lava_vpr.config import preset
from lava_vpr.configfile import update

GARDENS = (Section("gardens", 50, 100),)
VIEWS: dict[str, dict[str, Any]] = {
    "one": {},
    "three (`--views 3`)": {"shifts": 3},
    "five in three scales (`[views]`)": {"shifts": 5, "shift": 0.071, "scales": 3},
}
WALKED = {
    title: Row(f"Gardens Point, views: {title}", update(preset(DEFAULT), {"views": views}), GARDENS, SIMPLER, 2)
    for title, views in VIEWS.items()
}
RIDDEN = {
    title: Row(f"five sections, views: {title}", update(preset(DEFAULT), {"views": views}), FIVE)
    for title, views in VIEWS.items()
    if views
}
ROWS = (*WALKED.values(), *RIDDEN.values())


def lines(record: Record) -> str:
    """The table."""
    rows = [["views of each place", "as learned", *SIMPLER_TITLES.values(), "what it costs the five Nordland sections"]]
    for title, row in WALKED.items():
        simpler = [record.cell(row, name) for name in SIMPLER_TITLES]
        ridden = record.cell(RIDDEN.get(title, LEARNED[DEFAULT]))
        rows.append([title, f"**{record.cell(row)}**", *simpler, ridden])
    return markdown(rows[0], rows[1:])
