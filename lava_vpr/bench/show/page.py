"""The page of `lava-vpr bench`: one HTML file without a script, in the look of the reports."""

from __future__ import annotations

import re

from lava_vpr.bench.results import Bench, Modelled
from lava_vpr.bench.show import grids, plots
from lava_vpr.bench.show.document import absent, assumptions, percentiles
from lava_vpr.bench.show.grids import NONE, Grid, figure
from lava_vpr.report.frame import document
from lava_vpr.report.text import fraction, safe

_STYLE = """
td.text,th.text{text-align:left}
td.long,th.long{white-space:normal;min-width:15em;text-align:left}
td.long{font-size:.88rem;line-height:1.4}
tr.strong td,tr.strong th{font-weight:700}
tbody th.deep{padding-left:2.2em;color:var(--muted);font-weight:400}
.panel+.panel,.panel+h3{margin-top:16px}
.panel>h3{margin-bottom:12px}
.cost{display:grid;gap:12px;margin:0}
.cost dt{color:var(--muted);font-size:.92rem}
.cost dd{margin:0;font-size:1.12rem;font-weight:650;font-variant-numeric:tabular-nums}
.cost .note{font-weight:400;font-size:.92rem}
.missing dt{font-weight:600}.missing dd{margin:0 0 10px;color:var(--muted);max-width:100ch}
ul.plain{margin:0;padding-left:1.2em;max-width:100ch}ul.plain li{margin:0 0 6px}
"""


def _units(text: str) -> str:
    """``uJ`` and ``us`` as they are printed."""
    return re.sub(r"\bu([Js])\b", r"µ\1", text)


def _text(text: str) -> str:
    return safe(_units(text))


def html_table(grid: Grid) -> str:
    """A grid as a panel that scrolls by itself."""

    def kind(column: int) -> str:
        return ' class="long"' if column in grid.long else ' class="text"' if column < grid.words else ""

    heads = "".join(f'<th scope="col"{kind(k)}>{_text(name)}</th>' for k, name in enumerate(grid.columns))
    body = []
    for k, row in enumerate(grid.rows):
        first = "deep" if row[0].startswith(" ") else "long" if 0 in grid.long else "text"
        cells = "".join(f"<td{kind(c)}>{_text(cell)}</td>" for c, cell in enumerate(row) if c > 0)
        strong = ' class="strong"' if k in grid.strong else ""
        body.append(f'<tr{strong}><th scope="row" class="{first}">{_text(row[0].strip())}</th>{cells}</tr>')
    note = f'<p class="note" style="margin:10px 0 0">{_text(grid.note)}</p>' if grid.note else ""
    return (
        f'<div class="panel scroll"><h3>{_text(grid.title)}</h3><table><caption class="unseen">{_text(grid.title)}'
        f"</caption><thead><tr>{heads}</tr></thead><tbody>{''.join(body)}</tbody></table>{note}</div>"
    )


def _drawn(heading: str, drawing: str) -> str:
    return f'<figure class="panel"><h3>{_text(heading)}</h3>{drawing}</figure>'


def _section(name: str, heading: str, note: str, content: str) -> str:
    told = f'<p class="note">{_text(note)}</p>' if note else ""
    return f'<section id="{name}"><h2>{_text(heading)}</h2>{told}{content}</section>'


def _header(bench: Bench) -> str:
    """Recall first, then the costs in one line each."""
    metrics = bench.recall
    facts = {**bench.model, **bench.machine}
    shown = "".join(f"<div><dt>{_text(grids.named(k))}</dt><dd>{_text(_fact(v))}</dd></div>" for k, v in facts.items())
    costs = []
    for name, one in bench.targets.items():
        costs.append((f"modelled, {grids.title_of(name)}", _in_short(one)))
    for host in bench.measured:
        at = percentiles(host)
        if host.name == "host" and at:
            text = f"{figure(host.queries_per_second)} queries/s, p50 {figure(at['p50'])} ms"
            costs.append(("measured, this machine", _text(text)))
    lines = "".join(f"<div><dt>{_text(term)}</dt><dd>{text}</dd></div>" for term, text in costs)
    return f"""<header><h1>What a query costs</h1>
<div class="hero"><div><p class="big">R@1 <b class="num">{fraction(metrics.recall_at_1, 2)}</b></p>
<p class="note">of {bench.images} queries; area under the precision-recall curve {fraction(metrics.auc, 2)}, recall
without a wrong match {fraction(metrics.recall_at_100_precision, 2)}.</p></div>
<dl class="cost">{lines}</dl></div>
<dl class="facts">{shown}</dl></header>"""


def _fact(value: object) -> str:
    return NONE if value is None else str(value)


def _in_short(one: Modelled) -> str:
    """Energy and time of a target, or that there are none."""
    energy = one.dynamic_microjoules
    if energy is None or one.milliseconds is None:
        return f'unavailable <span class="note">{_text(one.unavailable or "")}</span>'
    told = []
    for value, unit in ((energy, "uJ dynamic"), (one.milliseconds, "ms")):
        span = f"({figure(value.low)} to {figure(value.high)})"
        told.append(f'{_text(f"{figure(value.nominal)} {unit}")} <span class="note">{span}</span>')
    return ", ".join(told)


def _modelled(bench: Bench) -> str:
    parts = []
    for k, (name, one) in enumerate(bench.targets.items()):
        title = grids.title_of(name)
        if one.dynamic_by_component:
            alt = safe(f"Modelled dynamic energy of a query on {title} by component")
            drawing = plots.energy(one.dynamic_by_component, f"energy{k}", alt)
            parts.append(_drawn(f"Where the energy goes, modelled for {title}", drawing))
        for times in bench.step_times:
            if times.target == name and times.busiest:
                alt = safe(f"Modelled time of each step on {title}")
                drawing = plots.step_times(times, f"steps{k}", alt)
                parts.append(_drawn(f"Time of each step, modelled for {title}, nominal, mean of the queries", drawing))
        if one.unavailable:
            reason = f"<h3>{_text(title)}</h3><p>Modelled energy and time unavailable: {_text(one.unavailable)}.</p>"
            parts.append(f'<div class="panel">{reason}</div>')
        else:
            parts.append(html_table(grids.modelled(one)))
    parts.append(html_table(grids.counted(bench)))
    note = (
        "Nothing here was measured on a chip: events were counted, then multiplied by published constants. Low: the "
        "lower of the published constants; nominal: those of SANA-FE, fitted to silicon; high: the higher. Static "
        "energy and the host's traffic stand apart: they depend on the system around the network."
    )
    return _section("modelled", "Modelled on the chip", note, "".join(parts))


def _measured(bench: Bench) -> str:
    parts = []
    if any(one.milliseconds for one in bench.measured):
        drawing = plots.latencies(bench.measured, safe("Measured time of single queries, by backend"))
        parts.append(_drawn("Time of single queries, measured", drawing))
    if any(not one.absent for one in bench.measured):
        parts.append(html_table(grids.measured(bench.measured)))
        if any(one.board for one in bench.measured):
            parts.append(html_table(grids.on_boards(bench.measured)))
        rows = tuple((one.name, one.what) for one in bench.measured if not one.absent and one.what)
        if rows:
            what = Grid("what was timed", ("backend", "from what to what"), rows, long=frozenset({1}))
            parts.append(html_table(what))
    note = "On this machine; another gives other figures. Simulations of the chip say nothing about the chip's speed."
    return _section("measured", "Measured here", note, "".join(parts)) if parts else ""


def _sweep(bench: Bench) -> str:
    if not bench.sweep:
        return ""
    drawing = plots.pareto(bench.sweep, safe("R@1 of every setting against its modelled energy and time"))
    note = (
        "Every point is a setting that answered the queries; the lines join the best, with and without stopping a "
        "query early, which no backend does yet. Chosen on the queries shown here: judge a choice on others."
    )
    content = _drawn("Recall against modelled costs", drawing) + html_table(grids.sweep(bench.sweep))
    return _section("sweep", "Sweep of settings", note, content)


def _peers(bench: Bench) -> str:
    if all(one.absent for one in bench.peers):
        return ""
    return _section(
        "peers", "Peers", "The same images, the same machine, the same run.", html_table(grids.peers(bench.peers))
    )


def _anchors(bench: Bench) -> str:
    ours = next((one for one in bench.targets.values() if one.milliseconds is not None), None)
    parts = []
    if ours is not None:
        drawing = plots.beside_anchors(ours, safe("This network, modelled, beside published figures"))
        parts.append(_drawn("This network, modelled, above what others published", drawing))
    parts.append(html_table(grids.anchors()))
    note = (
        "Published by their authors for other tasks on other boards: they say in which region an answer lies, not "
        "which network is better. Static energy is treated differently from paper to paper."
    )
    return _section("anchors", "Published figures beside ours", note, "".join(parts))


def _sources(bench: Bench) -> str:
    parts = []
    if bench.constants:
        parts.append(html_table(grids.constants(bench)))
    told = "".join(f"<li>{_text(text)}</li>" for text in assumptions(bench))
    if told:
        parts.append(f'<div class="panel"><h3>assumptions</h3><ul class="plain">{told}</ul></div>')
    note = "What the modelled figures are made of."
    return _section("model", "The cost model", note, "".join(parts)) if parts else ""


def _workload(bench: Bench) -> str:
    if bench.workload is None:
        return ""
    note = (
        "Definitions: Yik et al., The NeuroBench framework, Nature Communications 2025, doi 10.1038/s41467-025-56739-4."
    )
    return _section("workload", "Workload", note, html_table(grids.workload(bench.workload)))


def _missing(bench: Bench) -> str:
    rows = "".join(f"<dt>{_text(r['what'])}</dt><dd>{_text(r['reason'])}</dd>" for r in absent(bench))
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
    parts = {
        "Recall": _section("recall", "Recall", "", html_table(grids.recall(bench))),
        "Modelled": _modelled(bench),
        "Measured": _measured(bench),
        "Sweep": _sweep(bench),
        "Peers": _peers(bench),
        "Published": _anchors(bench),
        "Cost model": _sources(bench),
        "Workload": _workload(bench),
        "Absent": _missing(bench),
        "Reproduction": _setup(bench),
    }
    links = []
    for text, part in parts.items():
        found = re.match(r'<section id="([a-z]+)"', part)
        if found:
            links.append(f'<li><a href="#{found.group(1)}">{text}</a></li>')
    body = f"""{_header(bench)}
<nav aria-label="Sections"><ul>{"".join(links)}</ul></nav>
<main>{"".join(parts.values())}</main>"""
    return document("What a query costs", body, style=_STYLE)
