"""The table as one HTML file without a script, in the look of the reports."""

from __future__ import annotations

from lava_vpr.bench.show.page import html_table
from lava_vpr.paper_table.printed import DOI
from lava_vpr.paper_table.run import PaperTable
from lava_vpr.paper_table.show.plots import sections
from lava_vpr.paper_table.show.tables import RULES, tables
from lava_vpr.report.frame import document
from lava_vpr.report.templates import render, text
from lava_vpr.report.text import safe

TITLE = "The paper's table"


def page(table: PaperTable) -> str:
    """The whole page as HTML text; equal results give equal text."""
    facts = {"paper": f"doi {DOI}", "seed": str(table.wanted.seed), "rules": RULES}
    header = render(
        "study_header.html",
        title=safe(TITLE),
        facts="".join(f"<div><dt>{safe(name)}</dt><dd>{safe(value)}</dd></div>" for name, value in facts.items()),
    )
    drawn = "".join(
        render(
            "bench_figure.html",
            heading=safe(part.dataset.title),
            drawing=sections(part, safe(f"{part.dataset.title}: R@100P of each method on each section")),
        )
        for part in table.parts
        if part.source is not None
    )
    command = f'<div class="panel"><h3>Command</h3><pre class="command"><code>{safe(table.command)}</code></pre></div>'
    content = {
        "Sections": ("sections", drawn),
        "Tables": ("tables", "".join(map(html_table, tables(table)))),
        "Reproduction": ("setup", command),
    }
    content = {heading: (name, html) for heading, (name, html) in content.items() if html}
    body = render(
        "bench_body.html",
        header=header,
        links="".join(f'<li><a href="#{name}">{heading}</a></li>' for heading, (name, _) in content.items()),
        sections="".join(
            render("bench_section.html", name=name, heading=heading, note="", content=html)
            for heading, (name, html) in content.items()
        ),
    )
    return document(TITLE, body, style=f"\n{text('bench.css')}\n")
