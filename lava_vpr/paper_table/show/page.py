"""The table as one HTML file without a script, in the look of the reports."""

from __future__ import annotations

from lava_vpr.paper_table.printed import DOI
from lava_vpr.paper_table.run import PaperTable
from lava_vpr.paper_table.show import plots
from lava_vpr.paper_table.show.tables import RULES, tables
from lava_vpr.show.templates import render
from lava_vpr.show.text import safe
from lava_vpr.studies.show.page import sheet

TITLE = "The paper's table"


def page(table: PaperTable) -> str:
    """The whole page as HTML text; equal results give equal text."""
    facts = {"paper": f"doi {DOI}", "seed": str(table.wanted.seed), "rules": RULES}
    drawn = "".join(
        render(
            "bench_figure.html",
            heading=safe(part.dataset.title),
            drawing=plots.sections(part, safe(f"{part.dataset.title}: R@100P of each method on each section")),
        )
        for part in table.parts
        if part.source is not None
    )
    sections = {"Sections": ("sections", drawn), "Tables": ("tables", "".join(one.html() for one in tables(table)))}
    return sheet(TITLE, facts, sections, table.command)
