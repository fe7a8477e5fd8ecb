"""The page of `lava-vpr bench`: one HTML file without a script, in the look of the reports."""

from __future__ import annotations

from collections.abc import Iterable

from lava_vpr.bench.results import AnsweringWay, Bench, Modelled
from lava_vpr.bench.show import plots
from lava_vpr.bench.show.costs import title_of
from lava_vpr.bench.show.json_values import absent, assumptions, percentiles
from lava_vpr.bench.show.tables import DYNAMIC, WHOLE, WITHOUT_ENCODING, sections
from lava_vpr.report import trust
from lava_vpr.report.build import map_of
from lava_vpr.report.sections import where
from lava_vpr.show.numbers import NONE, figure, fraction, named
from lava_vpr.show.page import Section, drawn, reproduction, sheet, terms
from lava_vpr.show.table import Table, in_html
from lava_vpr.show.templates import render, safe


def _header(bench: Bench) -> str:
    """The head of the page: recall first, then the costs in one line each."""
    metrics = bench.recall
    facts = {**bench.model, **bench.machine}
    ways = {way.name: way for way in bench.energy}
    in_short = [(title_of(name), _in_short(costs, ways.get(name))) for name, costs in bench.targets.items()]
    for host in bench.measured:
        at = percentiles(host)
        if host.name == "host" and at:
            text = f"{figure(host.queries_per_second)} queries/s, p50 {figure(at['p50'])} ms"
            in_short.append(("measured, this machine", in_html(text)))
    return render(
        "bench_header.html",
        recall=fraction(metrics.recall_at_1, 2),
        queries=str(bench.images),
        auc=fraction(metrics.auc, 2),
        certain=fraction(metrics.recall_at_100_precision, 2),
        costs=terms(in_short),
        facts=terms((named(k), in_html(NONE if v is None else str(v))) for k, v in facts.items()),
    )


def _in_short(costs: Modelled, way: AnsweringWay | None) -> str:
    """Energy of a query on a target, the whole energy first, and its time there; or why they are unavailable."""
    if costs.figures is None:
        return f'unavailable <span class="note">{in_html(costs.unavailable or "")}</span>'
    figures, shown = [], [(costs.figures.milliseconds, "ms on the chip, modelled")]
    if way is not None and way.dynamic is not None:
        energies = ((way.whole, WHOLE), (way.without_encoding, WITHOUT_ENCODING), (way.dynamic, DYNAMIC))
        shown = [*((value, f"uJ: {name}") for value, name in energies), *shown]
    for value, unit in shown:
        span = f"({figure(value.low)} to {figure(value.high)})"
        figures.append(f'{in_html(f"{figure(value.nominal)} {unit}")} <span class="note">{span}</span>')
    return ", ".join(figures)


def _on_map(bench: Bench) -> str:
    """The map of the queries and their matches, if positions are known."""
    found = bench.on_map
    if found is None:
        return ""
    errors, places = found.errors, int(bench.model["places"])
    return where(map_of(errors.located, len(found.matches), places, errors.in_words()), found.matches, found.correct)


def _modelled(bench: Bench, tables: Iterable[Table]) -> list[str | Table]:
    """The drawings of each board followed by its table, then the tables for all boards together."""
    parts: list[str | Table] = []
    shown = iter(tables)
    for k, (name, costs) in enumerate(bench.targets.items()):
        title = title_of(name)
        if costs.figures is None:
            reason = f"Modelled energy and time unavailable: {in_html(costs.unavailable or '')}."
            parts.append(f'<div class="panel"><h3>{in_html(title)}</h3><p>{reason}</p></div>')
            continue
        alt = safe(f"Modelled dynamic energy of a query on {title} by component")
        drawing = plots.energy(costs.figures.dynamic_by_component, f"energy{k}", alt)
        parts.append(drawn(f"Where the energy goes, modelled for {title}", drawing))
        if name in bench.step_times:
            alt = safe(f"Modelled time of each step on {title}")
            drawing = plots.step_times(bench.step_times[name], f"steps{k}", alt)
            parts.append(drawn(f"Time of each step, modelled for {title}, nominal, mean of the queries", drawing))
        parts.append(next(shown))
    return [*parts, *shown]


def _drawings(bench: Bench) -> dict[str, list[str]]:
    """The drawing of each other section that has one."""
    found: dict[str, list[str]] = {"measured": [], "sweep": [], "anchors": []}
    if any(backend.milliseconds for backend in bench.measured):
        drawing = plots.latencies(bench.measured, safe("Measured time of single queries, by backend"))
        found["measured"].append(drawn("Time of single queries, measured", drawing))
    if bench.sweep:
        drawing = plots.pareto(bench.sweep, safe("R@1 of every setting against its modelled energy and time"))
        found["sweep"].append(drawn("Recall against modelled costs", drawing))
    ours = next((costs.figures for costs in bench.targets.values() if costs.figures is not None), None)
    if ours is not None:
        drawing = plots.beside_anchors(ours, safe("This network, modelled, beside published figures"))
        found["anchors"].append(drawn("This network, modelled, above what others published", drawing))
    return found


def _assumptions(bench: Bench) -> str:
    """The assumptions of the cost model, if there are any."""
    items = "".join(f"<li>{in_html(text)}</li>" for text in assumptions(bench))
    return f'<div class="panel"><h3>assumptions</h3><ul class="plain">{items}</ul></div>' if items else ""


def _missing(bench: Bench) -> str:
    """The figures that are missing, each with its reason."""
    rows = "".join(f"<dt>{in_html(r['what'])}</dt><dd>{in_html(r['reason'])}</dd>" for r in absent(bench))
    return f'<dl class="panel missing">{rows}</dl>' if rows else '<p class="note">Nothing.</p>'


_NOTES = {
    "modelled": "Nothing here was measured on a chip: events were counted, then multiplied by published constants. "
    "Low: the lower of the published constants; nominal: those of SANA-FE, fitted to silicon; high: the higher. "
    "Static energy and the host's traffic stand apart: they depend on the system around the network.",
    "measured": "On this machine; another gives other figures. Simulations of the chip say nothing about the chip's "
    "speed.",
    "sweep": "Every point is a setting that answered the queries; the lines join the best, with and without stopping a "
    "query early, which no backend does yet. Chosen on the queries shown here: judge a choice on others.",
    "peers": "The same images, the same machine, the same run.",
    "anchors": "Published by their authors for other tasks on other boards: they say in which region an answer lies, "
    "not which network is better. Static energy is treated differently from paper to paper.",
    "model": "What the modelled figures are made of.",
    "workload": "Definitions: Yik et al., The NeuroBench framework, Nature Communications 2025, "
    "doi 10.1038/s41467-025-56739-4.",
    "setup": "Counts, recall and modelled figures repeat exactly; measured ones depend on the machine and what else it "
    "does.",
}


def page(bench: Bench) -> str:
    """The whole page as HTML text; equal results give equal text."""
    tables, drawings = sections(bench), _drawings(bench)

    def part(name: str, link: str, heading: str, *more: str | Table) -> Section:
        """A section with its drawing, its tables, and ``more``."""
        parts: list[str | Table] = [*drawings.get(name, ()), *tables.get(name, ()), *more]
        return Section(name, link, parts, heading, _NOTES.get(name, ""))

    shown = (
        part("recall", "Recall", "Recall"),
        Section("trust", "Probability", [trust.section(bench.trust, {})]),
        Section("map", "Map", [_on_map(bench)]),
        part("energy", "Energy", "All the energy of a query"),
        Section(
            "modelled", "Modelled", _modelled(bench, tables["modelled"]), "Modelled on the chip", _NOTES["modelled"]
        ),
        part("measured", "Measured", "Measured here"),
        part("sweep", "Sweep", "Sweep of settings"),
        part("peers", "Peers", "Peers"),
        part("anchors", "Published", "Published figures beside ours"),
        part("model", "Cost model", "The cost model", _assumptions(bench)),
        part("workload", "Workload", "Workload"),
        part("absent", "Absent", "What this report lacks", _missing(bench)),
        reproduction(bench.command, _NOTES["setup"]),
    )
    return sheet("What a query costs", _header(bench), shown)
