"""Cameras that show something else than the places do: bars, turned images, a stuck or black stretch; and places that
stand in the map twice.

Each drive is a `Localizer`'s; where the camera is stuck, an odometer says that the robot moves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmarks.places import ALL_CORES, PlacesSection, places
from benchmarks.robot.drives import DULL, Image, large, painted, squeezed
from lava_vpr import Localizer
from lava_vpr.framing import AUTO, NO_CROP
from lava_vpr.model import IntegerModel, Model
from lava_vpr.positions.frames import XY
from lava_vpr.training.loop import train

APART_M = 5.0
Disturbed = Callable[[Image], Image]
BARS: dict[str, Disturbed] = {
    "bars of 12 %, painted": lambda image: painted(image, 0.12, 0.12),
    "bars of 20 %, painted": lambda image: painted(image, 0.2, 0.2),
    "bars of 12 %, squeezed": lambda image: squeezed(image, 0.12, 0.12),
    "bars of 20 %, squeezed": lambda image: squeezed(image, 0.2, 0.2),
    "a strip of 20 % at the top": lambda image: painted(image, 0.2),
}
"""Bars above and below, each by default and with ``--crop auto``."""
TURNED: dict[str, Disturbed] = {
    "mirrored": lambda image: np.ascontiguousarray(image[:, ::-1]),
    "upside down": lambda image: np.ascontiguousarray(image[::-1, ::-1]),
}


class CameraShares(NamedTuple):
    """Shares of a drive's images: exact, within 3 places, accepted, and of those within a place; and what is named."""

    exact: float
    near: float
    accepted: float
    right: float
    named: Counter[str]


def seen(
    model: Model,
    images: Sequence[Image],
    crop: str = NO_CROP,
    part: slice = slice(None),
    metres: float | None = None,
) -> CameraShares:
    """How the images of all places in order, or a ``part`` of them, are answered; of a place that is twice in the map
    either will do. ``metres`` are what an odometer says between two."""
    robot = Localizer(model, crop=crop)
    found = [robot.update(image, odometry=metres if k else None) for k, image in enumerate(images)][part]
    where, n = np.array([match.place for match in found]), len(images)
    apart = np.abs(np.where(where < n, where, where - n) - np.arange(n)[part])
    sure = np.array([match.accepted for match in found])
    right = float((apart <= 1)[sure].mean()) if sure.any() else float("nan")
    named = Counter({match.cause for match in found if match.cause is not None})
    return CameraShares(float((apart == 0).mean()), float((apart <= 3).mean()), float(sure.mean()), right, named)


def located(model: Model) -> Model:
    """A map whose places are `APART_M` metres apart."""
    metres = APART_M * np.arange(model.places, dtype=np.float64)
    return replace(model, positions=np.stack([metres, np.zeros(model.places)], axis=1), frame=XY)


def twice(model: IntegerModel, section: PlacesSection) -> Model:
    """The map with the first tenth of its places learned once more, at its end."""
    n = section.end - section.first
    order = np.append(np.arange(n), np.arange(n // 10))
    views = places(section, 0, model.config)
    again = [replace(view.take(order), indices=np.arange(len(order), dtype=np.int64)) for view in views]
    return train(again, model.config, pool=ALL_CORES)


def every_camera(model: IntegerModel, section: PlacesSection) -> Iterator[tuple[str, CameraShares]]:
    """All of it by name."""
    images = large(section)
    n = len(images)
    yield "none", seen(model, images)
    yield "none, `--crop auto`", seen(model, images, AUTO)
    for name, of in BARS.items():
        drawn = [of(image) for image in images]
        yield name, seen(model, drawn)
        yield f"{name}, `--crop auto`", seen(model, drawn, AUTO)
    for name, of in TURNED.items():
        yield name, seen(model, [of(image) for image in images])
    first = n // 2
    end = first + int(DULL * n)
    for name, image, where, metres in (
        ("stuck", images[first], located(model), APART_M),
        ("black", np.zeros_like(images[0]), model, None),
    ):
        drawn = [*images[:first], *[image] * (end - first), *images[end:]]
        yield f"a stretch {name}", seen(where, drawn, part=slice(first, end), metres=metres)
        yield f"a stretch {name}: what follows", seen(where, drawn, part=slice(end, None), metres=metres)
    yield "a tenth of the places twice in the map", seen(twice(model, section), images)
