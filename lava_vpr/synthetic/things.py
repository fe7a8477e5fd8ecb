"""Draws the objects along a synthetic route, and those that hide part of the view."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from lava_vpr.synthetic.drawing import NEAR_M, Painter, blend, scaled
from lava_vpr.synthetic.scene import (
    GROUND,
    MAST_SPACING_M,
    ROOFS,
    SEGMENT_M,
    SHOULDER_M,
    SIGHT_M,
    SNOW,
    WALLS,
    Colour,
    Thing,
)

_DARK: Colour = (60, 58, 56)
_FROSTED: tuple[Colour, Colour] = ((214, 208, 202), (240, 236, 232))
_NEAR_THING_M = 8.0  # what is nearer would fill the view
_FROST = 0.8  # how much snow plants carry: the more, the more of them turn from dark to bright


def _shadow(p: Painter, t: Thing, x: float, y: float) -> None:
    """Draw the shadow at the foot of a tree, away from the sun."""
    if p.look.sun:
        width = 0.5 * t.width * p.scale(t.s)
        p.blob(x - p.look.sun * width, y, 1.5 * width, 0.16 * width + 0.5, p.paint(scaled(p.look.crops[0], 0.72), t.s))


def _foliage(p: Painter, t: Thing, shades: tuple[Colour, Colour]) -> tuple[Colour, Colour]:
    """Dark and bright colour of a plant, by now under snow or hoar frost; some plants carry more than others."""
    laden = p.look.snow * min(1.0, _FROST * t.tint)
    dark, bright = blend(shades[0], _FROSTED[0], laden), blend(shades[1], _FROSTED[1], laden)
    gain = 0.9 + 0.2 * t.shape[6]
    return p.paint(dark, t.s, gain), p.paint(bright, t.s, gain)


def _conifer(p: Painter, t: Thing) -> None:
    """Draw a conifer: three tiers of branches, one side brighter."""
    look = p.look
    x, y = p.at(t.s, t.x, t.y)
    m = p.scale(t.s)
    h, w = t.height * m, t.width * m / 2
    dark, bright = _foliage(p, t, look.needles)
    side = look.sun or (1 if t.shape[7] > 0.5 else -1)
    _shadow(p, t, x, y)
    p.line((x, y), (x, y - 0.2 * h), p.paint(look.bark, t.s), max(1.0, 0.3 * m))
    tip = (x, y - h)
    if h < 10:
        p.fill(((x - w, y - 0.1 * h), tip, (x + w, y - 0.1 * h)), dark)
        return
    # Half outlines from the foot to the tip: width and height of each tier's edge and of the notch above it.
    tiers = ((1.0, 0.10), (0.52, 0.36), (0.76, 0.36), (0.34, 0.62), (0.50, 0.62))
    left = [(x - w * a * (0.85 + 0.3 * t.shape[k // 2]), y - b * h) for k, (a, b) in enumerate(tiers)]
    right = [(x + w * a * (0.85 + 0.3 * t.shape[k // 2 + 3]), y - b * h) for k, (a, b) in enumerate(tiers)]
    p.fill([*left, tip, *reversed(right)], dark)
    p.fill([(x + 0.1 * w * side, y - 0.1 * h), *(right if side > 0 else left), tip], bright)


def _broadleaf(p: Painter, t: Thing) -> None:
    """Draw a broadleaved tree: trunk and crown of clumps; in winter a crown of frosted twigs, its branches showing."""
    look = p.look
    x, y = p.at(t.s, t.x, t.y)
    h, w = t.height * p.scale(t.s), t.width * p.scale(t.s) / 2
    bark = p.paint(look.bark, t.s, 0.8 + 0.5 * t.shape[8])
    dark, bright = _foliage(p, t, look.leaves)
    _shadow(p, t, x, y)
    p.line((x, y), (x, y - 0.55 * h), bark, max(1.0, 0.05 * h))
    if h < 10:
        p.blob(x, y - 0.64 * h, w, 0.36 * h, dark)
        return
    for k in range(5):
        angle = 1.2566 * k + t.shape[k]
        p.blob(x + 0.5 * w * math.cos(angle), y - 0.62 * h - 0.2 * h * math.sin(angle), 0.56 * w, 0.2 * h, dark)
    if h < 16:
        return
    if look.bare:
        twig = blend(bark, dark, 0.4)
        for k in range(5):
            turn = (k / 4 - 0.5) * 1.8 + 0.3 * (t.shape[k] - 0.5)
            tip = (x + 0.85 * w * math.sin(turn), y - (0.36 + 0.48 * math.cos(turn)) * h)
            p.line((x, y - (0.28 + 0.03 * k) * h), tip, twig, max(0.9, 0.02 * h))
        return
    for k in range(3):
        across = (0.3 * look.sun + 0.9 * (t.shape[5 + k] - 0.5)) * w
        p.blob(x + across, y - (0.6 + 0.11 * k) * h, 0.34 * w, 0.1 * h, bright)


def _bush(p: Painter, t: Thing) -> None:
    x, y = p.at(t.s, t.x, t.y)
    w, h = t.width * p.scale(t.s) / 2, t.height * p.scale(t.s)
    shades = _foliage(p, t, p.look.leaves)
    for k in range(3):
        p.blob(x + (k - 1) * 0.5 * w, y - 0.45 * h, 0.6 * w, (0.4 + 0.25 * t.shape[k]) * h, shades[k % 2])


def _rock(p: Painter, t: Thing) -> None:
    x, y = p.at(t.s, t.x, t.y)
    w, h = t.width * p.scale(t.s) / 2, t.height * p.scale(t.s)
    radii = [0.8 + 0.4 * t.shape[k] for k in range(7)]
    outline = [(x + w * r * math.cos(0.5236 * k), y - h * r * math.sin(0.5236 * k)) for k, r in enumerate(radii)]
    p.fill(outline, p.paint(p.look.rock, t.s, 0.8 + 0.4 * t.tint))
    if p.look.snow:
        p.blob(x, y - 0.85 * h, 0.62 * w, 0.2 * h, p.paint(SNOW, t.s, 0.97))


def _windows(p: Painter, t: Thing) -> None:
    """Draw one or two rows of windows, some of them lit when it is dark."""
    look, rows = p.look, 1 if t.height < 4.2 else 2
    columns, size = (2 if t.width < 8 else 3), min(0.55, 0.25 * t.height / rows)
    for r in range(rows):
        for c in range(columns):
            x, y = t.x + t.width * ((c + 0.75) / (columns + 0.5) - 0.5), t.y + 0.85 * t.height * (0.35 + r) / rows
            colour = look.windows if look.lit and t.shape[(r + c) % 3] > 0.35 else p.paint(_DARK, t.s)
            p.face(t.s, x - size, x + size, y, y + 2 * size, colour)


def _tower(p: Painter, t: Thing, wall: Colour, roof: Colour) -> None:
    """Draw a church's tower with its spire."""
    top = t.y + 1.9 * t.height
    p.face(t.s, t.x - 1.7, t.x + 1.7, t.y, top, scaled(wall, 0.95))
    spire = (p.at(t.s, t.x - 2.0, top), p.at(t.s, t.x, top + 8.0), p.at(t.s, t.x + 2.0, top))
    p.fill(spire, blend(roof, p.paint(ROOFS[0], t.s), 0.6))
    p.face(t.s, t.x - 0.5, t.x + 0.5, top - 2.8, top - 1.0, p.paint(_DARK, t.s))


def _building(p: Painter, t: Thing) -> None:
    """Draw a building: a box under a gable roof whose ridge runs along the track or across it."""
    look, s = p.look, t.s
    deep = s + 7.0 + 5.0 * t.shape[3]
    walls = {"barn": WALLS[0], "church": WALLS[1], "silo": WALLS[3]}.get(t.kind, WALLS[int(t.tint * len(WALLS))])
    left, right, top = t.x - t.width / 2, t.x + t.width / 2, t.y + t.height
    inner = right if t.x < 0 else left
    peak = top + (t.width * (0.28 + 0.2 * t.shape[4]) if t.kind != "silo" else 0.8)
    # The wall along the track lies in the sun or in the shade, unlike the one that faces the camera.
    sunny = look.sun == (1 if t.x < 0 else -1)
    front = p.paint(walls, s, 0.92 if look.sun else 0.8)
    aside = p.paint(walls, s, 1.08 if sunny else 0.6 if look.sun else 1.0)
    roof = p.paint(blend(ROOFS[int(3 * t.shape[5])], SNOW, 0.96 * look.snow), s)
    p.fill((p.at(s, inner, t.y), p.at(s, inner, top), p.at(deep, inner, top), p.at(deep, inner, t.y)), aside)
    if t.shape[0] < 0.5 or t.kind in ("church", "barn"):
        ridge = p.at(s, t.x, peak)
        p.fill((p.at(s, inner, top), ridge, p.at(deep, t.x, peak), p.at(deep, inner, top)), roof)
        gable = (p.at(s, left, t.y), p.at(s, left, top), ridge, p.at(s, right, top), p.at(s, right, t.y))
        p.fill(gable, front)
        eaves = p.paint(blend(ROOFS[0], SNOW, 0.9 * look.snow), s)
        for edge in (left - 0.3, right + 0.3):
            p.line(p.at(s, edge, top - 0.2), ridge, eaves, max(1.0, 0.35 * p.scale(s)))
    else:
        middle = (s + deep) / 2
        p.face(s, left, right, t.y, top, front)
        p.fill((p.at(s, inner, top), p.at(middle, inner, peak), p.at(deep, inner, top)), aside)
        low = p.at(s, left - 0.3, top), p.at(s, right + 0.3, top)
        p.fill((low[0], p.at(middle, left - 0.3, peak), p.at(middle, right + 0.3, peak), low[1]), roof)
    if t.kind == "church":
        _tower(p, t, front, roof)
    elif t.kind == "house":
        _windows(p, t)
    elif t.kind == "barn":
        p.face(s, t.x - 1.4, t.x + 1.4, t.y, t.y + 2.8, p.paint((60, 70, 84), s))


def _fence(p: Painter, t: Thing) -> None:
    """Draw a fence: two rails on posts, one segment long."""
    start, end = max(t.s, p.camera.s + NEAR_M), t.s + SEGMENT_M
    if end <= start or start - p.camera.s > 80:
        return
    wood = p.paint(p.look.wood, start, 0.8 + 0.5 * t.tint)
    low = t.y + (t.width - t.y) * (start - t.s) / SEGMENT_M
    for height in (0.55, 1.1):
        a, b = (start, low + height), (end, t.width + height)
        corners = (a, (a[0], a[1] + 0.15), (b[0], b[1] + 0.15), b)
        p.fill([p.at(s, t.x, y) for s, y in corners], wood)
    for k in range(4):
        s = t.s + 2.5 * k
        if s >= start and s - p.camera.s < 40:
            foot = t.y + (t.width - t.y) * k / 4
            p.face(s, t.x - 0.1, t.x + 0.1, foot, foot + 1.35, wood)


def _mast(p: Painter, t: Thing) -> None:
    """Draw a catenary mast or telegraph pole with its wire to the next one."""
    railway = p.way.railway
    colour, m = p.paint(p.look.wood, t.s, 0.75), p.scale(t.s)
    half = max(0.13, 0.5 / m)
    p.face(t.s, t.x - half, t.x + half, -0.5, t.height, colour)
    arm = -p.way.mast_side * (SHOULDER_M if railway else 0.9)
    start = t.x if railway else t.x - arm
    level = t.height - 0.6
    half = max(0.08, 0.4 / m)
    p.face(t.s, min(start, t.x + arm), max(start, t.x + arm), level - half, level + half, colour)
    following = t.s + MAST_SPACING_M
    if following < p.camera.s + SIGHT_M:
        x, sag = t.x + arm, t.s + MAST_SPACING_M / 2
        points = (p.at(t.s, x, level), p.at(sag, x, level - 0.5), p.at(following, x, level))
        for a, b in itertools.pairwise(points):
            p.line(a, b, colour, max(0.7, 0.05 * m))


def _sign(p: Painter, t: Thing) -> None:
    m = p.scale(t.s)
    half = max(0.06, 0.45 / m)
    p.face(t.s, t.x - half, t.x + half, 0.0, t.height, p.paint((110, 110, 110), t.s))
    x, y = p.at(t.s, t.x, t.height - 0.45)
    face: Colour = (60, 190, 230) if t.tint < 0.4 else (60, 60, 200) if t.tint < 0.7 else (190, 110, 50)
    p.blob(x, y, 0.5 * m, 0.5 * m, p.paint(face, t.s))
    p.blob(x, y, 0.3 * m, 0.3 * m, p.paint((235, 235, 235), t.s))


def _bridge(p: Painter, t: Thing) -> None:
    """Draw a bridge across the track on two piers."""
    s, deck, reach = t.s, t.height, 60.0
    stone = p.paint((132, 138, 142) if t.tint < 0.5 else (84, 98, 120), s)
    for x in (-SHOULDER_M - 1.2, SHOULDER_M + 1.2):
        p.face(s, x - 0.8, x + 0.8, -1.0, deck, stone)
    under = (p.at(s, -reach, deck), p.at(s, reach, deck), p.at(s + 7, reach, deck), p.at(s + 7, -reach, deck))
    p.fill(under, scaled(stone, 0.45))
    p.face(s, -reach, reach, deck, deck + 1.3, scaled(stone, 0.9))
    p.face(s, -reach, reach, deck + 1.3, deck + 1.6, p.paint(blend(p.look.wood, SNOW, p.look.snow), s))


_DRAW: dict[str, Callable[[Painter, Thing], None]] = {
    "conifer": _conifer,
    "broadleaf": _broadleaf,
    "bush": _bush,
    "rock": _rock,
    "house": _building,
    "barn": _building,
    "church": _building,
    "silo": _building,
    "fence": _fence,
    "mast": _mast,
    "sign": _sign,
    "bridge": _bridge,
}


def _out_of_view(p: Painter, t: Thing) -> bool:
    """Whether a thing beside the track lies wholly left or right of the canvas."""
    x = p.at(t.s, t.x, 0.0)[0]
    reach = (t.width + 2.0) * p.scale(t.s)
    # A building's wall and a wire reach back towards the middle.
    far = t.s + (14.0 if t.width > 3 else 0.0)
    back = p.at(far, t.x, 0.0)[0]
    return max(x, back) + reach < 0 or min(x, back) - reach > p.columns


def draw_things(p: Painter, things: Sequence[Thing]) -> None:
    """Draw all ``things`` but the ground, in their order, which is the farthest first."""
    for t in things:
        if t.kind in GROUND or (t.kind != "fence" and t.s <= p.camera.s + _NEAR_THING_M):
            continue
        if t.kind in ("fence", "mast", "bridge") or not _out_of_view(p, t):
            _DRAW[t.kind](p, t)


def draw_occluder(p: Painter, rng: np.random.Generator) -> None:
    """Draw something that was there on this day only: traffic on the other lane or track, or a branch near the lens."""
    s = p.camera.s + rng.uniform(9, 17)
    tint = rng.uniform(0, 1)
    body = WALLS[int(tint * len(WALLS))]
    if rng.uniform(0, 1) < 0.3:
        side = 1 if tint < 0.5 else -1
        x = (0.5 + 0.47 * side) * p.columns
        for k in range(6):
            colour = p.paint(p.look.leaves[k % 2], s, 0.7)
            p.blob(x, rng.uniform(0.35, 1.0) * p.rows, 0.06 * p.columns, rng.uniform(0.05, 0.16) * p.rows, colour)
        return
    if p.way.railway:
        x, half, top, deep = -4.2, 1.5, 3.9, s + 60.0
    elif tint < 0.3:
        x, half, top, deep = -1.5, 1.2, 3.3, s + 8.0
    else:
        x, half, top, deep = -1.5, 0.9, 1.55, s + 4.0
    front, side_wall = p.paint(body, s, 0.9), p.paint(body, s, 0.65)
    edge = x + half
    p.fill((p.at(s, edge, 0.3), p.at(s, edge, top), p.at(deep, edge, top), p.at(deep, edge, 0.3)), side_wall)
    p.face(s, x - half, x + half, 0.3, top, front)
    p.face(s, x - 0.85 * half, x + 0.85 * half, 0.58 * top, 0.9 * top, p.paint(_DARK, s))
    lamp: Colour = (225, 250, 255) if p.look.lit else p.paint((215, 225, 230), s)
    for dx in (-0.7, 0.7):
        p.face(s, x + dx * half - 0.16, x + dx * half + 0.16, 0.6, 0.9, lamp)
        p.face(s, x + dx * half - 0.18, x + dx * half + 0.18, 0.0, 0.35, p.paint((30, 30, 30), s))
