"""Samples: images of a source before they are read, and their selection by time, distance or change."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError

_SLACK_S = 1e-3  # messages come a little early or late, and containers round times to milliseconds

T = TypeVar("T")


class Sample(NamedTuple):
    """An image of a source that is read on demand.

    Attributes:
        number: Number of the image in its source, from 0.
        stamp: When it was taken, in seconds (`lava_vpr.positions.frames`); None if unknown.
        read: Reads the image, uint8 (h, w) or (h, w, 3) BGR, or the vector, float32 (values,), or raises an
            `InputError`. Call it before taking the next sample.
        since: Seconds since the first image of the source, for `every_so_often`.
        name: Its name; None: that of its number.
    """

    number: int
    stamp: float | None
    read: Callable[[], NDArray[Any]]
    since: float = 0.0
    name: str | None = None


def kept(items: Iterable[T], apart: Callable[[T, T], bool]) -> Iterator[T]:
    """The first item, and each that is ``apart(before, item)`` from the one kept before it."""
    before: T | None = None
    for item in items:
        if before is None or apart(before, item):
            yield item
            before = item


def every_so_often(samples: Iterable[Sample], every: float) -> Iterator[Sample]:
    """The first sample at or after each multiple of ``every`` seconds, each once."""

    def due(before: Sample, sample: Sample) -> bool:
        return sample.since >= (int((before.since + _SLACK_S) // every) + 1) * every - _SLACK_S

    return kept(samples, due)


def spaced(points: NDArray[np.float64], spacing: float) -> NDArray[np.int64]:
    """The first image, and each that is at least ``spacing`` from the one kept before it, int64 (kept,).

    Args:
        points: Where images were taken, metres, float64 (n, coordinates).
        spacing: Straight-line distance in metres; path length would grow with a receiver's noise while the robot stands
            still.
    """

    def away(before: int, i: int) -> bool:
        return bool(np.sqrt(((points[i] - points[before]) ** 2).sum()) >= spacing)

    return np.array(list(kept(range(len(points)), away)), np.int64)


def changed(activities: Iterable[NDArray[np.float32]], threshold: float) -> NDArray[np.int64]:
    """The first image, and each whose input changed by ``threshold`` or more since the one kept before, int64 (kept,).

    The change is 1 - cos of the angle between the two activities: 0 for the same proportions, 1 if no input responds to
    both images. It is 1 between a blank image and any other, and 0 between two blank ones.

    Args:
        activities: Activity of each image in turn, float32 (inputs,), at least 0; only this and the last kept one are
            in memory.
        threshold: From 0, which keeps every image, to 1.
    """
    units = enumerate(map(_unit, activities))
    found = kept(units, lambda before, now: _change(before[1], now[1]) >= threshold)
    return np.array([i for i, _ in found], np.int64)


def _unit(activity: NDArray[np.float32]) -> NDArray[np.float64]:
    """An activity scaled to length 1; zeros for a blank image."""
    length = float(np.linalg.norm(activity.astype(np.float64)))
    return activity / length if length else np.zeros(activity.shape)


def _change(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> float:
    """1 - cos of two activities of length 1, or 0 for a blank image."""
    if not (ours.any() or theirs.any()):
        return 0.0
    return max(0.0, 1.0 - float(ours @ theirs))


def chosen(walk: Callable[[], Iterable[Sample]], numbers: NDArray[np.int64], what: str) -> Iterator[NDArray[Any]]:
    """The images with the given numbers, in one pass over the source if they increase; each step back starts a new
    pass.

    Args:
        walk: The source's samples from the first on, in increasing numbers.
        numbers: Numbers of the images, int64 (n,).
        what: The source and what one of its images is called, for messages.
    Raises:
        InputError: an image cannot be read, or no longer exists.
    """
    k = 0
    while k < len(numbers):
        for sample in walk():
            if sample.number != numbers[k]:
                continue
            yield sample.read()
            k += 1
            if k == len(numbers) or numbers[k] <= sample.number:
                break
        else:
            raise InputError(f"{what} {numbers[k]} any more; was the file changed?")
