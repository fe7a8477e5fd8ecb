"""A picture of a deployment: the board's chips with what each core holds, as SVG.

Equal plans give equal bytes; text is drawn as paths, so that it looks the same everywhere.
"""

from __future__ import annotations

import io
import re
import textwrap
from dataclasses import dataclass
from functools import cache
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import FancyBboxPatch, PathPatch, Rectangle
from matplotlib.textpath import TextPath

from lava_vpr.deploy.boards.plan import CorePlan, Plan, PopulationPart
from lava_vpr.deploy.show.tables import microseconds, summary
from lava_vpr.show.svg import canvas, outline, themed

COLOURS = {"exc": "#0067a8", "counters": "#7a5ea8", "inh": "#c24a00", "inputs": "#00805c"}
"""Colours of the populations, as the report's curves have them."""

_NAMES = {
    "exc": "excitatory neurons",
    "counters": "their counters",
    "inh": "inhibitory neurons",
    "inputs": "inputs that integrate a bias",
}
_RELAYS = "relays of inputs"
_INK, _MUTED, _LINE, _PALE, _PAPER = "#1a2127", "#55616b", "#d5dbe0", "#edf1f4", "#ffffff"

WIDTH, MARGIN, GAP = 1200, 32, 10
_CARD_COLUMNS = 4
MOST_CARDS = 8
"""Cores that are drawn large; of more, the busiest."""

_LIMITS = 4
"""Limits of a core that a card shows where all are public."""

NEARLY = 0.9
"""Share of a limit above which a core's bar is drawn dark."""

_STYLE = {
    "svg.fonttype": "path",
    "svg.hashsalt": "lava-vpr",
    "path.simplify": False,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "text.parse_math": False,
    "text.color": _INK,
}

Box = tuple[float, float, float, float]
"""Left, top, width and height."""


@dataclass(frozen=True)
class _Mesh:
    """Where a chip's cores are drawn: cells of ``cell`` pixels from ``left``, ``top``, in tiles if they are known."""

    left: float
    top: float
    cell: float
    tile_cores: int | None
    rows: int
    columns: int

    def box(self, core: int) -> Box:
        """The cell in which ``core`` is drawn."""
        if self.tile_cores is None:
            row, column = divmod(core, self.columns)
            return self.left + column * (self.cell + 4), self.top + row * (self.cell + 4), self.cell, self.cell
        tile, inside = divmod(core, self.tile_cores)
        left, top, _, _ = self.tile(tile)
        row, column = divmod(inside, 2)
        return left + 3 + column * (self.cell + 2), top + 3 + row * (self.cell + 2), self.cell, self.cell

    def tile(self, tile: int) -> Box:
        """The outline of ``tile``; tiles are numbered down the columns."""
        column, row = divmod(tile, self.rows)
        side = 2 * self.cell + 8
        return self.left + column * (side + 4), self.top + row * (side + 4), side, side

    @property
    def height(self) -> float:
        """Height of the whole mesh."""
        return self.rows * (self.cell + 4 if self.tile_cores is None else 2 * self.cell + 12) - 4


@themed(_STYLE)
def draw(plan: Plan) -> bytes:
    """``plan`` as an SVG file, 1200 pixels wide."""
    text = io.StringIO()
    figure_of(plan).savefig(text, format="svg", metadata={"Date": None}, facecolor=_PAPER)  # no date, no program's name
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", text.getvalue(), flags=re.DOTALL)
    lines = re.sub(r'(width|height)="([\d.]+)pt"', r'\1="\2"', svg, count=2).splitlines()  # points become pixels
    return ("\n".join(line.rstrip() for line in lines) + "\n").encode()


def figure_of(plan: Plan) -> Figure:
    """The drawing, in units of pixels."""
    words = textwrap.wrap(" ".join(summary(plan)), 180)
    cards = _cards(plan)
    head = 76 + 18 * len(words)
    meshes = _meshes(plan, head + 64)
    below = head + 64 + meshes[0].height + 30
    wide, high = (WIDTH - 2 * MARGIN - (_CARD_COLUMNS - 1) * GAP) / _CARD_COLUMNS, _card_height(plan, cards)
    height = below + 26 + -(-len(cards) // _CARD_COLUMNS) * (high + GAP) + MARGIN - GAP
    figure = canvas(WIDTH, height)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, WIDTH), ylim=(height, 0))
    axes.axis("off")
    _heading(axes, plan, words)
    _legend(axes, plan, head + 10)
    for chip, mesh in enumerate(meshes):
        _chip(axes, plan, chip, mesh)
    some = "" if len(cards) == len(plan.cores) else f"the {len(cards)} busiest of {len(plan.cores)} "
    _text(axes, MARGIN, below, f"{some}cores in use", 12.5, weight="bold")
    for number, core in enumerate(cards):
        row, column = divmod(number, _CARD_COLUMNS)
        _card(axes, plan, core, (MARGIN + column * (wide + GAP), below + 26 + row * (high + GAP), wide, high))
    return figure


@cache
def _width(text: str, size: float) -> float:
    """Width of ``text`` in pixels."""
    return float(TextPath((0, 0), text, size=size, prop=FontProperties(family="DejaVu Sans")).get_extents().width)


def _text(axes: Axes, x: float, y: float, text: str, size: float = 11, **style: Any) -> None:
    """Write ``text`` with its middle line at ``y``."""
    axes.text(x, y, text, fontsize=size, va="center_baseline", **{"ha": "left", **style})


def _rectangle(axes: Axes, box: Box, colour: str, **style: Any) -> None:
    """Draw ``box`` as a filled rectangle."""
    left, top, width, height = box
    # Not add_patch, which works out the data's limits again each time: they are fixed.
    axes.add_artist(Rectangle((left, top), width, height, **{"facecolor": colour, "linewidth": 0, **style}))


def _meshes(plan: Plan, top: float) -> list[_Mesh]:
    """The chips of the board, side by side."""
    board = plan.board
    grid = board.mesh
    if grid is None:
        columns = 30
        return [_Mesh(MARGIN, top, (WIDTH - 2 * MARGIN + 4) / columns - 4, None, -(-board.cores // columns), columns)]
    width = (WIDTH - 2 * MARGIN - (board.chips - 1) * 2 * GAP) / board.chips
    cell = ((width + 4) / grid.columns - 12) / 2
    lefts = [MARGIN + chip * (width + 2 * GAP) for chip in range(board.chips)]
    return [_Mesh(left, top, cell, grid.tile_cores, grid.rows, grid.columns) for left in lefts]


def _heading(axes: Axes, plan: Plan, words: list[str]) -> None:
    """Draw the title and the summary of the plan."""
    network = plan.network
    way = "with a bias" if network.bias_input else "with injected spikes"
    _text(axes, MARGIN, 36, plan.board.title, 20, weight="bold")
    title = f"{network.neurons:,} neurons, {network.inputs:,} inputs {way}"
    _text(axes, WIDTH - MARGIN, 37, title, 13, color=_MUTED, ha="right")
    for number, line in enumerate(words):
        _text(axes, MARGIN, 68 + 18 * number, line, 11.5, color=_MUTED)


def _legend(axes: Axes, plan: Plan, y: float) -> None:
    """Draw the legend, which says what the colours mean."""
    present = {part.population for core in plan.cores for part in core.parts if part.size}
    x = float(MARGIN)

    def word(text: str, mark: float) -> None:
        """``text`` beside a mark that is ``mark`` wide; the next one goes to its right."""
        nonlocal x
        _text(axes, x + mark + 6, y, text, 11)
        x += mark + 6 + _width(text, 11) + 24

    for population in (name for name in COLOURS if name in present):
        _rectangle(axes, (x, y - 6, 12, 12), COLOURS[population])
        word(_RELAYS if population == "inputs" and plan.network.relayed else _NAMES[population], 12)
    if plan.board.memory.public:
        _memory(axes, (x, y - 7, 5, 14), 0.6)
        word("synapse memory in use", 5)
    _rectangle(axes, (x, y - 6, 12, 12), _PALE)
    word("unused core", 12)
    if plan.board.mesh is not None:
        _rectangle(axes, (x, y - 7, 14, 14), "none", edgecolor=_LINE, linewidth=0.9)
        word(f"tile of {plan.board.mesh.tile_cores} cores", 14)


def _memory(axes: Axes, box: Box, used: float) -> None:
    """An upright bar that is filled from below to the share ``used``."""
    left, top, width, height = box
    _rectangle(axes, box, _PAPER, edgecolor=_INK, linewidth=0.5)
    full = height * min(1.0, used)
    _rectangle(axes, (left, top + height - full, width, full), _INK)


def _chip(axes: Axes, plan: Plan, chip: int, mesh: _Mesh) -> None:
    """Draw one chip: its tiles, unused cores pale, the others with what they hold."""
    board = plan.board
    used = {core.core: core for core in plan.cores if core.chip == chip}
    name = f"chip {chip}" if board.chips > 1 else "the chip"
    note = f": {len(used)} of {board.cores} cores"
    if mesh.tile_cores is None:
        note += "; Intel's compiler decides which"
    _text(axes, mesh.left, mesh.top - 16, name + note, 12.5, weight="bold")
    if mesh.tile_cores is not None:
        tiles = [mesh.tile(tile) for tile in range(mesh.rows * mesh.columns)]
        axes.add_artist(PathPatch(outline(tiles), facecolor="none", edgecolor=_LINE, linewidth=0.9))
    idle = [mesh.box(core) for core in range(board.cores) if core not in used]
    if idle:
        axes.add_artist(PathPatch(outline(idle), facecolor=_PALE, linewidth=0))
    for number, core in used.items():
        _core(axes, plan, core, mesh.box(number))


def _core(axes: Axes, plan: Plan, core: CorePlan, box: Box) -> None:
    """Draw a core in use: a band as high as each population's share, its number, its synapse memory on the right."""
    left, top, width, height = box
    words = plan.board.memory.words
    bar = 6.0 if words is not None else 0.0
    total = sum(part.size for part in core.parts)
    y, label, tallest = top, top, 0.0
    for part in core.parts:
        band = height * part.size / total
        gid = f"{part.population}-{core.chip}-{core.core}"
        _rectangle(axes, (left, y, width - bar, band), COLOURS[part.population], gid=gid)
        if band > tallest:  # the core's number stands in the highest band
            label, tallest = y + band / 2, band
        y += band
    if words is not None:
        _memory(axes, (left + width - bar + 1.0, top, bar - 1.0, height), (core.needs.synapse_words or 0) / words)
    _text(axes, left + (width - bar) / 2, label, f"{core.core}", 8.5, ha="center", color=_PAPER)


def _cards(plan: Plan) -> list[CorePlan]:
    """The cores that are drawn large: all if they are few, else the busiest, in the order of the chip."""
    if len(plan.cores) <= MOST_CARDS:
        return list(plan.cores)
    busy = sorted(plan.cores, key=lambda core: -(core.microseconds or core.load.busy))[:_CARD_COLUMNS]
    return [core for core in plan.cores if core in busy]


def _limits(plan: Plan, core: CorePlan) -> list[tuple[str, int, int]]:
    """What a core takes of the limits that are public."""
    board, needs = plan.board, core.needs
    every = (
        ("compartments", needs.compartments, board.compartments),
        ("axons in", needs.axons_in, board.axons_in),
        ("axons out", needs.axons_out, board.axons_out),
        ("synapse words", needs.synapse_words, board.memory.words),
    )
    return [(what, used, limit) for what, used, limit in every if used is not None and limit is not None]


def _card_height(plan: Plan, cards: list[CorePlan]) -> float:
    """The height of a card that has room for the content of the fullest card."""
    parts = max(len([part for part in core.parts if part.size]) for core in cards)
    limits = len(_limits(plan, cards[0]))
    lines = limits if limits == _LIMITS else limits + 1  # a line says that others are not public
    return 32 + 17 * parts + 14 + 19 * lines + 8


def _card(axes: Axes, plan: Plan, core: CorePlan, box: Box) -> None:
    """A core in large: its neurons, and what it takes of its limits."""
    left, y, width, height = box
    style = "round,pad=0,rounding_size=5"
    axes.add_artist(
        FancyBboxPatch((left, y), width, height, boxstyle=style, facecolor="none", edgecolor=_LINE, linewidth=1)
    )
    name = f"chip {core.chip}, core {core.core}" if plan.board.chips > 1 else f"core {core.core}"
    time = "" if core.microseconds is None else f"{microseconds(core.microseconds)} a step"
    _text(axes, left + 12, y + 18, name, 12, weight="bold")
    _text(axes, left + width - 12, y + 18, time, 10.5, ha="right", color=_MUTED)
    for line, part in enumerate(part for part in core.parts if part.size):
        _part(axes, part, left + 12, y + 40 + 17 * line)
    limits = _limits(plan, core)
    bottom = y + height - 18
    if len(limits) < _LIMITS:
        _text(axes, left + 12, bottom, "other limits are not public", 10, color=_MUTED)
        bottom -= 19
    for line, (what, used, limit) in enumerate(reversed(limits)):
        _bar(axes, what, used, limit, (left + 12, bottom - 19 * line, width - 24, 9))


def _part(axes: Axes, part: PopulationPart, x: float, y: float) -> None:
    """A population's neurons on a core."""
    last = part.first + part.size - 1
    _rectangle(axes, (x, y - 5, 10, 10), COLOURS[part.population])
    _text(
        axes, x + 17, y, f"{part.population} {part.first} to {last}" if part.size > 1 else f"{part.population} {last}"
    )


def _bar(axes: Axes, what: str, used: int, limit: int, box: Box) -> None:
    """Draw how much of a limit is in use; a bar of nearly all of it stands out."""
    left, y, width, height = box
    bar = (left + 92, y - height / 2, 64.0, height)
    full = min(1.0, used / limit)
    _text(axes, left, y, what, 10, color=_MUTED)
    _rectangle(axes, bar, _PALE)
    _rectangle(axes, (bar[0], bar[1], bar[2] * full, height), _INK if full > NEARLY else _MUTED)
    _text(axes, left + width, y, f"{used:,} / {limit:,}", 9.5, ha="right", weight="bold" if full > NEARLY else "normal")
