"""A drawing of the spikes in all layers of a spiking front end for one image; equal data give equal bytes."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from lava_vpr.inputs.front_end import COLUMNS, FrontEnd
from lava_vpr.report.images import edge_direction
from lava_vpr.show.page import Section
from lava_vpr.show.svg import THEME, canvas, in_paper_colours, themed, to_svg

_HUES = ("#d9485f", "#c57418", "#948b12", "#3a9a3c", "#17978f", "#2787c4", "#7b68d8", "#c34fb8")
"""Colours of directions in the order of their angles, once around the colour circle; readable on white and on black."""
_PLAIN = "#7d8894"
_WIDTH, _HEIGHT = 860.0, 880.0
_ROWS = {"events": 60, "clock": 30, "pixels": 66, "filters": 88, "pairs": 72, "onsets": 56, "cells": 72, "pools": 36}
"""Height of each population in the raster, in pixels."""
_GAP = 7
_THICK = (2.4, 1.5, 0.8)
"""Widths of the strokes of pairs that spike in the first third of the race, in the second, and later."""


class Layers(NamedTuple):
    """The spikes of a spiking front end for one image.

    Attributes:
        name: Name of the image.
        spec: The front end.
        image: The image, possibly reduced, uint8 (h, w, 3) BGR.
        trains: Spikes of each population by name, uint8 (steps, neurons); with input by events also those of the axons
            at which they arrive, ``events``.
    """

    name: str
    spec: FrontEnd
    image: NDArray[np.uint8]
    trains: dict[str, NDArray[np.uint8]]

    @classmethod
    def of(cls, spec: FrontEnd, image: NDArray[np.uint8], name: str, seen: NDArray[np.uint8] | None = None) -> Layers:
        """Run ``spec`` on ``image`` (h, w, 3) BGR, or on ``seen``, its pixels as ``spec`` takes them."""
        shown = (spec.seen(image) if seen is None else seen)[None]
        axons = {"events": spec.events(shown)[0].astype(np.uint8)} if spec.window else {}
        return cls(name, spec, image, axons | {name: film[0] for name, film in spec.trains(shown).items()})

    @property
    def edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Direction and step of the first pair of filters to spike at each position, int64 (rows, columns) each.

        The step is ``spec.steps`` where no pair spikes.
        """
        film = self.trains["pairs"].reshape(self.spec.steps, self.spec.height, -1, self.spec.directions)
        steps = np.where(film.any(axis=0), film.argmax(axis=0), self.spec.steps)
        return steps.argmin(axis=2) % self.spec.orientations, steps.min(axis=2)

    def by_direction(self, name: str) -> tuple[NDArray[np.uint8], int]:
        """The spikes of a population, uint8 (steps, neurons), ordered by direction, and the number of directions.

        A population without directions has 1.
        """
        film, spec = self.trains[name], self.spec
        if name in ("filters", "pairs"):
            both = film.reshape(spec.steps, -1, 2, spec.orientations)
            return both.transpose(0, 3, 1, 2).reshape(film.shape), spec.orientations
        return film, spec.orientations if name in ("onsets", "cells") else 1


def section(found: Layers | None) -> Section:
    """The section of a page; without content if there is no spiking front end."""
    if found is None:
        return Section("layers", "Front end", [])
    note = f"What happens in the front end when it is shown {found.name}, the surest match. {_NOTE}"
    return Section("layers", "Front end", [f'<div class="panel scroll">{drawing(found)}</div>'], "Front end", note)


_NOTE = (
    "Pixels spike once, the brighter the earlier. Pairs of filters spike with edges, the stronger the earlier; the "
    "strokes run along the edge that is first at its spot. Cells count how much earlier than its neighbours an edge is."
)


@themed()
def drawing(found: Layers) -> str:
    """The layers as SVG for a page."""
    spikes = ", ".join(f"{int(film.sum()):,} of {_sources(name)}" for name, film in found.trains.items())
    return to_svg(_figure(found), "layers", f"Layers of the front end in {found.spec.steps} steps; spikes: {spikes}")


@in_paper_colours()
@themed()
def picture(found: Layers, dots: int = 115) -> bytes:
    """The layers as a PNG file in the colours of paper, 11.9 inches wide, with ``dots`` an inch."""
    written = io.BytesIO()
    _figure(found).savefig(written, format="png", dpi=dots, facecolor=THEME["panel"], metadata={"Software": None})
    return written.getvalue()


def _figure(found: Layers) -> Figure:
    """The figure of all layers: image, pixels and edges; cells by direction; all populations over the steps."""
    figure = canvas(_WIDTH, _HEIGHT)
    _axes(figure, 6, 30, 258, 193).imshow(found.image[..., ::-1], aspect="auto")
    _pixels(figure, found)
    _edges(_axes(figure, 596, 30, 258, 193, frame=True), found)
    _cells(figure, found)
    _raster(_axes(figure, 118, 412, 646, 425), found)
    for left, top, words in (
        (6, 25, "image"),
        (284, 25, "pixels: the step of the spike"),
        (596, 25, "edges: the first pair at each spot, thick if early"),
        (6, 258, "cells: spikes of each, by the direction of the gradient in degrees; the line before it: the edge"),
        (6, 384, f"spikes of all populations in {found.spec.steps} steps"),
    ):
        figure.text(left / _WIDTH, 1 - top / _HEIGHT, words, color=THEME["ink"])
    return figure


def _axes(figure: Figure, left: float, top: float, width: float, height: float, frame: bool = False) -> Axes:
    """Axes without ticks; all measures in pixels, ``left`` and ``top`` from the figure's upper left corner."""
    box = (left / _WIDTH, 1 - (top + height) / _HEIGHT, width / _WIDTH, height / _HEIGHT)
    axes = figure.add_axes(box, xticks=[], yticks=[])
    axes.spines[:].set_visible(frame)
    return axes


def _scale(axes: Axes, ticks: Iterable[int], words: Iterable[object]) -> None:
    """Label the right side of ``axes``, a scale of grey levels or colours, with ``words`` at ``ticks``."""
    axes.yaxis.tick_right()
    axes.set_yticks(list(ticks), [str(word) for word in words], fontsize=9)
    axes.tick_params(length=0)


def _pixels(figure: Figure, found: Layers) -> None:
    """Draw the step at which each pixel spikes, earlier ones brighter, and the scale."""
    spec = found.spec
    steps = found.trains["pixels"].argmax(axis=0).reshape(spec.height, spec.width)
    span = np.arange(spec.window, spec.window + spec.levels)
    for axes, values in ((_axes(figure, 284, 30, 258, 193), steps), (_axes(figure, 548, 30, 9, 193), span[:, None])):
        axes.imshow(values, "gray_r", aspect="auto", vmin=span[0], vmax=span[-1], interpolation="none")
    ticks = np.unique(np.linspace(0, spec.levels - 1, 5).astype(int)).tolist()
    _scale(axes, ticks, span[ticks])


def _edges(axes: Axes, found: Layers) -> None:
    """Draw the first edge at each position as a stroke along it, in the colour of its direction."""
    spec, apart = found.spec, COLUMNS * found.spec.joined
    channels, steps = found.edges
    late = np.clip(3 * (steps - spec.window - spec.levels) // max(1, spec.race), 0, 2)
    for channel in range(spec.orientations):
        half = 1.15 * apart / 2 * np.array(edge_direction(channel, spec.orientations))
        for thickness, width in enumerate(_THICK):
            rows, columns = np.nonzero((channels == channel) & (late == thickness) & (steps < spec.steps))
            middles = np.stack([apart * columns + (apart - 1) / 2, 2 * rows + 1.0], axis=1)
            ends = np.stack([middles - half, middles + half], axis=1).reshape(-1, 2)
            codes = np.tile([Outline.MOVETO, Outline.LINETO], len(rows)).astype(np.uint8)
            if len(rows):
                outline = Outline(ends, codes)
                axes.add_patch(PathPatch(outline, edgecolor=_hue(channel, spec), linewidth=width, facecolor="none"))
    axes.set(xlim=(-1, spec.width), ylim=(2 * spec.height, 0))


def _hue(channel: int, spec: FrontEnd) -> str:
    """The colour of direction ``channel``."""
    return _HUES[channel * len(_HUES) // spec.orientations]


def _cells(figure: Figure, found: Layers) -> None:
    """Draw the number of spikes of each cell, a map for each direction in its colour, and the scale."""
    spec = found.spec
    wide, shape = 800 / spec.orientations, (spec.orientations, spec.grid, spec.grid)
    for channel, counts in enumerate(found.trains["cells"].sum(axis=0).reshape(shape)):
        hue, (x, y) = _hue(channel, spec), edge_direction(channel, spec.orientations)
        axes = _axes(figure, 6 + wide * channel, 287, wide - 8, 0.75 * (wide - 8), frame=True)
        _tinted(axes, counts / spec.most, np.array(to_rgb(hue)))
        ends = np.array([-0.08, 0.08])
        axes.plot(0.09 + ends * x, 1.15 - ends * y / 0.75, color=hue, lw=2.4, transform=axes.transAxes, clip_on=False)
        axes.text(0.22, 1.09, f"{180 * channel / spec.orientations:g}°", color=hue, transform=axes.transAxes)
    scale = _axes(figure, 818, 287, 9, 0.75 * (wide - 8))
    _tinted(scale, np.arange(spec.most, -1, -1)[:, None] / spec.most, np.array(to_rgb(_PLAIN)))
    _scale(scale, (0, spec.most), (spec.most, 0))


def _tinted(axes: Axes, shares: NDArray[np.float64], colours: NDArray[np.float64], **options: Any) -> None:
    """Draw ``shares`` (rows, columns), 0..1, as opacities of ``colours``, (3,) or (rows, 1, 3)."""
    image = np.empty((*shares.shape, 4))
    image[..., :3], image[..., 3] = colours, shares
    axes.imshow(image, aspect="auto", interpolation="none", **options)


def _sources(name: str) -> str:
    """The name of a part of the raster: that of a population, or of the axons at which events arrive."""
    return "event axons" if name == "events" else name


def _raster(axes: Axes, found: Layers) -> None:
    """Draw the spikes of all populations over the steps; in large ones a row stands for several neurons."""
    spec, top = found.spec, 0
    small: dict[str, Any] = {"fontsize": 9.5, "color": THEME["muted"]}
    for name, film in found.trains.items():
        middle = top + _ROWS[name] / 2
        _band(axes, found, name, top)
        axes.text(-0.8, middle, f"{film.shape[1]:,} {_sources(name)}", ha="right", va="center", **small)
        axes.text(spec.steps, middle, f"{int(film.sum()):,}", va="center", **small)
        top += _ROWS[name] + _GAP
    begins = {
        "pixels" if spec.window else "pixels, the brightest first": spec.window,
        "the race, the strongest edges first": spec.window + spec.levels,
    }
    for words, begin in (begins | ({"events arrive": 0} if spec.window else {})).items():
        axes.axvline(begin - 0.5, color=THEME["muted"], linewidth=0.8, linestyle=(0, (3, 3)))
        axes.text(begin - 0.3, -10, words, **small)
    axes.text(spec.steps, -10, "spikes", **small)
    axes.set(xlim=(-0.5, spec.steps - 0.5), ylim=(top, 0), xlabel="step", xticks=np.arange(0, spec.steps, 4))
    axes.spines["bottom"].set_visible(True)


def _band(axes: Axes, found: Layers, name: str, top: int) -> None:
    """Draw a population's spikes below ``top``; opacity grows with the share of a row's neurons that spike."""
    film, directions = found.by_direction(name)
    steps, neurons = film.shape
    rows = min(neurons, 2 * _ROWS[name] // directions * directions)
    begins = np.arange(rows) * neurons // rows
    shares = np.add.reduceat(film.astype(np.float64), begins, axis=1) / np.diff(begins, append=neurons)
    strength = np.where(shares > 0, 0.3 + 0.7 * np.sqrt(shares / max(shares.max(), 1e-9)), 0)
    hues = [_PLAIN] if directions == 1 else [_hue(k, found.spec) for k in range(directions)]
    colours = np.array([to_rgb(hues[k * directions // rows]) for k in range(rows)])
    ticks = np.kron(strength.T, (1, 1, 1, 0))  # the last quarter of a step stays empty
    _tinted(axes, ticks, colours[:, None], extent=(-0.5, steps - 0.5, top + _ROWS[name], top))
