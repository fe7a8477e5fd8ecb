"""A drawing of the sections of each method, as SVG text in the colours of the reports."""

from __future__ import annotations

from lava_vpr.paper_table.run import DatasetRows
from lava_vpr.show.svg import THEME, Style, canvas, to_svg

WIDTH = 560
"""Width of a drawing, in CSS pixels at its natural size."""


def sections(part: DatasetRows, label: str) -> str:
    """R@100P as released: a dot for each section, a bar at their mean, a diamond at what the paper prints."""
    rows = [row for row in part.rows if row.sections or row.printed is not None]
    with Style():
        height = 70 + 26 * len(rows)
        figure = canvas(WIDTH, height)
        axes = figure.add_axes((0.34, 40 / height, 0.64, 1 - 76 / height))
        axes.grid(axis="x", color=THEME["line"], linewidth=0.6, alpha=0.6)
        axes.set_axisbelow(True)
        for k, row in enumerate(rows):
            released = row.spreads.get("released")
            if released is not None:
                values = [100 * value for value in released.by_seed.values()]
                axes.plot(values, [k] * len(values), "o", color=THEME["c0"], markersize=4, alpha=0.45)
                axes.plot([100 * released.mean] * 2, [k - 0.3, k + 0.3], color=THEME["c0"], linewidth=2.4)
            if row.printed is not None:
                axes.plot([100 * row.printed], [k], "D", color=THEME["c1"], markersize=6)
        axes.set(ylim=(len(rows) - 0.5, -0.5), xlim=(-2, 102), xlabel="R@100P released, percent")
        axes.set_yticks(range(len(rows)), [row.method.title for row in rows])
        axes.tick_params(axis="y", length=0, labelcolor=THEME["ink"], labelsize=9)
        top = 1 + 18 / (height - 76)
        for x, marker, colour, text in (
            (0.0, "o", "c0", "a section"),
            (0.3, "|", "c0", "their mean"),
            (0.6, "D", "c1", "printed"),
        ):
            axes.plot(x, top, marker, color=THEME[colour], markersize=6, transform=axes.transAxes, clip_on=False)
            axes.text(x + 0.03, top, text, va="center", transform=axes.transAxes)
        return to_svg(figure, f"sections-{part.dataset.name}", label)
