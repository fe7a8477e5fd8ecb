"""Image after image of a source to a `Localizer`, and what is said of each as a line of JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from lava_vpr.errors import InputError
from lava_vpr.localizer import Localizer
from lava_vpr.matches import Match
from lava_vpr.readers import Frame


@dataclass(frozen=True)
class Watched:
    """An image and what is said of it.

    Attributes:
        index: Its number in the source, from 0; unreadable ones have one, too.
        seen: The image.
        match: Where it was taken.
    """

    index: int
    seen: Frame
    match: Match

    def values(self) -> dict[str, Any]:
        """The keys and values of its line."""
        return {"query": self.index, "query_name": self.seen.name, **self.match.values()}


def watch(
    localizer: Localizer, source: Iterable[Frame], refused: Callable[[int, InputError], None]
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
