"""A synthetic world"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.synthetic_drawing import Camera, Painter, draw_backdrop, draw_land
from lava_vpr.synthetic_looks import LOOKS
from lava_vpr.synthetic_scene import OCCLUDER, SKY, VIEW, WEATHER, ahead, generator, route
from lava_vpr.synthetic_things import draw_occluder, draw_things

CONDITIONS: tuple[str, ...] = tuple(LOOKS)


@dataclass(frozen=True)
class World:
    seed: int = 0
    places: int = 100
    width: int = 128
    height: int = 64
    spacing_m: float = 20.0


def _camera(world: World, place: int, number: int, jitter: float) -> Camera:
    rng = generator(world.seed, VIEW, place, number)
    forward, right, yaw, pitch = (jitter * rng.uniform(-1, 1, 4)).tolist()
    return Camera(
        s=place * world.spacing_m + 0.35 * forward, right=0.06 * right, yaw=0.008 * yaw, pitch=0.004 * pitch
    )


def _weather(image: NDArray[np.uint8], condition: str, rng: np.random.Generator) -> NDArray[np.uint8]:
    h, w = image.shape[:2]
    out = image
    if condition == "winter":
        flakes = int(rng.integers(4, 24))
        for x, y, r in zip(rng.integers(0, 8 * w, flakes), rng.integers(0, 8 * h, flakes), rng.integers(3, 7, flakes)):
            cv2.circle(out, (int(x), int(y)), int(r), (252, 250, 248), -1, cv2.LINE_8, 3)
    if condition == "rain":
        streaks = out.copy()
        for x, y, n in zip(rng.integers(0, w, 60), rng.integers(-5, h, 60), rng.integers(4, 10, 60)):
            cv2.line(streaks, (int(x), int(y)), (int(x) - int(n) // 4, int(y) + int(n)), (210, 206, 202), 1)
        out = cv2.addWeighted(out, 0.65, streaks, 0.35, 0)
    a = GRAIN[condition]
    noise = rng.integers(-a, a + 1, (h, w, 1), dtype=np.int16) + rng.integers(-a, a + 1, (h, w, 3), dtype=np.int16)
    return np.clip(out.astype(np.int16) + noise, 0, 255).astype(np.uint8)


JITTER = 1.0
GRAIN = {"summer": 3, "winter": 4, "rain": 4, "night": 6}

def render(world: World, place: int, condition: str) -> NDArray[np.uint8]:
    number = CONDITIONS.index(condition)
    look = LOOKS[condition]
    way = route(world.seed)
    canvas = np.empty((2 * world.height, 2 * world.width, 3), np.uint8)
    p = Painter(canvas, _camera(world, place, number, JITTER), look, way)
    rng = generator(world.seed, SKY, place // 4, number)
    clouds = [(rng.uniform(-0.1, 1.1), rng.uniform(0.0, 0.7), rng.uniform(0.04, 0.14)) for _ in range(look.cloudiness)]
    draw_backdrop(p, clouds)
    things = ahead(world.seed, p.camera.s)
    draw_land(p, things)
    draw_things(p, things)
    rng = generator(world.seed, OCCLUDER, place, number)
    if rng.uniform(0, 1) < (0.03 if condition == "summer" else 0.08):
        draw_occluder(p, rng)
    small = cv2.resize(canvas, (world.width, world.height), interpolation=cv2.INTER_AREA)
    return _weather(small, condition, generator(world.seed, WEATHER, place, number))
