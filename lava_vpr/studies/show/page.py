"""The page of a study and its drawings: one HTML file without a script, in the look and colours of the reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator

from lava_vpr.experiments.grid import Row, Spread
from lava_vpr.experiments.task import MODELLED, NETWORK
from lava_vpr.matching.evaluation import Recall, titles
from lava_vpr.show.page import Section, drawn, reproduction, sheet, terms
from lava_vpr.show.svg import THEME, canvas, gridded, themed, to_svg
from lava_vpr.show.templates import render, safe
from lava_vpr.studies.show.values import SHOWN, table
from lava_vpr.studies.study import Study, StudyRequest

WIDTH = 560
"""Width of a drawing, in CSS pixels at its natural size."""
Kind = tuple[str, str, str, str]
"""What is drawn: figure, name, colour and marker."""
KINDS: tuple[Kind, ...] = tuple(zip(Recall._fields, titles(), ("c0", "c1", "c2"), ("o", "s", "^"), strict=True))
"""What is drawn of a study."""


def _legend(axes: Axes, entries: Sequence[tuple[str, str, str, str]]) -> None:
    """Names of what is drawn, above the axes: text, colour, marker, line."""
    step = 1 / max(5, len(entries))
    for k, (name, colour, marker, line) in enumerate(entries):
        x = k * step
        axes.plot(
            [x, x + 0.04], [1.07, 1.07], color=THEME[colour], marker=marker, linestyle=line, markersize=5,
            transform=axes.transAxes, clip_on=False,
        )  # fmt: skip
        axes.text(x + 0.055, 1.07, name, va="center", transform=axes.transAxes)


def _extent(value: Spread) -> tuple[float, float]:
    """The least and the most over seeds, in percent."""
    return 100 * min(value.by_seed.values()), 100 * max(value.by_seed.values())


def _mean(row: Row, name: str, group: str = NETWORK) -> float:
    """The mean of a figure over seeds, in percent."""
    return 100 * row.figures[group][name].mean


def _in_percent(axis: Axis) -> None:
    """Let an axis of recall end just above 100 %, show ten percent at least, and no tick beyond 100."""
    low = min(90.0, *axis.get_view_interval())
    limit = axis.axes.set_xlim if axis is axis.axes.xaxis else axis.axes.set_ylim
    limit(low, 101.5)
    axis.set_ticks([tick for tick in axis.get_ticklocs() if low <= tick <= 100.0])


@themed()
def curve(rows: Sequence[Row], axis: str, label: str) -> str:
    """Recall along an axis: means joined, bars from the least to the most seed; cosine dashed."""
    rows = [row for row in rows if row.value is not None]
    xs = [float(row.value or 0) for row in rows]
    figure = canvas(WIDTH, 300)
    axes = gridded(figure, (0.1, 0.16, 0.88, 0.72), "y")
    axes.set(xscale="log")
    entries = []
    for key, name, colour, marker in KINDS:
        means = [_mean(row, key) for row in rows]
        axes.plot(xs, means, color=THEME[colour], marker=marker, markersize=5)
        for x, row in zip(xs, rows, strict=True):
            axes.plot([x, x], _extent(row.figures[NETWORK][key]), color=THEME[colour], linewidth=3, alpha=0.45)
        entries.append((name, colour, marker, "-"))
    beside = [
        (x, _mean(row, "recall_at_1", "cosine")) for x, row in zip(xs, rows, strict=True) if "cosine" in row.figures
    ]
    if beside:
        axes.plot(*zip(*beside, strict=True), color=THEME["c6"], linestyle="--")
        entries.append(("cosine, R@1", "c6", "", "--"))
    axes.xaxis.set_major_locator(FixedLocator(xs))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xticklabels([row.label for row in rows])
    _in_percent(axes.yaxis)
    axes.set(xlabel=axis, ylabel="percent")
    _legend(axes, entries)
    return to_svg(figure, "curve", label)


@themed()
def costs(rows: Sequence[Row], axis: str, label: str) -> str:
    """R@1 against modelled energy and time, points named by their value."""
    rows = [row for row in rows if MODELLED in row.figures]
    figure = canvas(WIDTH, 270)
    for k, (name, what) in enumerate(zip(SHOWN, ("energy on the board, µJ", "time on the chip, ms"), strict=True)):
        axes = gridded(figure, (0.1 + 0.46 * k, 0.18, 0.42, 0.74))
        points = [(row.figures[MODELLED][name].mean, _mean(row, "recall_at_1"), row.label) for row in rows]
        axes.plot([x for x, _, _ in points], [y for _, y, _ in points], color=THEME["c0"], marker="o", markersize=5)
        for number, (x, y, point) in enumerate(points):
            place = (4, 6 if number % 2 else -12)  # neighbours above and below
            axes.annotate(point, (x, y), xytext=place, textcoords="offset points", fontsize=9)
        axes.set(xlabel=f"modelled {what}", ylabel="R@1, %" if k == 0 else "")
        axes.margins(0.12)
        _in_percent(axes.yaxis)
    return to_svg(figure, "costs", label)


@themed()
def lines(
    labels: Sequence[str],
    kinds: Sequence[Kind],
    rows: Sequence[Sequence[Spread | None]],
    label: str,
    name: str = "lines",
) -> str:
    """Recall of rows one below the other: every seed or section a dot, the mean a mark.

    Args:
        labels: What the rows are called.
        kinds: What is drawn of each.
        rows: A figure of each kind; None: there is none.
        label: The drawing in words.
        name: What keeps it apart from the others of its page.
    """
    height = 60 + 30 * len(rows)
    figure = canvas(WIDTH, height)
    left = min(0.55, 0.03 + 0.0112 * max(map(len, labels)))
    axes = gridded(figure, (left, 40 / height, 0.98 - left, 1 - 68 / height), "x")
    for k, row in enumerate(rows):
        for number, (kind, spread) in enumerate(zip(kinds, row, strict=True)):
            if spread is None:
                continue
            place, mean = k + 0.22 * (number - (len(kinds) - 1) / 2), 100 * spread.mean
            values = [100 * value for value in spread.by_seed.values()]
            axes.plot(values, [place] * len(values), kind[3], color=THEME[kind[2]], markersize=4, alpha=0.45)
            axes.plot([mean, mean], [place - 0.11, place + 0.11], color=THEME[kind[2]], linewidth=2.4)
    axes.set(ylim=(len(rows) - 0.5, -0.5), xlabel="percent")
    _in_percent(axes.xaxis)
    axes.set_yticks(range(len(rows)), labels)
    axes.tick_params(axis="y", length=0, labelcolor=THEME["ink"], labelsize=9)
    top = 1 + 16 / (height - 68)
    for k, (_, words, colour, marker) in enumerate(kinds):
        axes.plot(0.3 * k, top, marker, color=THEME[colour], markersize=5, transform=axes.transAxes, clip_on=False)
        axes.text(0.3 * k + 0.03, top, words, va="center", transform=axes.transAxes)
    return to_svg(figure, name, label)


def _drawings(study: Study, rows: Sequence[Row]) -> list[str]:
    """The plots of a study, each in a panel."""
    title, varied = study.title, study.varied
    if study.drawn == "rows":
        figures = [[row.figures[NETWORK][key] for key in Recall._fields] for row in rows]
        svg = lines([row.label for row in rows], KINDS, figures, safe(f"{title}: recall of each row"))
        panels = [drawn("Recall: dots are seeds, marks their means", svg)]
    else:
        svg = curve(rows, varied, safe(title))
        panels = [drawn("Recall: means of the seeds, bars from the least to the most", svg)]
    if study.costed and sum(MODELLED in row.figures for row in rows) > 1:
        svg = costs(rows, varied, safe(f"{title}: R@1 against modelled energy and time of a query"))
        panels.append(drawn("Recall against modelled costs of a query", svg))
    return panels


def header_of(title: str, facts: Mapping[str, str]) -> str:
    """The head of a page: what it is about, terms, and what they say."""
    said = terms((name, safe(value)) for name, value in facts.items())
    return render("study_header.html", title=safe(title), facts=said)


def page(asked: StudyRequest, rows: Sequence[Row], command: str) -> str:
    """The whole page as HTML text, with the command that repeats it; equal results give equal text."""
    facts = {
        "places": f"{asked.route.places:,}",
        "queries": f"{len(asked.route.queries):,}",
        "seeds": ", ".join(map(str, asked.seeds)),
        "preset": asked.config.preset,
        "decoder": asked.config.decoder.default,
    }
    sections = (
        Section("plots", "Plots", _drawings(asked.study, rows), "Plots"),
        Section("table", "Table", [table(asked, rows)], "Table"),
        reproduction(command),
    )
    return sheet(asked.study.title, header_of(asked.study.title, facts), sections)
