"""The report's plots, as SVG text (`lava_vpr.show.svg`); equal data give equal bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from lava_vpr.matching.evaluation import Metrics
from lava_vpr.report.data import MapData, Raster, label as label_of
from lava_vpr.show.svg import INSTEAD, THEME, canvas, gridded, outline, themed, to_svg

LARGEST_MATRIX = 360
"""Matrices with more rows or columns than this are pooled before they are drawn."""

MATRIX_BOX = (0.13, 0.03, 0.84, 0.84)
"""Left, top, width and height of a matrix, as shares of its drawing."""

_MARKERS = "osD^vPX*"


def series_style(index: int, default: bool, baseline: bool) -> tuple[str, str]:
    """Name of the colour variable and dash pattern ("" for solid) of the ``index``-th precision-recall curve."""
    return ("c0" if default else f"c{1 + index % 7}"), ("5 3" if baseline else "")


@themed()
def precision_recall(metrics: Mapping[str, Metrics], default: str, baselines: Sequence[str], label: str) -> str:
    """All precision-recall curves; curve ``k`` of ``metrics`` has the id ``pr-k``.

    Every exact point is marked (queries of equal confidence form one), unless there are too many to tell apart.
    """
    figure = canvas(470, 385)
    axes = gridded(figure, (0.1, 0.11, 0.885, 0.865))
    axes.set(xlim=(0, 1.012), ylim=(0, 1.03), xlabel="recall", ylabel="precision")
    for k, (name, figures) in enumerate(metrics.items()):
        colour, dash = series_style(k, name == default, name in baselines)
        recall, precision = np.asarray(figures.recall, float), np.asarray(figures.precision, float)
        axes.plot(
            recall,
            precision,
            gid=str(k),
            label=label_of(name),
            color=THEME[colour],
            linewidth=2.4 if name == default else 1.4,
            linestyle=(0, tuple(float(d) / 1.2 for d in dash.split())) if dash else "-",
            marker=_MARKERS[k % len(_MARKERS)] if len(recall) <= 250 else None,
            markersize=3.2 if name == default else 2.4,
            markeredgewidth=0,
            zorder=4 if name == default else 3,
            clip_on=False,
        )
    return to_svg(figure, "pr", label)


def pooled(scores: NDArray[Any], largest: int = LARGEST_MATRIX) -> tuple[NDArray[np.float64], int, int]:
    """``scores`` reduced to at most ``largest`` rows and columns, one for each block of scores; and the block's sides.

    A block becomes its maximum, since a mean would hide a match, a single bright cell. Scores that are not finite, as
    of incomplete sequences, become NaN.
    """
    values = np.where(np.isfinite(scores), scores, -np.inf).astype(np.float64)
    rows, columns = (max(1, math.ceil(side / largest)) for side in values.shape)
    if values.size:
        values = np.maximum.reduceat(values, np.arange(0, values.shape[0], rows), axis=0)
        values = np.maximum.reduceat(values, np.arange(0, values.shape[1], columns), axis=1)
    return np.where(np.isfinite(values), values, np.nan), rows, columns


def scaled(values: NDArray[np.float64], per_query: bool) -> NDArray[np.float64]:
    """``values`` (queries, places) in 0..1: over the whole matrix, or from each query's worst to its best score."""
    if not np.any(np.isfinite(values)):
        return np.zeros_like(values)
    if per_query:
        known = np.isfinite(values)
        low = np.where(known, values, np.inf).min(axis=1, keepdims=True)
        high = np.where(known, values, -np.inf).max(axis=1, keepdims=True)
    else:
        low, high = (np.full((1, 1), np.nanpercentile(values, q)) for q in (0.5, 99.7))
    span = np.where(high > low, high - low, 1.0)
    return np.clip((values - low) / span, 0, 1)


def _truth_outline(truth: NDArray[np.bool_]) -> Outline:
    """One outline of a closed box for each query, from its first to its last true place; x: queries, y: places."""
    boxes = []
    for query in np.flatnonzero(truth.any(axis=1)):
        places = np.flatnonzero(truth[query])
        breaks = np.flatnonzero(np.diff(places) > 1)
        ends = zip(places[np.r_[0, breaks + 1]], places[np.r_[breaks, len(places) - 1]], strict=True)
        boxes += [(query - 0.5, first - 0.5, 1, last - first + 1) for first, last in ends]
    return outline(boxes)


def _marks(axes: Axes, queries: NDArray[np.intp], matches: NDArray[Any], right: NDArray[np.bool_]) -> None:
    """Draw each best match: a ring if it is right, a cross in another colour if it is wrong."""
    size = 3.4 if len(queries) <= 250 else 2.0
    # The dark cross below the bright one keeps it visible on every colour of the map.
    for is_right, marker, colour, width, name in (
        (True, "o", "#ffffff", 0.9, "right"),
        (False, "x", "#1c0a12", 3.2, "wrong-edge"),
        (False, "x", "#ff7a3d", 1.5, "wrong"),
    ):
        chosen = right == is_right
        axes.plot(
            queries[chosen],
            matches[chosen],
            marker,
            gid=f"match-{name}",
            markersize=size * (1.0 if is_right else 1.4),
            markerfacecolor="none",
            markeredgecolor=colour,
            markeredgewidth=width,
        )


@themed()
def score_matrix(
    scores: NDArray[Any], truth: NDArray[np.bool_], matches: NDArray[Any], prefix: str, label: str
) -> tuple[str, int]:
    """A drawing of scores, with ground truth and best matches over them; queries to the right, places downwards.

    Args:
        scores: Shape (n_queries, n_places), higher is better.
        truth: Same shape; drawn as outlined cells.
        matches: Place of each query, -1 for none.
        prefix: Beginning of the ids within the drawing.
        label: Text alternative of the drawing.
    Returns:
        The drawing, with one image scaled over the whole matrix (id ``PREFIX-whole``) and one scaled per query (id
        ``PREFIX-query``), and the larger side of the block of scores behind a pixel.
    """
    queries, places = scores.shape
    values, rows, columns = pooled(scores)
    extent = (-0.5, queries - 0.5, places - 0.5, -0.5)
    figure = canvas(330, 330)
    left, top, width, height = MATRIX_BOX
    axes = figure.add_axes((left, 1 - top - height, width, height))
    colours = matplotlib.colormaps["viridis"].with_extremes(bad="#888888")
    for name, per_query in (("whole", False), (INSTEAD, True)):
        image = np.ma.masked_invalid(scaled(values, per_query).T)
        axes.imshow(image, colours, aspect="auto", vmin=0, vmax=1, interpolation="none", extent=extent, gid=name)
    if queries and truth.any():
        axes.add_patch(
            PathPatch(
                _truth_outline(truth), facecolor="none", edgecolor="#ffffff", alpha=0.6, linewidth=0.5, gid="truth"
            )
        )
    known = np.flatnonzero(matches >= 0)
    _marks(axes, known, matches[known], truth[known, matches[known]])
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="query", ylabel="place")
    axes.locator_params(nbins=5, integer=True)
    return to_svg(figure, prefix, label), max(rows, columns)


def _ticks(axes: Axes, steps: NDArray[Any], rows: NDArray[Any], half: float, colour: str, width: float) -> None:
    """Draw spikes as vertical ticks, 2 ``half`` rows high, all in one path."""
    if not len(steps):
        return
    vertices = np.empty((len(steps), 2, 2))
    vertices[:, :, 0] = steps[:, None]
    vertices[:, 0, 1], vertices[:, 1, 1] = rows - half, rows + half
    codes = np.tile([Outline.MOVETO, Outline.LINETO], len(steps)).astype(np.uint8)
    outline = Outline(vertices.reshape(-1, 2), codes)
    axes.add_patch(PathPatch(outline, facecolor="none", edgecolor=THEME[colour], linewidth=width, capstyle="butt"))


@themed()
def spike_raster(
    raster: Raster, groups: Mapping[str, NDArray[np.intp]], order: NDArray[np.intp], label: str, prefix: str
) -> str:
    """A drawing of excitatory spikes over the steps, with each neuron's count beside them.

    Args:
        raster: The spikes.
        groups: Neurons to be highlighted, by colour variable (``right``, ``wrong``, ...).
        order: The neurons from top to bottom, a permutation of all.
        label: Text alternative of the drawing.
        prefix: Beginning of the ids within the drawing.
    """
    rows = np.empty(raster.neurons, dtype=np.intp)
    rows[order] = np.arange(raster.neurons)
    steps, neurons = np.asarray(raster.spike_steps), np.asarray(raster.spike_neurons)
    counts = np.bincount(neurons, minlength=raster.neurons)
    figure = canvas(470, 240)
    axes = figure.add_axes((0.1, 0.17, 0.705, 0.8))
    bars = figure.add_axes((0.825, 0.17, 0.155, 0.8), sharey=axes)
    # A tick is at least three pixels tall, however many neurons share the height.
    half = max(0.5, 1.7 * raster.neurons / 190)
    colours = np.full(raster.neurons, "muted", dtype=object)
    for colour, members in groups.items():
        colours[members] = colour
        for row in rows[members]:
            axes.axhspan(row - half, row + half, color=THEME[colour], alpha=0.13, linewidth=0)
    for colour in dict.fromkeys(("muted", *groups)):
        chosen = colours[neurons] == colour
        _ticks(axes, steps[chosen], rows[neurons[chosen]], half, colour, 1.0 if colour == "muted" else 1.7)
        shown = np.flatnonzero((colours == colour) & (counts > 0))
        bars.barh(rows[shown], counts[shown], height=2 * half, color=THEME[colour], linewidth=0)
    axes.set(
        xlim=(-0.5, raster.steps - 0.5),
        ylim=(raster.neurons - 0.5, -0.5),
        xlabel="step",
        ylabel="neuron, in route order",
    )
    axes.locator_params(nbins=5, integer=True)
    bars.set(xlim=(0, max(1, int(counts.max(initial=0))) * 1.05), xlabel="spikes")
    bars.locator_params(axis="x", nbins=2, integer=True)
    bars.tick_params(axis="y", left=False, labelleft=False)
    return to_svg(figure, prefix, label)


_WIDTH, _LEAST, _MOST = 860.0, 300.0, 640.0
_ABOVE_BELOW = 54.0
"""Height of the labels above and below the map together, in pixels."""
_JUMP = 10.0
"""Multiple of the median distance between neighbours above which the line of the route is interrupted."""


def _spans(data: MapData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The lowest and highest coordinates of the drawing in metres, (2,) each, with a margin of 5 % or a metre."""
    points = np.concatenate([data.places, data.queries])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(1.0, 0.05 * float((high - low).max()))
    return low - margin, high + margin


def _route(axes: Axes, places: NDArray[np.float64]) -> None:
    """Draw the places in order, joined by a line that is interrupted at jumps."""
    steps = np.hypot(*np.diff(places, axis=0).T)
    joined = steps <= _JUMP * np.median(steps) if len(steps) else np.zeros(0, np.bool_)
    lines = np.stack([places[:-1], places[1:]], axis=1)[joined]
    axes.add_collection(LineCollection(lines, colors=THEME["muted"], linewidths=1.0, alpha=0.7, zorder=1))
    axes.plot(*places.T, "o", gid="places", color=THEME["muted"], markersize=2.6, markeredgewidth=0, zorder=2)


class Mark(NamedTuple):
    """A group of queries with the same mark in a drawing.

    Attributes:
        name: Name of the group.
        colour: Colour variable.
        marker: Shape, as Matplotlib names it.
        chosen: Whether each query belongs to the group, bool (n_queries,).
    """

    name: str
    colour: str
    marker: str
    chosen: NDArray[np.bool_]


def held_marks(matches: NDArray[np.integer[Any]], correct: NDArray[np.bool_]) -> tuple[Mark, ...]:
    """The marks of queries compared with the truth; right and wrong matches differ in shape and colour."""
    return (
        Mark("missing", "muted", "s", matches < 0),
        Mark("right", "right", "o", correct),
        Mark("wrong", "wrong", "x", (matches >= 0) & ~correct),
    )


def _queries(axes: Axes, data: MapData, matches: NDArray[np.integer[Any]], marks: Sequence[Mark]) -> None:
    """Draw the queries, each with a line to its match."""
    size = 4.2 if len(matches) <= 250 else 2.6
    for name, colour, marker, chosen in marks:
        if name != "missing":
            ends = np.stack([data.queries[chosen], data.places[matches[chosen]]], axis=1)
            axes.add_collection(
                LineCollection(ends, colors=THEME[colour], linewidths=1.1, alpha=0.5, gid=f"error-{name}", zorder=3)
            )
        axes.plot(
            *data.queries[chosen].T,
            marker,
            gid=f"query-{name}",
            markersize=size,
            markerfacecolor="none",
            markeredgecolor=THEME[colour],
            markeredgewidth=1.3,
            zorder=4,
        )


@themed()
def route_map(data: MapData, matches: NDArray[np.integer[Any]], marks: Sequence[Mark], label: str) -> str:
    """The map as SVG, north or y upwards, both axes in metres to one scale.

    Args:
        data: Where places and queries were taken.
        matches: Place of each query, -1 for none, int (n_queries,).
        marks: How queries are drawn; those named ``missing`` have no line to a match.
        label: Text alternative of the drawing.
    """
    low, high = _spans(data)
    tall = float(np.clip(_WIDTH * (high - low)[1] / (high - low)[0], _LEAST, _MOST))
    box = np.array([0.925 * _WIDTH, tall - _ABOVE_BELOW])
    middle, half = (low + high) / 2, box / 2 * ((high - low) / box).max()  # one scale for both axes
    figure = canvas(_WIDTH, tall)
    axes = gridded(figure, (0.065, 42 / tall, 0.925, box[1] / tall))
    _route(axes, data.places)
    _queries(axes, data, matches, marks)
    (left, bottom), (right, top) = (middle - half).tolist(), (middle + half).tolist()
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="east, or x (m)", ylabel="north, or y (m)")
    axes.locator_params(nbins=7)
    axes.ticklabel_format(useOffset=False, style="plain")
    return to_svg(figure, "map", label)


@themed()
def followed_drive(
    matches: NDArray[np.integer[Any]],
    marks: Sequence[Mark],
    off_map: NDArray[np.float64],
    followed: NDArray[np.float64],
    label: str,
) -> str:
    """A drawing of a drive: the matched place of each query, and below it two probabilities of a forward filter.

    Args:
        matches: Number of the matched place of each query, -1 for none, int (n_queries,).
        marks: How queries are drawn.
        off_map: Probability that each query is off the map, float64 (n_queries,).
        followed: Probability that the filter follows the robot there, float64 (n_queries,).
        label: Text alternative of the drawing.
    """
    figure = canvas(_WIDTH, 380)
    axes, below = gridded(figure, (0.075, 0.4, 0.915, 0.58)), gridded(figure, (0.075, 0.13, 0.915, 0.2))
    numbers = np.arange(len(matches))
    for name, colour, marker, chosen in marks:
        (line,) = axes.plot(numbers[chosen], matches[chosen], marker, gid=name, markersize=2.6)
        line.set(markerfacecolor="none", markeredgecolor=THEME[colour])
    below.plot(numbers, off_map, gid="off-map", color=THEME["wrong"], linewidth=1.4)
    below.plot(numbers, followed, gid="followed", color=THEME["right"], linewidth=1.4, linestyle=(0, (4, 3)))
    ends = (-0.5, len(matches) - 0.5)
    axes.set(xlim=ends, ylabel="place")
    axes.tick_params(labelbottom=False)
    below.set(xlim=ends, ylim=(-0.04, 1.04), xlabel="image, in order", ylabel="probability")
    for some in (axes, below):
        some.locator_params(axis="x", nbins=8, integer=True)
    return to_svg(figure, "drive", label)
