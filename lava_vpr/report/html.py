"""The page of the evaluation report: its frame, its head, the table of figures, and the sections in order."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.evaluation import TITLES, values_of
from lava_vpr.recognition import ADAPTED, GAINS
from lava_vpr.report import layers, season, sections, trust
from lava_vpr.report.data import ReportData, label
from lava_vpr.report.plots import precision_recall, series_style
from lava_vpr.show.numbers import fraction, is_number
from lava_vpr.show.page import Section, sheet
from lava_vpr.show.templates import plain, render, safe, text

WAYS = {
    ADAPTED: "Adapted: what stays the same over the queries before is subtracted.",
    GAINS: "Gains: inputs count as much as sure answers have taught.",
}
"""What makes figures differ from those of the same matcher without, by the way's name."""


def is_baseline(name: str, default: str) -> bool:
    """Whether the matcher ``name`` is a baseline, not a decoder of the network's spikes."""
    return name != default and name not in DECODERS


def _header(data: ReportData) -> str:
    """The head of the page: title, recall in a sentence, and the recall of the baselines."""
    correct, queries = int(sections.correct_queries(data).sum()), len(data.query_names)
    default = data.metrics[data.default_decoder]
    compared = [n for n in data.metrics if n == data.default_decoder or is_baseline(n, data.default_decoder)]
    count = f'<b class="num">{correct} of {queries}</b>'
    same = queries == len(data.place_names)
    statement = f"Recognised {count} places" if same else f"Recognised the place in {count} queries"
    bars = []
    for name in compared:
        value = data.metrics[name].recall_at_1
        share = 100 * value if is_number(value) else 0.0
        first = " first" if name == data.default_decoder else ""
        text = "this network" if first else label(name)
        bars.append(
            f'<dt class="{first.strip()}">{safe(text)}</dt><dd class="track{first}" aria-hidden="true">'
            f'<i style="width:{share:.4g}%"></i></dd><dd class="num{first}">{fraction(value, 2)}</dd>'
        )
    facts = "".join(f"<div><dt>{safe(k)}</dt><dd>{safe(v)}</dd></div>" for k, v in data.summary.items())
    others = ", ".join(
        f"{label(n)} {fraction(data.metrics[n].recall_at_1, 2)}" for n in compared if n != data.default_decoder
    )
    against = f"; beside it: {safe(others)}" if others else ""
    return render(
        "report_header.html",
        title=safe(data.title),
        statement=statement,
        recall=fraction(default.recall_at_1, 2),
        decoder=safe(label(data.default_decoder)),
        against=against,
        bars="".join(bars),
        facts=facts,
    )


def _table(data: ReportData) -> str:
    """The table of figures, a row for each matcher; the best figure of each column is bold."""
    shown = {(name, ""): figures for name, figures in data.metrics.items()} | dict(data.changed)
    names = [*data.metrics]
    rows = {key: values_of(shown[key]) for key in sorted(shown, key=lambda key: names.index(key[0]))}
    best = [
        max((value for value in column if is_number(value)), default=math.inf)
        for column in zip(*rows.values(), strict=True)
    ]
    body, mark = [], ' class="best"'
    for (name, way), values in rows.items():
        default, title = name == data.default_decoder, safe(f"{label(name)}, {way}" if way else label(name))
        kind = "default decoder" if default else "baseline" if is_baseline(name, data.default_decoder) else "decoder"
        cells = "".join(
            f'<td data-value="{v if is_number(v) else ""}"{mark if v == best[c] else ""}>{fraction(v, 3)}</td>'
            for c, v in enumerate(values)
        )
        body.append(
            f'<tr{" class=default" if default else ""}><th scope="row" data-value="{title}">{title}'
            f'<span class="tag{" default" if default else ""}">{kind}</span></th>{cells}</tr>'
        )
    heads = "".join(f'<th scope="col"><button type="button">{c}</button></th>' for c in ("Matcher", *TITLES.values()))
    sees = [f"{label(name)}: sees {what}." for name, what in data.seen.items()]
    sees += [told for way, told in WAYS.items() if any(way == key[1] for key in data.changed)]
    return render("report_figures.html", heads=heads, rows="".join(body), sees=safe(" ".join(sees)))


def _curves(data: ReportData) -> str:
    """Precision-recall curves, and a legend that shows or hides each of them."""
    baselines = [name for name in data.metrics if is_baseline(name, data.default_decoder)]
    areas = "; ".join(f"{label(n)} {fraction(m.auc, 2)}" for n, m in data.metrics.items())
    alt = safe(f"Precision over recall of {len(data.metrics)} matchers; areas under the curves: {areas}")
    drawing = precision_recall(data.metrics, data.default_decoder, baselines, alt)
    items = []
    for k, (name, figures) in enumerate(data.metrics.items()):
        default = name == data.default_decoder
        colour, dash = series_style(k, default, name in baselines)
        items.append(
            f'<li data-curve="{k}"><label><input type="checkbox" checked><svg viewBox="0 0 34 12" aria-hidden="true">'
            f'<line x1="0" x2="34" y1="6" y2="6" stroke="var(--{colour})" stroke-width="{3 if default else 2}" '
            f'stroke-dasharray="{dash}"/></svg><span>{safe(label(name))}</span>'
            f'<span class="num">{fraction(figures.auc, 2)}</span></label></li>'
        )
    return render("report_curves.html", drawing=drawing, legend="".join(items))


def _payload(data: ReportData, sheets: dict[str, Any]) -> str:
    """The script's data, as JSON that is safe within its element."""
    correct = sections.correct_queries(data)
    wrong = np.flatnonzero(~correct)
    content = {
        "queries": [f"{data.query_numbers[k]} · {plain(n)}" for k, n in enumerate(data.query_names)],
        "places": [f"{data.place_numbers[k]} · {plain(n)}" for k, n in enumerate(data.place_names)],
        "match": [int(m) for m in data.matches],
        "truth": [sections.true_place(data, q) for q in range(len(data.query_names))],
        "role": [sections.true_role(data, q) for q in range(len(data.query_names))],
        "right": [bool(r) for r in correct],
        "confidence": [f"{c:.3g}" for c in data.confidence.tolist()],
        "first": int(wrong[np.argmax(np.nan_to_num(data.confidence[wrong], nan=-np.inf))]) if len(wrong) else 0,
        **sheets,
    }
    return json.dumps(content, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c")


def page(data: ReportData) -> str:
    """The whole report as HTML text; equal data give equal text."""
    correct = sections.correct_queries(data)
    route, sheets, sheet_style = sections.route(data, correct)
    parts = (
        Section("figures", "Figures", [_table(data)]),
        Section("curves", "Precision and recall", [_curves(data)]),
        Section("trust", "Probability", [trust.section(data.trust, data.followed)]),
        Section("route", "Along the route", [route]),
        Section("map", "Map", [sections.where(data.map, data.matches, correct)]),
        Section("scores", "Scores", [sections.scores(data)]),
        Section("fields", "Receptive fields", [sections.receptive_fields(data)]),
        Section("spikes", "Spikes", [sections.spikes(data)]),
        Section("matches", "Matches", [sections.matches(data, correct)]),
        layers.section(data.layers),
        season.section(data.season),
        Section("cost", "Cost", [sections.cost(data)]),
        Section("setup", "Configuration", [sections.setup(data)]),
    )
    script = f"\n{text('sprite.js')}\n{text('report.js')}\n"
    return sheet(data.title, _header(data), parts, style=sheet_style, payload=_payload(data, sheets), script=script)
