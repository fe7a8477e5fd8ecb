"""The report's map: the route, the queries, and a line from each query to the place that it was matched with."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from lava_vpr.report.data import MapData
from lava_vpr.show.svg import THEME, Style, canvas, to_svg

_WIDTH, _LEAST, _MOST = 860.0, 300.0, 640.0
_ABOVE_BELOW = 54.0
"""Pixels above and below the map, with its labels."""
_JUMP = 10.0
"""Where neighbours are so many times as far apart as most are, the route is not drawn through."""


def _spans(data: MapData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The corners of what is drawn, with a margin of a twentieth, at least a metre."""
    points = np.concatenate([data.places, data.queries])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(1.0, 0.05 * float((high - low).max()))
    return low - margin, high + margin


def _route(axes: Axes, places: NDArray[np.float64]) -> None:
    """The places in their order, joined by a line but for jumps."""
    steps = np.hypot(*np.diff(places, axis=0).T)
    joined = steps <= _JUMP * np.median(steps) if len(steps) else np.zeros(0, np.bool_)
    lines = np.stack([places[:-1], places[1:]], axis=1)[joined]
    axes.add_collection(LineCollection(lines, colors=THEME["muted"], linewidths=1.0, alpha=0.7, zorder=1))
    axes.plot(*places.T, "o", gid="places", color=THEME["muted"], markersize=2.6, markeredgewidth=0, zorder=2)


def _queries(axes: Axes, data: MapData, matches: NDArray[np.integer[Any]], correct: NDArray[np.bool_]) -> None:
    """The queries, each with a line to its match; shape and colour both tell whether that is right."""
    size = 4.2 if len(matches) <= 250 else 2.6
    for name, colour, marker, chosen in (
        ("missing", "muted", "s", matches < 0),
        ("right", "right", "o", correct),
        ("wrong", "wrong", "x", (matches >= 0) & ~correct),
    ):
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


def route_map(data: MapData, matches: NDArray[np.integer[Any]], correct: NDArray[np.bool_], label: str) -> str:
    """The map as SVG, north or y upwards, both axes in metres to one scale.

    Args:
        data: Where places and queries were taken.
        matches: Place of each query, -1 for none, int (n_queries,).
        correct: Which of them are right, bool (n_queries,).
        label: What the drawing says, for who does not see it.
    """
    low, high = _spans(data)
    tall = float(np.clip(_WIDTH * (high - low)[1] / (high - low)[0], _LEAST, _MOST))
    box = np.array([0.925 * _WIDTH, tall - _ABOVE_BELOW])
    middle, half = (low + high) / 2, box / 2 * ((high - low) / box).max()  # one scale for both axes
    with Style():
        figure = canvas(_WIDTH, tall)
        axes = figure.add_axes((0.065, 42 / tall, 0.925, box[1] / tall))
        axes.grid(color=THEME["line"], linewidth=0.6, alpha=0.6)
        axes.set_axisbelow(True)
        _route(axes, data.places)
        _queries(axes, data, matches, correct)
        (left, bottom), (right, top) = (middle - half).tolist(), (middle + half).tolist()
        axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="east, or x (m)", ylabel="north, or y (m)")
        axes.locator_params(nbins=7)
        axes.ticklabel_format(useOffset=False, style="plain")
        return to_svg(figure, "map", label)
