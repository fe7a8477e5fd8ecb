"""Signs of doubtful images, looked for image by image: images that repeat while the robot moves, that differ from
everything on the map, or that are turned, and impossible times.

Matched places play no part: an image of a camera that is stuck, turned or half covered may match a place with full
confidence.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.likeness import DEFICIT, EDGE, Likeness

RUN = 20
"""Number of images in a row with the same cause before it is named."""
DRIVEN_M, APART_M = 1.0, 10.0
"""Metres of the robot's motion, while the image stays the same, beyond which the image is doubtful: by an odometer, and
by positions, whose errors are larger."""
SURE, BETTER, TENTH, LOOK, STANDING = 0.7, 0.02, 0.1, 4, 0.9
"""Thresholds of turned images. Two numbers of a run of images are compared with them: m, by how much better the mean
of the references fits the images as they are than turned back, as a share of the references' own asymmetry; and b, by
how much turning every `LOOK`-th image back raises its best cosine with a reference, on average. The run is turned if m
is at most 0, b at least `BETTER`, and ``b / TENTH - m`` at least `SURE`. An image counts only if its cosine with the
last one that counted is below `STANDING`, since others show the same. `SURE` and `BETTER` were chosen among eight
pairs, looking at the places on which docs/robot.md measures them."""
STUCK, BORDER, BLANK, MIRRORED, UPSIDE_DOWN = "stuck camera", "border", "blank", "mirrored", "upside down"
_TURNED = (MIRRORED, UPSIDE_DOWN, UPSIDE_DOWN)
BACKWARDS, NO_NUMBER, GAP = "backwards", "not a number", "gap"
_GAP, _KNOWN, _USUAL = 10.0, 5, 0.1
"""A gap is longer than `_GAP` usual intervals, once `_KNOWN` are known; a new interval has the weight `_USUAL`."""


class Clock:
    """Checks the times of images, in order."""

    def __init__(self) -> None:
        self._last, self._usual, self._known = -math.inf, 0.0, 0

    def fault(self, stamp: float | None) -> str | None:
        """The fault of the next image's time, in seconds: `BACKWARDS`, `NO_NUMBER` or `GAP`; None: no fault.

        The clock ignores a time that is earlier than one before it.
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
    """Signs that an image is doubtful.

    Attributes:
        repeats: Number of images in a row before it that are identical to it.
        cause: Cause that the last `RUN` images have in common; None: there is none.
        doubtful: Whether it cannot be accepted.
        time_fault: Fault of its time; see `Clock.fault`.
        unlike: Distance from the references; from 1 on it is farther than another season. NaN: unknown.
    """

    repeats: int = 0
    cause: str | None = None
    doubtful: bool = False
    time_fault: str | None = None
    unlike: float = math.nan


class Doubts:
    """Signs of doubt of the images of one traverse, in order.

    Images count as identical if the responses of all inputs are bit-equal: so are those of equal files, and never those
    of two images from a camera, since each has its own noise. Images without any response are no evidence of a stuck
    camera.

    Attributes:
        likeness: Common features of the references, to be set again when the map changes; None: images are not compared
            with the references.

    Args:
        framed: Whether bars at the edges of images are left out (``--crop``): edges without responses are then fine.
    """

    def __init__(self, likeness: Likeness | None = None, *, framed: bool = False) -> None:
        self._framed = framed
        self.likeness, self._edges, self._blank, self._looks = likeness, 0, 0, 0
        self._counted: NDArray[np.float32] | None = None
        self._fits: deque[NDArray[np.float64]] = deque(maxlen=RUN)
        self._better: deque[float] = deque(maxlen=2 * RUN // LOOK)
        self._turned: str | None = None
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
        """Signs of doubt of the next image.

        Args:
            activity: Responses of the inputs to it, float32 (inputs,).
            stamp: When it was taken, in seconds; None: unknown.
            odometry: Metres driven since the image before, either sign; None: unknown.
            point: Where it was taken, in metres (`lava_vpr.positions.frames.Positions.points`); None: unknown.
        """
        fault, stuck = self._clock.fault(stamp), self._stuck(activity, odometry, point)
        if self.likeness is None:
            return Sign(self._repeats, STUCK if stuck and self._repeats >= RUN - 1 else None, stuck, fault)
        unlike, edges = self._compared(self.likeness, activity)
        self._blank = 0 if activity.any() else self._blank + 1
        self._edges = self._edges + 1 if edges >= EDGE and not self._blank else 0
        runs = ((STUCK, self._repeats + 1 if stuck else 0), (BLANK, self._blank), (BORDER, self._edges))
        cause = next((name for name, run in runs if run >= RUN), self._turned)
        return Sign(self._repeats, cause, stuck or unlike >= 1 or cause is not None, fault, unlike)

    def _stuck(self, activity: NDArray[np.float32], odometry: float | None, point: NDArray[np.float64] | None) -> bool:
        """Count an image that repeats the last one; return whether the robot has moved during the repeats."""
        if self._last is None or not np.array_equal(activity, self._last):
            self._last, self._from, self._repeats, self._metres = activity.copy(), point, 0, 0.0
            return False
        self._repeats += 1
        self._metres += abs(odometry or 0.0)
        apart = 0.0 if point is None or self._from is None else math.dist(point, self._from)
        return bool(activity.any()) and (self._metres > DRIVEN_M or apart > APART_M)

    def _compared(self, likeness: Likeness, activity: NDArray[np.float32]) -> tuple[float, float]:
        """Distance of the next image from the references, and what its edges lack; updates the run of turned images."""
        unit = activity / np.float32(max(math.sqrt(activity @ activity), 1e-6))
        fits = np.einsum("ij,j->i", likeness.mean, unit).astype(np.float64)
        edges = likeness.edges(activity)
        if self._framed and edges < 1:
            fits[0], edges = fits[0] / max(likeness.seen(activity), 1e-6), 0.0
        if self._counted is None or float(unit @ self._counted) < STANDING:  # at rest, repeats of one image make no run
            self._counted = unit
            self._turn(likeness, unit, fits[1:])
        deficit = (likeness.typical - fits[0]) / likeness.spread / DEFICIT
        return round(max(0.0, float(deficit), edges / EDGE), 4), edges  # sums differ by machine in their last bits

    def _turn(self, likeness: Likeness, unit: NDArray[np.float32], fits: NDArray[np.float64]) -> None:
        """Compare a run of images with the map, as they are and turned back.

        Args:
            likeness: Common features of the references.
            unit: The last image's responses, of length 1, float32 (inputs,).
            fits: How much better their mean fits it as it is than turned back, float64 (turns,).
        """
        self._fits.append(fits)
        means = np.mean(self._fits, axis=0) / likeness.asymmetry
        way = int(means.argmin())
        if len(self._fits) < RUN // 2 or means[way] > 0:
            self._better.clear()
            self._turned, self._looks = None, 0
            return
        if self._looks % LOOK == 0:
            self._better.append(likeness.better_turned(unit, way))
        self._looks += 1
        better = math.fsum(self._better) / len(self._better)
        sure = self._looks > RUN // 2 and better >= BETTER and better / TENTH - means[way] >= SURE
        self._turned = _TURNED[way] if sure else None


def signs_of(
    doubts: Doubts, activity: NDArray[np.float32], stamps: NDArray[Any] | None, points: NDArray[np.float64] | None
) -> list[Sign]:
    """Signs of doubt of each of the next n images.

    Args:
        doubts: State after the images before; it is updated.
        activity: float32 (n, inputs).
        stamps: When they were taken, in seconds, float64 (n,); None: unknown.
        points: Where they were taken, in metres, float64 (n, 2 or 3); None: unknown.
    """
    return [
        doubts.sign(row, None if stamps is None else float(stamps[k]), None, None if points is None else points[k])
        for k, row in enumerate(activity)
    ]
