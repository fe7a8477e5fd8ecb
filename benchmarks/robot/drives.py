"""Drives made of the query images of a map: by repeating, leaving out, reversing, blurring and drawing noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import ALL_CORES, FOLDERS, PlacesSection, images_of
from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.encoding import encode_arrays
from lava_vpr.matching.decoders import margin
from lava_vpr.model import Model, prepare
from lava_vpr.traverse import open_traverse

SPEEDS = {
    "half the speed": 0.5,
    "the same speed": 1.0,
    "1.2 times": 1.2,
    "1.5 times": 1.5,
    "twice": 2.0,
    "3 times": 3.0,
    "4 times": 4.0,
    "6 times": 6.0,
    "8 times": 8.0,
}
EVERY, STOP = 50, 30
"""A stop of so many frames after so many places."""
BEFORE, AFTER = 25, 10
"""Frames before a robot is kidnapped, and after."""
REST, RESTING = 96, 20
"""Places at which a robot is switched on, and frames that it stands there."""
NOISE, SIZE = 6.0, (640, 320)
"""Grey levels of a camera's noise (standard deviation), drawn on images of this size."""
DULL, BLURRED_RIGHT = 0.15, 0.1
"""Share of a route that is dull, and of its blurred images that are right alone: less than this."""

Frames = NDArray[np.int64]
Image = NDArray[np.uint8]


def at_speed(speed: float, places: int) -> Frames:
    """The place of every frame at so many times the references' speed."""
    return np.minimum((np.arange(int(places / speed)) * speed).astype(np.int64), places - 1)


def with_stops(places: int) -> Frames:
    """The place of every frame of a drive at the references' speed that stands still in between."""
    return np.concatenate([np.full(1 + STOP * (place % EVERY == EVERY // 2), place) for place in range(places)])


def queries_of(section: PlacesSection, which: int = 1) -> list[Image]:
    """The query images (1) of a section, or its references (0), in order."""
    source = open_traverse(images_of(section.dataset, FOLDERS[section.dataset][which]))
    return [source.load(k) for k in range(section.first, section.end)]


def large(section: PlacesSection, which: int = 1) -> list[Image]:
    """`queries_of` a section at `SIZE`."""
    return [cv2.resize(image, SIZE, interpolation=cv2.INTER_CUBIC) for image in queries_of(section, which)]


def shown_of(model: Model, images: Iterator[Image]) -> Presentations:
    """Presentations to a model of images that are no files."""
    parts = []
    while some := list(islice(images, 64)):
        seen = encode_arrays(some, model.config.encoder, standard=model.standard)
        parts.append(query_presentations(model, seen[0]))
    return Presentations.joined(parts)


def scored(model: Model, shown: Presentations) -> NDArray[np.float64]:
    """What a network makes of presentations: scores (n, places)."""
    return prepare(model)(HostBackend(ALL_CORES).count_spikes(model, shown)[0])


def noisy(images: Sequence[Image], frames: Frames, seed: int) -> Iterator[Image]:
    """The frames of a drive as a camera sees ``images`` of the places, each with noise of its own."""
    rng = np.random.default_rng(seed)
    for place in frames.tolist():
        large = cv2.resize(images[place], SIZE, interpolation=cv2.INTER_CUBIC).astype(np.float32)
        yield np.clip(np.rint(large + rng.normal(0.0, NOISE, large.shape)), 0, 255).astype(np.uint8)


class Dull(NamedTuple):
    """The stretch of a map whose references are least distinguishable, and its queries, blurred."""

    first: int
    shown: Presentations


def dull(model: Model, queries: Sequence[Image]) -> Dull:
    """The dull stretch of a map, blurred by the least Gaussian (quarters of a pixel) with which too few are right."""
    length = max(5, int(DULL * model.places))
    margins = margin(prepare(model)(np.ascontiguousarray(model.responses.T)))
    first = int(np.convolve(margins, np.ones(length), "valid").argmin())
    images = queries[first : first + length]
    for quarters in range(1, 400):
        shown = shown_of(model, (cv2.GaussianBlur(image, (0, 0), quarters / 4) for image in images))
        if (scored(model, shown).argmax(axis=1) == first + np.arange(length)).mean() < BLURRED_RIGHT:
            break
    return Dull(first, shown)


def kidnappings(places: int, number: int, seed: int) -> list[Frames]:
    """Drives that go on elsewhere, at least a twentieth of the map away, or half of what a short map allows."""
    rng, made = np.random.default_rng(seed), []
    least = min(places // 20 + BEFORE, (places - BEFORE - AFTER) // 2)
    while len(made) < number:
        here, there = rng.integers(0, places - BEFORE - AFTER, 2).tolist()
        if abs(here - there) >= least:
            made.append(np.concatenate([np.arange(here, here + BEFORE), np.arange(there, there + AFTER)]))
    return made


def painted(image: Image, above: float, below: float = 0.0) -> Image:
    """Shares of an image's height, above and below, painted black."""
    drawn, height = image.copy(), len(image)
    drawn[: round(above * height)] = 0
    drawn[height - round(below * height) :] = 0
    return drawn


def squeezed(image: Image, above: float, below: float = 0.0) -> Image:
    """The same shares black, and the image squeezed between them."""
    drawn, height = np.zeros_like(image), len(image)
    first, end = round(above * height), height - round(below * height)
    drawn[first:end] = cv2.resize(image, (image.shape[1], end - first), interpolation=cv2.INTER_AREA)
    return drawn
