"""The page of a study: one HTML file without a script, in the look of the reports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lava_vpr.experiments.task import MODELLED, NETWORK
from lava_vpr.matching.evaluation import Recall
from lava_vpr.show.page import document
from lava_vpr.show.templates import render, text
from lava_vpr.show.text import safe
from lava_vpr.studies.run import Studied
from lava_vpr.studies.show import plots
from lava_vpr.studies.show.values import table


def _drawings(found: Studied) -> str:
    """The plots of a study, each in a panel."""
    title, varied, rows = found.study.title, found.study.varied, found.rows
    if found.study.drawn == "rows":
        figures = [[row.figures[NETWORK][key] for key in Recall._fields] for row in rows]
        svg = plots.lines([row.label for row in rows], plots.KINDS, figures, safe(f"{title}: recall of each row"))
        drawn = [("Recall: dots are seeds, marks their means", svg)]
    else:
        drawn = [
            ("Recall: means of the seeds, bars from the least to the most", plots.curve(rows, varied, safe(title)))
        ]
    if found.study.costed and sum(MODELLED in row.figures for row in rows) > 1:
        drawing = plots.costs(rows, varied, safe(f"{title}: R@1 against modelled energy and time of a query"))
        drawn.append(("Recall against modelled costs of a query", drawing))
    return panels(drawn)


def panels(drawn: Iterable[tuple[str, str]]) -> str:
    """Drawings with their headings as HTML text."""
    return "".join(render("bench_figure.html", heading=safe(heading), drawing=svg) for heading, svg in drawn)


def sheet(title: str, facts: Mapping[str, str], sections: Mapping[str, tuple[str, str]], command: str) -> str:
    """A page of tables and plots as HTML text: a head, its sections, and the command that repeats it.

    Args:
        title: What the page is about.
        facts: Terms of the head, and what they say.
        sections: By their headings, the anchor and the HTML of each; one without HTML is left out.
        command: The command.
    """
    header = render(
        "study_header.html",
        title=safe(title),
        facts="".join(f"<div><dt>{safe(name)}</dt><dd>{safe(value)}</dd></div>" for name, value in facts.items()),
    )
    repeat = f'<div class="panel"><h3>Command</h3><pre class="command"><code>{safe(command)}</code></pre></div>'
    shown = {heading: part for heading, part in sections.items() if part[1]} | {"Reproduction": ("setup", repeat)}
    body = render(
        "bench_body.html",
        header=header,
        links="".join(f'<li><a href="#{name}">{heading}</a></li>' for heading, (name, _) in shown.items()),
        sections="".join(
            render("bench_section.html", name=name, heading=heading, note="", content=content)
            for heading, (name, content) in shown.items()
        ),
    )
    return document(title, body, style=f"\n{text('bench.css')}\n")


def page(found: Studied) -> str:
    """The whole page as HTML text; equal results give equal text."""
    asked = found.asked
    facts = {
        "places": f"{asked.route.places:,}",
        "queries": f"{len(asked.route.queries):,}",
        "seeds": ", ".join(map(str, asked.seeds)),
        "preset": asked.config.preset,
        "decoder": asked.config.decoder.default,
    }
    sections = {"Plots": ("plots", _drawings(found)), "Table": ("table", table(found).html())}
    return sheet(found.study.title, facts, sections, found.command)
