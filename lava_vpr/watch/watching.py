"""Image after image of a source to a `Localizer`, and what is said of each as a line of JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from lava_vpr.errors import InputError
from lava_vpr.localizer import Localizer, Match
from lava_vpr.positions.frames import LAT_LON, columns
from lava_vpr.watch.sources import Seen


@dataclass(frozen=True)
class Watched:
    """An image and what is said of it.

    Attributes:
        index: Its number in the source, from 0; unreadable ones have one, too.
        seen: The image.
        match: Where it was taken.
    """

    index: int
    seen: Seen
    match: Match

    def values(self) -> dict[str, Any]:
        """The keys and values of its line; what is not known is None, but for the two coordinates, which are not there
        where the map has none."""
        match = self.match
        there = match.place >= 0
        said: dict[str, Any] = {
            "query": self.index,
            "query_name": self.seen.name,
            "time": None if self.seen.stamp is None else _rounded(self.seen.stamp, 6),
            "place": match.place,
            "place_name": match.name if there else None,
            "confidence": _rounded(match.confidence) if there else None,
            "accepted": match.accepted,
            "probability": _rounded(match.probability, 6) if there else None,
        }
        if match.frame is not None:
            digits = 7 if match.frame == LAT_LON else 2
            coordinates = (None, None) if match.position is None else match.position
            for name, value in zip(columns(match.frame), coordinates, strict=True):
                said[name] = None if value is None else round(value, digits)
        said["radius"], said["off_map"] = match.radius, _rounded(match.off_map, 6)
        said["candidates"] = [
            {
                "place": candidate.place,
                "place_name": candidate.name,
                "score": candidate.score,
                "probability": _rounded(candidate.probability, 6),
            }
            for candidate in (match.candidates if there else ())
        ]
        return said


def _rounded(value: float, digits: int | None = None) -> float | None:
    """``value``, to so many digits; None where it is not finite."""
    if not math.isfinite(value):
        return None
    return value if digits is None else round(value, digits)


def watch(
    localizer: Localizer, source: Iterable[Seen], refused: Callable[[int, InputError], None]
) -> Iterator[Watched]:
    """Take the images of ``source`` as they come.

    Args:
        localizer: Asked where each was taken.
        source: The images.
        refused: Told the number of each that cannot be read or answered, and why; watching goes on.
    Raises:
        LavaVprError: the source goes away.
    """
    for index, seen in enumerate(source):
        if isinstance(seen.image, InputError):
            refused(index, seen.image)
            continue
        try:
            match = localizer.update(seen.image, seen.stamp)
        except InputError as error:
            refused(index, error)
            continue
        yield Watched(index, seen, match)
