"""What speaks against the images of a traverse, one after the other: images that repeat while the robot moves, and
times that cannot be.

Nothing here looks at the places that images match: an image of a camera that is stuck may match one with full
confidence.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

RUN = 20
"""Images in a row that agree on a cause before it is named."""
DRIVEN_M, APART_M = 1.0, 10.0
"""Metres that the robot moves while the image stays the same, beyond which none is accepted: by its odometer; and by
positions, which err by more."""
STUCK = "stuck camera"
BACKWARDS, NO_NUMBER, GAP = "backwards", "not a number", "gap"
_GAP, _KNOWN, _USUAL = 10.0, 5, 0.1
"""A gap is so many usual intervals long, once so many are known; and how fast the usual one follows."""


class Clock:
    """Looks at the times of images, in order."""

    def __init__(self) -> None:
        self._last, self._usual, self._known = -math.inf, 0.0, 0

    def fault(self, stamp: float | None) -> str | None:
        """What is wrong with the time of the next image in seconds, `BACKWARDS`, `NO_NUMBER` or `GAP`; None: nothing.

        One that is earlier than an image before it counts for nothing.
        """
        if stamp is None:
            return None
        if not math.isfinite(stamp):
            return NO_NUMBER
        interval = stamp - self._last
        if interval < 0:
            return BACKWARDS
        self._last = stamp
        if not 0 < interval < math.inf:
            return None
        usual = self._usual if self._known else interval
        gap = self._known >= _KNOWN and interval > _GAP * usual
        self._usual, self._known = usual + _USUAL * (min(interval, 2.0 * usual) - usual), self._known + 1
        return GAP if gap else None


class Sign(NamedTuple):
    """What speaks against an image.

    Attributes:
        repeats: How many images in a row before it show the very same.
        cause: What `RUN` images agree on; None: nothing.
        doubtful: It cannot be accepted.
        time_fault: See `Clock`.
    """

    repeats: int = 0
    cause: str | None = None
    doubtful: bool = False
    time_fault: str | None = None


class Doubts:
    """What speaks against the images of one traverse, in order.

    Images show the very same if the responses of all inputs are equal, bit for bit: equal images always do, and two
    that a camera took never, since each has noise of its own. Images without any response say nothing of the camera.
    """

    def __init__(self) -> None:
        self._clock, self._repeats, self._metres = Clock(), 0, 0.0
        self._last: NDArray[np.float32] | None = None
        self._from: NDArray[np.float64] | None = None

    def sign(
        self,
        activity: NDArray[np.float32],
        stamp: float | None = None,
        odometry: float | None = None,
        point: NDArray[np.float64] | None = None,
    ) -> Sign:
        """What speaks against the next image.

        Args:
            activity: Responses of its inputs, float32 (inputs,).
            stamp: When it was taken, in seconds; None: unknown.
            odometry: Metres driven since the image before, either sign; None: unknown.
            point: Where it was taken, in metres (`lava_vpr.positions.frames.Positions.points`); None: unknown.
        """
        fault = self._clock.fault(stamp)
        if self._last is None or not np.array_equal(activity, self._last):
            self._last, self._from, self._repeats, self._metres = activity.copy(), point, 0, 0.0
            return Sign(time_fault=fault)
        self._repeats += 1
        self._metres += abs(odometry or 0.0)
        apart = 0.0 if point is None or self._from is None else math.dist(point, self._from)
        moved = bool(activity.any()) and (self._metres > DRIVEN_M or apart > APART_M)
        return Sign(self._repeats, STUCK if moved and self._repeats >= RUN - 1 else None, moved, fault)


def signs_of(
    doubts: Doubts, activity: NDArray[np.float32], stamps: NDArray[Any] | None, points: NDArray[np.float64] | None
) -> list[Sign]:
    """What speaks against each of the next n images.

    Args:
        doubts: Of the images before, and afterwards of these.
        activity: float32 (n, inputs).
        stamps: When they were taken, in seconds, float64 (n,); None: unknown.
        points: Where they were taken, in metres, float64 (n, 2 or 3); None: unknown.
    """
    return [
        doubts.sign(row, None if stamps is None else float(stamps[k]), None, None if points is None else points[k])
        for k, row in enumerate(activity)
    ]
