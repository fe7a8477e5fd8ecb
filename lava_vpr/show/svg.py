"""Drawings as SVG text for a page, and as files for a paper: matplotlib without pyplot, without dates.

Colours are written as CSS variables of the page (`templates/page.css`), so that one drawing serves the light and
the dark theme; on paper they are those of the light one. Equal data give equal bytes.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from html import unescape
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline

from lava_vpr.show.templates import text

# matplotlib needs real colours: each of these stands for the CSS variable of its name until the text is written.
_VARIABLES = ("ink", "muted", "line", "panel", "right", "wrong", *(f"c{i}" for i in range(8)))
THEME = {name: f"#0{i:x}e5f{i:x}" for i, name in enumerate(_VARIABLES)}

_PAPER = dict(re.findall(r"--(\w+):(#[0-9a-f]+)", text("page.css").partition("@media")[0]))
_papers: list[Path] = []
"""Folders that drawings go to as files, too; the last counts."""


def _style() -> dict[str, Any]:
    """matplotlib's settings, in the colours of `THEME`."""
    return {
        "svg.fonttype": "none",
        "svg.hashsalt": "lava-vpr",
        "svg.image_inline": True,
        "pdf.fonttype": 42,
        "image.composite_image": False,
        "path.simplify": False,
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
        "font.size": 10.5,
        "text.parse_math": False,
        "text.color": THEME["ink"],
        "axes.edgecolor": THEME["line"],
        "axes.labelcolor": THEME["muted"],
        "axes.facecolor": "none",
        "figure.facecolor": "none",
        "xtick.color": THEME["line"],
        "ytick.color": THEME["line"],
        "xtick.labelcolor": THEME["muted"],
        "ytick.labelcolor": THEME["muted"],
        "axes.spines.top": False,
        "axes.spines.right": False,
    }


@contextmanager
def in_paper_colours() -> Iterator[None]:
    """Draw in the colours of paper."""
    page = dict(THEME)
    THEME.update({name: _PAPER[name] for name in THEME})
    try:
        yield
    finally:
        THEME.update(page)


@contextmanager
def on_paper(folder: Path) -> Iterator[None]:
    """Write all that is drawn to ``folder``, too, as SVG and as PDF, each with a legend, in colours of paper.

    Raises:
        OSError: it cannot be written.
    """
    _papers.append(folder)
    try:
        with in_paper_colours():
            yield
    finally:
        _papers.pop()


def _print(figure: Figure, name: str, label: str) -> None:
    """Write ``figure`` to the last of `_papers`."""
    for axes in figure.axes:
        for image in axes.images:
            image.set_visible(image.get_gid() != INSTEAD)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(fontsize=8, frameon=False)
    for kind, date in (("svg", "Date"), ("pdf", "CreationDate")):
        figure.savefig(_papers[-1] / f"{name}.{kind}", metadata={"Title": unescape(label), date: None})


INSTEAD = "query"
"""The id of an image that a page shows in place of another when a reader asks for it; on paper it is left out."""


def to_svg(figure: Figure, prefix: str, label: str) -> str:
    """``figure`` as an ``<svg>`` element for use inside a page; ``prefix`` keeps its ids apart from other drawings'."""
    if _papers:
        _print(figure, prefix, label)
    written = io.StringIO()
    figure.savefig(written, format="svg", metadata={"Date": None})
    svg = written.getvalue()
    svg = svg[svg.index("<svg") :].strip()
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r' id="', f' id="{prefix}-', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\1{prefix}-", svg)
    for name, colour in THEME.items():
        svg = svg.replace(colour, f"var(--{name})")
    svg = re.sub(r"'DejaVu Sans'[^;\"]*", "var(--sans)", svg)
    view = re.search(r'viewBox="[\d.]+ [\d.]+ ([\d.]+) [^"]*"', svg)
    # Neither a fixed size nor namespaces: the page scales the drawing, and HTML knows what SVG is. On a narrow screen
    # the style sheet keeps a share of the natural width, so that words can be read.
    frame = f'{view.group(0)} style="--natural:{float(view.group(1)):g}px"' if view else ""
    opening = f'<svg role="img" aria-label="{label}" {frame}>'
    return opening + re.sub(r"\n\s*", "\n", svg[svg.index(">") + 1 :])


def canvas(width: float, height: float) -> Figure:
    """A figure whose SVG units are CSS pixels at its natural size, with a canvas of its own."""
    figure = Figure(figsize=(width / 72, height / 72), dpi=72)
    FigureCanvasSVG(figure)
    return figure


def gridded(figure: Figure, box: tuple[float, float, float, float], axis: Literal["x", "y", "both"] = "both") -> Axes:
    """Axes at ``box`` (left, bottom, width and height, as shares) with faint lines at their ticks, below all else."""
    axes = figure.add_axes(box)
    axes.grid(axis=axis, color=THEME["line"], linewidth=0.6, alpha=0.6)
    axes.set_axisbelow(True)
    return axes


def outline(boxes: Iterable[tuple[float, float, float, float]]) -> Outline:
    """The outlines of all ``boxes`` (left, top, width and height) as one path."""
    corners = [
        corner
        for left, top, width, height in boxes
        for corner in (
            (left, top),
            (left + width, top),
            (left + width, top + height),
            (left, top + height),
            (left, top),
        )
    ]
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY] * (len(corners) // 5)
    return Outline(np.array(corners).reshape(-1, 2), codes)


@contextmanager
def themed(settings: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Draw with ``settings``, or those of pages, whatever the user's matplotlibrc says: in a ``with`` block, or a
    decorated function."""
    # matplotlib makes ids of what numbers print as, which numpy 2 changed.
    with matplotlib.rc_context(), np.printoptions(legacy="1.21"):
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_style() if settings is None else settings)
        yield
