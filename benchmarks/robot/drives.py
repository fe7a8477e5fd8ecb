"""Drives made of a traverse's own images: other speeds, stops, backwards, carried off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SPEEDS = {"half the speed": 0.5, "the same speed": 1.0, "1.2 times": 1.2, "1.5 times": 1.5, "twice": 2.0}
EVERY, STOP = 50, 30
"""A stop of so many frames after so many places."""
BEFORE, AFTER = 25, 10
"""Frames before a robot is carried off, and after."""

REVERSED = "reversed"

Frames = NDArray[np.int64]


def at_speed(speed: float, places: int) -> Frames:
    """The place of every frame at so many times the references' speed."""
    return np.minimum((np.arange(int(places / speed)) * speed).astype(np.int64), places - 1)


def with_stops(places: int) -> Frames:
    """The place of every frame of a drive at the references' speed that stands still in between."""
    return np.concatenate([np.full(1 + STOP * (place % EVERY == EVERY // 2), place) for place in range(places)])


def every_drive(places: int) -> dict[str, Frames]:
    """All drives by name."""
    made = {name: at_speed(speed, places) for name, speed in SPEEDS.items()}
    stops = f"{STOP} frames at rest, every {EVERY} places"
    return made | {stops: with_stops(places), REVERSED: np.arange(places)[::-1]}


def kidnappings(places: int, number: int, seed: int) -> list[Frames]:
    """Drives that go on elsewhere, at least a twentieth of the map away, or half of what a short map allows."""
    rng, made = np.random.default_rng(seed), []
    least = min(places // 20 + BEFORE, (places - BEFORE - AFTER) // 2)
    while len(made) < number:
        here, there = rng.integers(0, places - BEFORE - AFTER, 2).tolist()
        if abs(here - there) >= least:
            made.append(np.concatenate([np.arange(here, here + BEFORE), np.arange(there, there + AFTER)]))
    return made
