"""Windows of an event camera: how a stream of events becomes images, which are then encoded as any other image.

An event says that the light on a pixel has changed by some ratio. Which way is left out: what is dark against its
surroundings in one season is bright in another, and driving back turns every sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.patches import grey_levels
from lava_vpr.settings.ranges import Range, check

EventImage = Literal["counts", "surface"]


@dataclass(frozen=True)
class EventsConfig:
    """How events become images. Images of frame cameras, and folders of event frames, need none of this.

    Attributes:
        window_ms: Milliseconds of events that an image shows.
        window_events: Number of events that an image shows, whatever time they take; 0: those of ``window_ms``.
        image: ``counts``: how many events each pixel has had in the window; ``surface``: how recent its last one is,
            falling by e in half of the window's time.
        side: Pixels of the longer side of an image, at most; larger sensors are averaged down to it.
        refractory_us: Events of a pixel so soon after its last one are noise and left out, microseconds.
        hot_pixels: A pixel with so many times the events that its surroundings and the whole sensor have is hot, and
            left out; 0: none is.
    """

    window_ms: Annotated[float, Range(0.1, 3_600_000)] = 400.0
    window_events: Annotated[int, Range(0, 1_000_000_000)] = 0
    image: EventImage = "counts"
    side: Annotated[int, Range(8, 512)] = 128
    refractory_us: Annotated[int, Range(0, 10_000_000)] = 1000
    hot_pixels: Annotated[float, Range(0, 1_000_000)] = 8.0

    def __post_init__(self) -> None:
        check(self, "events")


def saturated(image: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """An image of events whose brightest pixels are no brighter than others, uint8 (h, w).

    A few pixels have most of a window's events: those on an edge that flickers, or near the camera. They would decide
    alone.

    Args:
        image: Numbers of events, or how recent they are, uint8 (h, w) or (h, w, 3) BGR.
        share: The least level that so many of the pixels above 0 do not exceed becomes white, and so does all above.
    """
    grey = grey_levels(image)
    counts = np.bincount(grey.reshape(-1), minlength=256)[1:].cumsum()
    top = 1 + int(np.searchsorted(counts, share * counts[-1]))
    return (np.minimum(grey, top).astype(np.uint16) * 255 // top).astype(np.uint8)
