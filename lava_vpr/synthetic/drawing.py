"""Draws a synthetic scene's sky, land and track: the camera, and a painter that fills polygons given in metres.

OpenCV's polygon filler draws on a canvas of twice the size, without anti-aliasing, to be averaged afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.synthetic.scene import GROUND, SEGMENT_M, SHOULDER_M, SIGHT_M, SLOPE_M, Colour, Look, RouteShape, Thing

Point = tuple[float, float]

NEAR_M = 5.0
CAMERA_M = 2.7
_STEP_M = 2.0
_SHIFT = 3  # OpenCV's fixed-point coordinates: eighths of a pixel
_STOPS = (SIGHT_M, 110.0, 80.0, 60.0, 45.0, 34.0, 26.0, 20.0, 15.5, 12.0, 9.5, 7.2, NEAR_M)


def blend(a: Colour, b: Colour, share: float) -> Colour:
    """``a`` with ``share`` (0..1) of it replaced by ``b``."""
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)


def scaled(a: Colour, gain: float) -> Colour:
    """``a`` brighter (``gain`` > 1) or darker."""
    return (a[0] * gain, a[1] * gain, a[2] * gain)


@dataclass(frozen=True)
class Camera:
    """A camera on the vehicle: position along the route and to its right in metres, yaw and pitch in radians."""

    s: float
    right: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0


class Painter:
    """A canvas seen through a camera under a look; polygons are filled in the order of the calls.

    Attributes:
        canvas: Image to draw on, uint8 (rows, columns, 3), BGR.
        focal: Focal length in pixels; the lens looks 64 degrees wide.
        centre, horizon: Pixel column of straight ahead and pixel row of the horizon.
    """

    def __init__(self, canvas: NDArray[np.uint8], camera: Camera, look: Look, way: RouteShape) -> None:
        self.canvas, self.camera, self.look, self.way = canvas, camera, look, way
        self.rows, self.columns = canvas.shape[:2]
        self.focal = 0.8 * self.columns
        self.centre = 0.5 * self.columns - camera.yaw * self.focal
        self.horizon = 0.47 * self.rows + camera.pitch * self.focal
        table = way.offsets(camera.s, np.arange(0.0, SIGHT_M + 4 * SEGMENT_M, _STEP_M))
        self._right, self._above = table[0].tolist(), table[1].tolist()
        self._depths: dict[float, tuple[float, float, float, float, float]] = {}

    def _depth(self, s: float) -> tuple[float, float, float, float, float]:
        """Pixels per metre, column and row of the track, share of haze and gain of the headlamps at ``s``."""
        depth = self._depths.get(s)
        if depth is None:
            z = max(s - self.camera.s, NEAR_M)
            k = int(z / _STEP_M)
            share = z / _STEP_M - k
            right = self._right[k] + (self._right[k + 1] - self._right[k]) * share - self.camera.right
            above = self._above[k] + (self._above[k + 1] - self._above[k]) * share - CAMERA_M
            m, look = self.focal / z, self.look
            lamp = 1.0 + look.lamp * math.exp(-z / 22.0)
            depth = (m, self.centre + m * right, self.horizon - m * above, 1.0 - math.exp(-z / look.haze_m), lamp)
            self._depths[s] = depth
        return depth

    def at(self, s: float, x: float, y: float) -> Point:
        """Pixel of the point ``x`` metres right of the track at ``s`` and ``y`` above it."""
        m, column, row, _, _ = self._depth(s)
        return column + m * x, row - m * y

    def scale(self, s: float) -> float:
        """Pixels of one metre at ``s``."""
        return self._depth(s)[0]

    def paint(self, colour: Colour, s: float, gain: float = 1.0) -> Colour:
        """``colour`` as it looks from here at ``s``, in this light and air."""
        light, air = self.look.light, self.look.haze
        _, _, _, haze, lamp = self._depth(s)
        gain *= lamp
        b, g, r = colour[0] * light[0] * gain, colour[1] * light[1] * gain, colour[2] * light[2] * gain
        return (b + (air[0] - b) * haze, g + (air[1] - g) * haze, r + (air[2] - r) * haze)

    def fill(self, points: Sequence[Point], colour: Colour) -> None:
        """Fill the polygon of pixels ``points``."""
        fixed = np.array([(int(8 * x), int(8 * y)) for x, y in points], dtype=np.int32)
        cv2.fillPoly(self.canvas, [fixed], colour, shift=_SHIFT)

    def face(self, s: float, x0: float, x1: float, y0: float, y1: float, colour: Colour) -> None:
        """Fill an upright rectangle across the track at ``s``, x0 < x1 and y0 < y1 in metres."""
        m, column, row, _, _ = self._depth(s)
        left, right, low, high = column + m * x0, column + m * x1, row - m * y0, row - m * y1
        if right >= 0 and left < self.columns:
            corners = (int(8 * left), int(8 * high)), (int(8 * right), int(8 * low))
            cv2.rectangle(self.canvas, *corners, colour, -1, cv2.LINE_8, _SHIFT)

    def line(self, a: Point, b: Point, colour: Colour, width: float) -> None:
        """Draw a line ``width`` pixels wide, as a polygon so that thin ones do not jump."""
        dx, dy = b[0] - a[0], b[1] - a[1]
        length = 2.0 * math.hypot(dx, dy) or 1.0
        nx, ny = -dy / length * width, dx / length * width
        self.fill(
            ((a[0] + nx, a[1] + ny), (b[0] + nx, b[1] + ny), (b[0] - nx, b[1] - ny), (a[0] - nx, a[1] - ny)), colour
        )

    def blob(self, x: float, y: float, rx: float, ry: float, colour: Colour) -> None:
        """Fill the ellipse of radii ``rx`` and ``ry`` around pixel (x, y)."""
        if rx < 0.3 or ry < 0.3 or x + rx < 0 or x - rx >= self.columns:
            return
        centre, axes = (round(8 * x), round(8 * y)), (round(8 * rx), round(8 * ry))
        cv2.ellipse(self.canvas, centre, axes, 0, 0, 360, colour, -1, cv2.LINE_8, _SHIFT)


def draw_backdrop(p: Painter, clouds: Sequence[tuple[float, float, float]]) -> None:
    """Draw sky, clouds (column, row, size as shares of the sky), mountains, hills, a distant wood and the plain."""
    look = p.look
    t = np.clip(np.arange(p.rows) / max(1.0, p.horizon), 0, 1)[:, None, None]
    p.canvas[:] = (np.asarray(look.sky[0]) * (1 - t) + np.asarray(look.sky[1]) * t).astype(np.uint8)
    for u, v, size in clouds:
        x, y, r = u * p.columns, v * p.horizon, size * p.columns
        for k, (dx, dy, share) in enumerate(((-0.8, 0.1, 0.55), (0.0, 0.0, 1.0), (0.8, 0.12, 0.6))):
            p.blob(x + dx * r, y + dy * r, r * share, 0.34 * r * share, scaled(look.clouds, 0.97 + 0.015 * k))
    below = p.rows + 9.0
    bearing = p.way.heading(p.camera.s) + p.camera.yaw
    # Mean height and swing of a ridge in 128ths of the canvas, and the metres in which it passes by.
    for layer, (base, swing, reach) in enumerate(((17.0, 9.0, 9e3), (9.0, 6.0, 1.6e3), (5.0, 2.4, 420.0))):
        columns = np.arange(0.0, p.columns + 4, 4)
        turn = 100 * (bearing + np.arctan((columns - p.centre) / p.focal)) + p.camera.s / reach * 100
        height = np.zeros_like(turn)
        for a, w, q in p.way.ridges[layer].terms:
            height += a * np.sin(w * turn + q)
        top = p.horizon - np.maximum(0.5, base + swing * height) * (p.rows / 128.0)
        outline = [(-9.0, below), *zip(columns.tolist(), top.tolist(), strict=True), (p.columns + 9.0, below)]
        p.fill(outline, look.ridges[layer])
    plain = [(-9.0, p.horizon), (p.columns + 9.0, p.horizon), (p.columns + 9.0, below), (-9.0, below)]
    p.fill(plain, p.paint(look.crops[0], p.camera.s + SIGHT_M))


def draw_ground(p: Painter, t: Thing) -> None:
    """Draw one segment of one side: the slope beside the track, and the field or water beyond it."""
    look = p.look
    near, far = max(t.s, p.camera.s + NEAR_M), t.s + SEGMENT_M
    if far <= near:
        return
    high = t.width
    low = t.y + (high - t.y) * (near - t.s) / SEGMENT_M
    edge, foot, rim = t.x * SLOPE_M, t.x * SHOULDER_M, t.x * 140.0
    a, b = p.at(far, edge, high), p.at(near, edge, low)
    if low < CAMERA_M:  # otherwise the slope hides what lies beyond
        ground = look.water if t.kind == "lake" else look.crops[min(2, int(3 * t.tint))]
        p.fill((a, p.at(far, rim, high), p.at(near, rim, low), b), p.paint(ground, far))
    steep = min(1.0, max(0.0, t.height - 1.2) / 1.5)
    slope = p.paint(blend(look.bank, look.steep, steep), far, 0.95 + 0.1 * t.shape[0])
    p.fill((p.at(far, foot, 0.0), a, b, p.at(near, foot, 0.0)), slope)
    if near - p.camera.s < 60:  # a tussock
        s, share = near + (far - near) * t.shape[1], t.shape[2]
        x, y = p.at(s, foot + (edge - foot) * share, low * share)
        p.blob(x, y, 0.9 * p.scale(s), 0.22 * p.scale(s), scaled(slope, 0.82))


def draw_way(p: Painter) -> None:
    """Draw the way: verge, ballast with sleepers and rails, or a road with its lines."""
    look, s0 = p.look, p.camera.s
    stops = [s0 + z for z in _STOPS]

    def strip(left: float, right: float, colour: Colour) -> None:
        """Draw a strip of the ground from sight to the bonnet, as one polygon."""
        outline = [p.at(s, left, 0.0) for s in stops] + [p.at(s, right, 0.0) for s in reversed(stops)]
        p.fill(outline, p.paint(colour, s0 + 14))

    strip(-SHOULDER_M, SHOULDER_M, look.verge)
    if p.way.railway:
        strip(-1.75, 1.75, look.way)
        for s in np.arange(math.ceil((s0 + NEAR_M) / 1.3) * 1.3, s0 + 20, 1.3).tolist():
            colour = p.paint(blend(look.way, look.wood, 0.6), s)
            p.line(p.at(s, -1.25, 0.0), p.at(s, 1.25, 0.0), colour, 0.25 * p.scale(s) ** 0.8)
        strip(-0.80, -0.68, look.rail)
        strip(0.68, 0.80, look.rail)
        return
    strip(-2.9, 2.9, look.way)
    strip(-2.75, -2.6, look.mark)
    strip(2.6, 2.75, look.mark)
    for s in np.arange(math.ceil((s0 + NEAR_M) / 9) * 9, s0 + 70, 9).tolist():
        p.fill(
            (p.at(s + 3, -0.09, 0), p.at(s + 3, 0.09, 0), p.at(s, 0.09, 0), p.at(s, -0.09, 0)), p.paint(look.mark, s)
        )


def draw_land(p: Painter, things: Sequence[Thing]) -> None:
    """Draw the ground among ``things``, the farthest first, and the track upon it."""
    for t in things:
        if t.kind in GROUND:
            draw_ground(p, t)
    draw_way(p)
