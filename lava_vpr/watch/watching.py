"""Image after image of a source to a `Localizer`, what is said of each as a line of JSON, and the last answers for the
live page, as text and pictures that are made when somebody looks.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.inputs.encoder import THUMBNAIL
from lava_vpr.inputs.vectors import picture_of
from lava_vpr.localizer import Localizer
from lava_vpr.matches import Match
from lava_vpr.model import Model
from lava_vpr.readers import Frame
from lava_vpr.report.images import data_uri, shrunk


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


HISTORY = 120
"""Number of answers that the page shows."""
_ROWS = 360
"""Rows of the spike raster, at most: of more neurons the most spikes of each few are shown."""
_COLOUR = (201, 143, 43)  # BGR, to be told from white and from black
_QUERY_SIDE = 480
_NOTHING = "data:,"


class Recent:
    """The last answers; one thread adds them, others look.

    Args:
        model: The model that answers.
    Attributes:
        said: The status, and how many images were answered, recognised and refused.
    """

    def __init__(self, model: Model) -> None:
        self._thumbnails = model.thumbnails
        self._numbers = {int(index): number for number, index in enumerate(model.place_indices)}
        of_place = model.neuron_places()
        self._neurons = np.argsort(np.where(of_place < 0, model.places, of_place), kind="stable")
        self._together = -(-model.neurons // _ROWS)
        self._lock = threading.Lock()
        self._history: deque[dict[str, Any]] = deque(maxlen=HISTORY)
        self._spikes: deque[NDArray[np.uint16]] = deque(maxlen=HISTORY)
        self._last: Watched | None = None
        self.said: dict[str, Any] = {"status": "waiting", "answered": 0, "recognised": 0, "refused": 0}
        self._version, self._made = 0, (-1, b"")

    def add(self, watched: Watched) -> None:
        """Take the next answer."""
        match = watched.match
        counts = np.minimum(match.spikes[self._neurons], 65535).astype(np.uint16)
        pooled = np.maximum.reduceat(counts, np.arange(0, len(counts), self._together))
        values = watched.values()
        entry = {"at": self._number(match.place), **{key: values[key] for key in ("probability", "accepted")}}
        with self._lock:
            self._last = watched
            self._history.append(entry)
            self._spikes.append(pooled)
            self.said["answered"] += 1
            self.said["recognised"] += int(match.accepted)
            self._say(status="watching")

    def refuse(self) -> None:
        """Take note of an image that cannot be read."""
        with self._lock:
            self._say(refused=self.said["refused"] + 1)

    def end(self) -> None:
        """Take note that no further image comes."""
        with self._lock:
            self._say(status="the source has ended")

    def state(self, seen: int) -> bytes:
        """All that the page shows, as JSON; only its version, if that is the one which was ``seen``."""
        with self._lock:
            version, last, said = self._version, self._last, dict(self.said)
            history, spikes = list(self._history), list(self._spikes)
            if seen == version:
                return json.dumps({"version": version}).encode()
            if self._made[0] == version:
                return self._made[1]
        text = json.dumps({"version": version, **said, **self._drawn(last, history, spikes)}).encode()
        with self._lock:
            self._made = (version, text)
        return text

    def _say(self, **changed: Any) -> None:
        self.said.update(changed)
        self._version += 1

    def _number(self, place: int) -> int:
        """The number of the place with this absolute index among the model's; -1: none."""
        return self._numbers.get(place, -1)

    def _drawn(
        self, last: Watched | None, history: list[dict[str, Any]], spikes: list[NDArray[np.uint16]]
    ) -> dict[str, Any]:
        """The last answer and its pictures."""
        if last is None or isinstance(last.seen.image, Exception):
            return {}
        values = last.values()
        at = self._number(last.match.place)
        return {
            **values,
            "at": at,
            "where": ", ".join(f"{name} {values[name]}" for name in ("x", "y", "lat", "lon") if name in values),
            "candidates": [found | {"at": self._number(found["place"])} for found in values["candidates"]],
            "query_image": data_uri(_pictured(last.seen.image)),
            "match_image": data_uri(self._thumbnails[at]) if at >= 0 else _NOTHING,
            "raster": data_uri(raster(spikes), lossless=True),
            "history": history,
        }


def _pictured(seen: NDArray[Any]) -> NDArray[np.uint8]:
    """An image, or a vector, as the page shows it."""
    return picture_of(seen, THUMBNAIL) if seen.ndim == 1 else shrunk(seen, _QUERY_SIDE)


def raster(spikes: list[NDArray[np.uint16]]) -> NDArray[np.uint8]:
    """Spike counts as a picture, uint8 (rows, `HISTORY`, 4) BGRA: a column a query, the last one on the right; the more
    spikes, the less one sees through.

    Args:
        spikes: The counts of each query, oldest first, uint16 (rows,), at least one and at most `HISTORY`.
    """
    counts = np.zeros((len(spikes[0]), HISTORY), np.float64)
    counts[:, HISTORY - len(spikes) :] = np.stack(spikes, axis=1)
    picture = np.empty((*counts.shape, 4), np.uint8)
    picture[:, :, :3] = _COLOUR
    picture[:, :, 3] = np.round(255 * np.sqrt(counts / max(1.0, counts.max())))
    return np.asarray(cv2.resize(picture, None, fx=2, fy=1, interpolation=cv2.INTER_NEAREST), np.uint8)
