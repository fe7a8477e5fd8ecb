"""The page of `lava-vpr bench`: one HTML file without a script, in the look of the reports."""

from __future__ import annotations

import re
from collections.abc import Iterable

from lava_vpr.bench.results import Bench, Modelled
from lava_vpr.bench.show import plots
from lava_vpr.bench.show.json_values import absent, assumptions, percentiles
from lava_vpr.bench.show.sections import sections
from lava_vpr.bench.show.tables import counted, modelled, title_of
from lava_vpr.report import trust
from lava_vpr.report.build import map_of
from lava_vpr.report.sections import where
from lava_vpr.show.numbers import NONE, figure, fraction, named
from lava_vpr.show.page import document
from lava_vpr.show.table import Table, in_html
from lava_vpr.show.templates import render, safe, text


def _html_tables(tables: Iterable[Table]) -> str:
    return "".join(table.html() for table in tables)


def _drawn(heading: str, drawing: str) -> str:
    return render("bench_figure.html", heading=in_html(heading), drawing=drawing)


def _section(name: str, heading: str, note: str, content: str) -> str:
    """A section of the page; without content, none."""
    if not content:
        return ""
    above = f'<p class="note">{in_html(note)}</p>' if note else ""
    return render("bench_section.html", name=name, heading=in_html(heading), note=above, content=content)


def _header(bench: Bench) -> str:
    """The head of the page: recall first, then the costs in one line each."""
    metrics = bench.recall
    facts = {**bench.model, **bench.machine}
    shown = "".join(f"<div><dt>{in_html(named(k))}</dt><dd>{in_html(_fact(v))}</dd></div>" for k, v in facts.items())
    in_short = []
    for name, costs in bench.targets.items():
        in_short.append((f"modelled, {title_of(name)}", _in_short(costs)))
    for host in bench.measured:
        at = percentiles(host)
        if host.name == "host" and at:
            text = f"{figure(host.queries_per_second)} queries/s, p50 {figure(at['p50'])} ms"
            in_short.append(("measured, this machine", in_html(text)))
    lines = "".join(f"<div><dt>{in_html(term)}</dt><dd>{text}</dd></div>" for term, text in in_short)
    return render(
        "bench_header.html",
        recall=fraction(metrics.recall_at_1, 2),
        queries=str(bench.images),
        auc=fraction(metrics.auc, 2),
        certain=fraction(metrics.recall_at_100_precision, 2),
        costs=lines,
        facts=shown,
    )


def _fact(value: object) -> str:
    return NONE if value is None else str(value)


def _in_short(costs: Modelled) -> str:
    """Energy and time of a target, or that there are none."""
    if costs.figures is None:
        return f'unavailable <span class="note">{in_html(costs.unavailable or "")}</span>'
    figures = []
    for value, unit in ((costs.figures.dynamic_microjoules, "uJ dynamic"), (costs.figures.milliseconds, "ms")):
        span = f"({figure(value.low)} to {figure(value.high)})"
        figures.append(f'{in_html(f"{figure(value.nominal)} {unit}")} <span class="note">{span}</span>')
    return ", ".join(figures)


def _on_map(bench: Bench) -> str:
    """The map of the queries and their matches, if positions are known."""
    found = bench.on_map
    if found is None:
        return ""
    return where(map_of(found.errors, len(found.matches), int(bench.model["places"])), found.matches, found.correct)


def _modelled(bench: Bench) -> str:
    parts = []
    for k, (name, costs) in enumerate(bench.targets.items()):
        title = title_of(name)
        if costs.figures is not None:
            alt = safe(f"Modelled dynamic energy of a query on {title} by component")
            drawing = plots.energy(costs.figures.dynamic_by_component, f"energy{k}", alt)
            parts.append(_drawn(f"Where the energy goes, modelled for {title}", drawing))
        for times in bench.step_times:
            if times.target == name and times.busiest:
                alt = safe(f"Modelled time of each step on {title}")
                drawing = plots.step_times(times, f"steps{k}", alt)
                parts.append(_drawn(f"Time of each step, modelled for {title}, nominal, mean of the queries", drawing))
        if costs.figures is None:
            reason = f"Modelled energy and time unavailable: {in_html(costs.unavailable or '')}."
            parts.append(f'<div class="panel"><h3>{in_html(title)}</h3><p>{reason}</p></div>')
        else:
            parts.append(modelled(costs, costs.figures).html())
    parts.append(counted(bench).html())
    note = (
        "Nothing here was measured on a chip: events were counted, then multiplied by published constants. Low: the "
        "lower of the published constants; nominal: those of SANA-FE, fitted to silicon; high: the higher. Static "
        "energy and the host's traffic stand apart: they depend on the system around the network."
    )
    return _section("modelled", "Modelled on the chip", note, "".join(parts))


def _measured(bench: Bench, tables: Iterable[Table]) -> str:
    drawing = ""
    if any(backend.milliseconds for backend in bench.measured):
        latencies = plots.latencies(bench.measured, safe("Measured time of single queries, by backend"))
        drawing = _drawn("Time of single queries, measured", latencies)
    note = "On this machine; another gives other figures. Simulations of the chip say nothing about the chip's speed."
    return _section("measured", "Measured here", note, drawing + _html_tables(tables))


def _sweep(bench: Bench, tables: Iterable[Table]) -> str:
    if not bench.sweep:
        return ""
    drawing = plots.pareto(bench.sweep, safe("R@1 of every setting against its modelled energy and time"))
    note = (
        "Every point is a setting that answered the queries; the lines join the best, with and without stopping a "
        "query early, which no backend does yet. Chosen on the queries shown here: judge a choice on others."
    )
    content = _drawn("Recall against modelled costs", drawing) + _html_tables(tables)
    return _section("sweep", "Sweep of settings", note, content)


def _anchors(bench: Bench, tables: Iterable[Table]) -> str:
    ours = next((costs.figures for costs in bench.targets.values() if costs.figures is not None), None)
    drawing = ""
    if ours is not None:
        beside = plots.beside_anchors(ours, safe("This network, modelled, beside published figures"))
        drawing = _drawn("This network, modelled, above what others published", beside)
    note = (
        "Published by their authors for other tasks on other boards: they say in which region an answer lies, not "
        "which network is better. Static energy is treated differently from paper to paper."
    )
    return _section("anchors", "Published figures beside ours", note, drawing + _html_tables(tables))


def _cost_model(bench: Bench, tables: Iterable[Table]) -> str:
    items = "".join(f"<li>{in_html(text)}</li>" for text in assumptions(bench))
    panel = f'<div class="panel"><h3>assumptions</h3><ul class="plain">{items}</ul></div>' if items else ""
    note = "What the modelled figures are made of."
    return _section("model", "The cost model", note, _html_tables(tables) + panel)


def _missing(bench: Bench) -> str:
    rows = "".join(f"<dt>{in_html(r['what'])}</dt><dd>{in_html(r['reason'])}</dd>" for r in absent(bench))
    content = f'<dl class="panel missing">{rows}</dl>' if rows else '<p class="note">Nothing.</p>'
    return _section("absent", "What this report lacks", "", content)


def _setup(bench: Bench) -> str:
    command = f'<div class="panel"><h3>Command</h3><pre class="command"><code>{safe(bench.command)}</code></pre></div>'
    note = (
        "Counts, recall and modelled figures repeat exactly; measured ones depend on the machine and what else it does."
    )
    return _section("setup", "Reproduction", note, command)


def page(bench: Bench) -> str:
    """The whole page as HTML text; equal results give equal text."""
    tables = sections(bench)
    workload_note = (
        "Definitions: Yik et al., The NeuroBench framework, Nature Communications 2025, doi 10.1038/s41467-025-56739-4."
    )
    peers_note = "The same images, the same machine, the same run."
    parts = {
        "Recall": _section("recall", "Recall", "", _html_tables(tables["recall"])),
        "Probability": trust.section(bench.trust, {}),
        "Map": _on_map(bench),
        "Energy": _section("energy", "All the energy of a query", "", _html_tables(tables["energy"])),
        "Modelled": _modelled(bench),
        "Measured": _measured(bench, tables["measured"]),
        "Sweep": _sweep(bench, tables["sweep"]),
        "Peers": _section("peers", "Peers", peers_note, _html_tables(tables["peers"])),
        "Published": _anchors(bench, tables["anchors"]),
        "Cost model": _cost_model(bench, tables["model"]),
        "Workload": _section("workload", "Workload", workload_note, _html_tables(tables["workload"])),
        "Absent": _missing(bench),
        "Reproduction": _setup(bench),
    }
    links = []
    for text_of_link, part in parts.items():
        section = re.match(r'<section id="([a-z]+)"', part)
        if section:
            links.append(f'<li><a href="#{section.group(1)}">{text_of_link}</a></li>')
    body = render("bench_body.html", header=_header(bench), links="".join(links), sections="".join(parts.values()))
    return document("What a query costs", body, style=f"\n{text('bench.css')}\n")
