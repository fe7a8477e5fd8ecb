"""Drawings of `lava-vpr bench`, as SVG text in the colours of the reports."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lava_vpr.bench.anchors import ANCHORS
from lava_vpr.bench.results import BoardFigures, Measured, StepTimes, SweepPoint
from lava_vpr.bench.show.json_values import PERCENTILES
from lava_vpr.deploy.boards.constants import Estimate, total
from lava_vpr.show.numbers import figure as written, named, ranged
from lava_vpr.show.svg import THEME, canvas, gridded, themed, to_svg

WIDTH = 700
"""Width of a drawing, in CSS pixels at its natural size."""

FEW = 40
"""Below this number of times each is drawn as a point, not in a histogram."""


def _logarithmic(axes: Axes) -> None:
    """A logarithmic x axis with plain numbers, not powers of ten."""
    axes.set(xscale="log")
    line = axes.xaxis
    low, high = sorted(line.get_view_interval())
    narrow = high / max(low, 1e-300) < 150
    line.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,), numticks=12))
    line.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}" if value < 1e5 else f"{value:.0e}"))
    line.set_minor_formatter(NullFormatter())
    line.set_tick_params(which="minor", length=0)


@themed()
def energy(parts: Mapping[str, Estimate], prefix: str, label: str) -> str:
    """Energy of a query by component: nominal bars, whiskers from low to high; the sum at the top, as a stack."""
    order = sorted(parts.items(), key=lambda item: -item[1].nominal)
    whole = total(parts.values())
    rows = len(order) + 1
    canvas_ = canvas(WIDTH, 62 + 34 * rows)
    margin = 62 / (62 + 34 * rows)
    axes = gridded(canvas_, (0.24, margin * 0.8, 0.74, 1 - margin), "x")
    left = 0.0
    for k, (_, value) in enumerate(order):
        colour = THEME[f"c{k % 8}"]
        axes.barh(0, value.nominal, left=left, height=0.62, color=colour, linewidth=0.8, edgecolor=THEME["panel"])
        axes.barh(k + 1, value.nominal, height=0.62, color=colour, linewidth=0)
        left += value.nominal
    room = max(whole.high, 1e-12)
    for k, value in enumerate([whole, *(value for _, value in order)]):
        axes.plot([value.low, value.high], [k, k], color=THEME["ink"], linewidth=1.2)
        for end in (value.low, value.high):
            axes.plot([end, end], [k - 0.16, k + 0.16], color=THEME["ink"], linewidth=1.2)
        shown = ranged(value)
        axes.text(max(value.high, value.nominal) + 0.012 * room, k, shown, va="center", fontsize=10)
    axes.set(xlim=(0, 1.36 * room), ylim=(rows - 0.45, -0.55))
    axes.set_yticks(range(rows), ["all components", *(named(name) for name, _ in order)])
    axes.tick_params(axis="y", length=0, labelcolor=THEME["ink"])
    axes.set_xlabel("modelled dynamic energy of a query, µJ: nominal (low to high)")
    axes.spines["left"].set_visible(False)
    return to_svg(canvas_, prefix, label)


@themed()
def step_times(times: StepTimes, prefix: str, label: str) -> str:
    """Time of every step of a presentation: the busiest core, the barrier on top of it, then the embedded program."""
    busiest = np.asarray(times.busiest, float)
    ended = busiest + times.barrier
    whole = ended + np.asarray(times.program, float)
    steps = np.arange(1, len(busiest) + 1)
    canvas_ = canvas(WIDTH, 250)
    axes = gridded(canvas_, (0.09, 0.19, 0.89, 0.77), "y")
    edges = np.append(steps - 0.5, steps[-1] + 0.5)
    for top, bottom, colour in ((busiest, 0.0, "c6"), (ended, busiest, "c4"), (whole, ended, "c2")):
        axes.stairs(top, edges, baseline=bottom, fill=True, color=THEME[colour], alpha=0.55, linewidth=0)
    axes.set(xlim=(0.5, len(steps) + 0.5), ylim=(0, 1.32 * float(whole.max())))
    axes.set(xlabel="step of a presentation", ylabel="modelled time, µs")
    for left, text, colour in ((0.02, "program", "c2"), (0.16, "barrier", "c4"), (0.28, "cores", "c6")):
        axes.plot(left, 0.93, "s", color=THEME[colour], markersize=9, alpha=0.55, transform=axes.transAxes)
        axes.text(left + 0.02, 0.93, text, va="center", transform=axes.transAxes)
    for left, text, colour, values, style in (
        (0.46, "what arrives", "c0", times.receive, "-"),
        (0.74, "neurons", "c1", times.neurons, "--"),
    ):
        line: dict[str, Any] = {"color": THEME[colour], "linewidth": 1.8, "linestyle": style}
        axes.step(edges, [*values, values[-1]], where="post", **line)
        axes.plot([left, left + 0.05], [0.93, 0.93], transform=axes.transAxes, **line)
        axes.text(left + 0.06, 0.93, text, va="center", transform=axes.transAxes)
    return to_svg(canvas_, prefix, label)


@themed()
def latencies(rows: Sequence[Measured], label: str) -> str:
    """A histogram of single queries for each backend, one above the other over one logarithmic axis."""
    rows = sorted(
        (backend for backend in rows if backend.milliseconds),
        key=lambda backend: float(np.median(backend.milliseconds)),
    )
    values = [np.asarray(backend.milliseconds, float) for backend in rows]
    low, high = 0.8 * min(v.min() for v in values), 1.25 * max(v.max() for v in values)
    bins = np.geomspace(low, high, 97)
    height = 50 + 62 * len(rows)
    canvas_ = canvas(WIDTH, height)
    axes = gridded(canvas_, (0.17, 40 / height, 0.81, 1 - 46 / height), "x")
    for k, times in enumerate(values):
        base = len(rows) - 1 - k
        colour = THEME[f"c{k % 8}"]
        if len(times) < FEW:
            axes.plot(times, np.full(len(times), base + 0.2), "o", color=colour, alpha=0.7, markeredgewidth=0)
        else:
            counts, _ = np.histogram(times, bins)
            ridge = base + 0.62 * counts / counts.max()
            axes.stairs(ridge, bins, baseline=base, fill=True, color=colour, alpha=0.85, linewidth=0)
        axes.axhline(base, color=THEME["line"], linewidth=0.8)
        at = np.percentile(times, PERCENTILES)
        for value in at:
            axes.plot([value, value], [base, base + 0.66], color=THEME["ink"], linewidth=1)
        shown = ", ".join(f"p{q} {written(v)}" for q, v in zip(PERCENTILES, at, strict=True))
        side = "left" if math.log(at[1] / low) < 0.5 * math.log(high / low) else "right"
        axes.text(at[0 if side == "left" else 2], base + 0.72, shown, ha=side, va="bottom", fontsize=9.5)
    axes.set(xlim=(low, high), ylim=(-0.02, len(rows)))
    _logarithmic(axes)
    axes.set_yticks([len(rows) - 1 - k + 0.3 for k in range(len(rows))], [backend.name for backend in rows])
    axes.tick_params(axis="y", length=0, labelcolor=THEME["ink"])
    axes.set_xlabel("measured time of a single query, ms")
    axes.spines["left"].set_visible(False)
    return to_svg(canvas_, "latency", label)


@themed()
def pareto(rows: Sequence[SweepPoint], label: str) -> str:
    """Recall of every setting against its energy and its time; a line joins the front, and chosen points have names."""
    canvas_ = canvas(WIDTH + 200, 404)
    recalls = [100 * candidate.metrics.recall_at_1 for candidate in rows]
    for k, what in enumerate(("energy on the board, µJ", "time on the chip, ms")):
        axes = gridded(canvas_, (0.07 + 0.49 * k, 0.13, 0.43, 0.78))
        costs = [candidate.board_microjoules if k == 0 else candidate.milliseconds for candidate in rows]
        for early, (_, colour, style, marker) in zip((True, False), _FRONTS, strict=True):
            points = [
                (cost, recall)
                for cost, recall, candidate in zip(costs, recalls, rows, strict=True)
                if ("stop_margin" in candidate.settings) == early
            ]
            _front(axes, points, colour, style, marker)
        chosen = [
            (x, y, candidate.chosen) for x, y, candidate in zip(costs, recalls, rows, strict=True) if candidate.chosen
        ]
        axes.set(xlim=(0.8 * min(costs), 1.25 * max(costs)))
        _names(axes, chosen, (max(-1.5, min(recalls) - 3), min(101.5, max(recalls) + 3)))
        _logarithmic(axes)
        axes.set_xlabel(f"modelled {what}, of a query (Kapoho Bay, nominal)")
        axes.set_ylabel("R@1, %" if k == 0 else "")
    legend = canvas_.add_axes((0.07, 0.93, 0.92, 0.07))
    legend.set(xlim=(0, 1), ylim=(0, 1))
    legend.axis("off")
    for k, (text, colour, style, marker) in enumerate(reversed(_FRONTS)):
        x = 0.38 * k
        legend.plot([x, x + 0.03], [0.5, 0.5], marker, color=THEME[colour], linestyle=style, markersize=5)
        legend.text(x + 0.04, 0.5, text, va="center")
    return to_svg(canvas_, "pareto", label)


_FRONTS = (
    ("best with early stopping, which no backend does yet", "c2", "--", "^"),
    ("best that every backend can run", "c0", "-", "o"),
)
"""The fronts and points drawn separately: text, colour, line and marker."""


def _front(axes: Axes, points: Sequence[tuple[float, float]], colour: str, style: str, marker: str) -> None:
    """Points of cost and recall, and a line along those that no cheaper one reaches."""
    if not points:
        return
    x, y = zip(*points, strict=True)
    axes.plot(x, y, marker, color=THEME["c6"], markersize=3.4, alpha=0.5, markeredgewidth=0)
    best: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda p: (p[0], -p[1])):
        if not best or point[1] > best[-1][1]:
            best.append(point)
    x, y = zip(*best, strict=True)
    axes.step(x, y, where="post", color=THEME[colour], linewidth=1.4, linestyle=style)
    axes.plot(x, y, marker, color=THEME[colour], markersize=5, markeredgewidth=0)


def _names(axes: Axes, points: Sequence[tuple[float, float, str]], span: tuple[float, float]) -> None:
    """Mark points, and write their names above and to the left of the front, where no points are."""
    room = 0.07 * (span[1] - span[0])
    for k, (x, y, name) in enumerate(sorted(points)):
        height = span[1] + room * (k + 0.6)
        axes.plot([x, x], [y, height], color=THEME["c1"], linewidth=0.9)
        axes.plot(x, y, "D", color=THEME["c1"], markersize=8, markeredgecolor=THEME["panel"], zorder=5)
        axes.annotate(name, (x, height), xytext=(-5, 0), textcoords="offset points", ha="right", va="center")
    axes.set(ylim=(span[0], span[1] + room * (len(points) + 0.4)))


def _exact(value: float | None) -> Estimate | None:
    return None if value is None else Estimate(value, value, value)


@themed()
def beside_anchors(ours: BoardFigures, label: str) -> str:
    """Modelled energy and time of this network above published figures of others; two logarithmic axes."""
    rows: list[tuple[str, str, tuple[Estimate | None, Estimate | None]]] = [
        ("this network, modelled", "c0", (ours.dynamic_microjoules, ours.milliseconds))
    ]
    for anchor in ANCHORS:
        if anchor.microjoules is not None or anchor.milliseconds is not None:
            colour = "c1" if anchor.kind == "measured" else "c6"
            rows.append((anchor.name, colour, (_exact(anchor.microjoules), _exact(anchor.milliseconds))))
    height = 50 + 27 * len(rows)
    canvas_ = canvas(WIDTH + 200, height)
    for k, text in enumerate(("energy of an answer, µJ", "time of an answer, ms")):
        axes = gridded(canvas_, (0.235 + 0.4 * k, 40 / height, 0.35, 1 - 44 / height), "x")
        shown = [(i, row[1], value) for i, row in enumerate(rows) if (value := row[2][k]) is not None]
        for i, colour, value in shown:
            axes.plot([value.low, value.high], [i, i], color=THEME[colour], linewidth=4, alpha=0.45)
            inside = THEME["panel" if colour == "c6" else colour]
            marker = "D" if i == 0 else "o"
            axes.plot(value.nominal, i, marker, color=THEME[colour], markersize=8, markerfacecolor=inside)
            axes.annotate(
                written(value.nominal), (value.high, i), xytext=(10, 0), textcoords="offset points", va="center"
            )
        low, high = (f(v.low if f is min else v.high for _, _, v in shown) for f in (min, max))
        axes.set(xlim=(0.4 * low, 6 * high), ylim=(len(rows) - 0.4, -0.6))
        _logarithmic(axes)
        axes.set_yticks(range(len(rows)), [row[0] for row in rows] if k == 0 else [""] * len(rows))
        axes.tick_params(axis="y", length=0, labelcolor=THEME["ink"])
        axes.axhline(0.5, color=THEME["line"], linewidth=0.8)
        axes.set_xlabel(text)
        axes.spines["left"].set_visible(False)
    return to_svg(canvas_, "anchors", label)
