"""The table as one HTML file without a script, in the look of the reports."""

from __future__ import annotations

from collections.abc import Sequence

from lava_vpr.experiments.grid import Spread
from lava_vpr.paper_table.methods import DOI
from lava_vpr.paper_table.run import DatasetRows, PaperRequest
from lava_vpr.paper_table.show.tables import RULES, tables
from lava_vpr.show.page import Section, drawn, reproduction, sheet
from lava_vpr.show.templates import safe
from lava_vpr.studies.show.page import Kind, header_of, lines

TITLE = "The paper's table"
KINDS: tuple[Kind, ...] = (("released", "R@100P released", "c0", "o"), ("printed", "printed", "c1", "D"))
"""What is drawn for each method: a dot for each section and a mark at their mean; the figure that the paper prints."""


def page(wanted: PaperRequest, parts: Sequence[DatasetRows], command: str) -> str:
    """The whole page as HTML text, with the command that repeats it; equal results give equal text."""
    facts = {"paper": f"doi {DOI}", "seed": str(wanted.seed), "rules": RULES}
    drawings = [drawn(part.dataset.title, _drawing(part)) for part in parts if part.source is not None]
    sections = (
        Section("sections", "Sections", drawings, "Sections"),
        Section("tables", "Tables", tables(parts), "Tables"),
        reproduction(command),
    )
    return sheet(TITLE, header_of(TITLE, facts), sections)


def _drawing(part: DatasetRows) -> str:
    """The figures of each method by section, and the printed ones, as SVG."""
    rows = [row for row in part.rows if row.figures or row.printed is not None]
    printed = [None if row.printed is None else Spread.of({0: row.printed}) for row in rows]
    figures = [(row.figures.get("released"), said) for row, said in zip(rows, printed, strict=True)]
    label = safe(f"{part.dataset.title}: R@100P of each method on each section")
    return lines([row.method.title for row in rows], KINDS, figures, label, f"sections-{part.dataset.name}")
