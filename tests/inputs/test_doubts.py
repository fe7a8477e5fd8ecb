"""What speaks against images, one after the other: the same image while the robot moves, times that cannot be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lava_vpr.inputs.doubts import BACKWARDS, GAP, NO_NUMBER, RUN, STUCK, UPSIDE_DOWN, Clock, Doubts, Sign, signs_of
from lava_vpr.inputs.likeness import Likeness
from lava_vpr.positions.frames import Positions

SEEN = np.arange(6, dtype=np.float32)
NAN = float("nan")


@pytest.mark.parametrize(
    ("stamps", "faults"),
    [
        ([None, 5.0, None, 6.0], {}),
        ([5.0, 4.0, NAN, -1.0, 5.0, 6.0], {1: BACKWARDS, 2: NO_NUMBER, 3: BACKWARDS}),
        ([5.0, 9.0, 6.0, 8.0, 9.0, 10.0], {2: BACKWARDS, 3: BACKWARDS}),  # a late image does not set the clock back
        ([0, 1, 2, 3, 4, 5, 14, 15], {}),
        ([0, 1, 2, 3, 4, 5, 16, 17], {6: GAP}),
        ([0, 1, 2, 3, 4, 16, 17], {}),  # what is usual is not known yet
        ([0, 1, 1, 1, 1, 1, 16], {}),
        ([*range(10), *range(20, 400, 12)], {10: GAP, 11: GAP}),  # slower for good: the usual interval follows
    ],
)
def test_times_that_cannot_be_are_named(stamps: list[float | None], faults: dict[int, str]) -> None:
    clock = Clock()
    said = [clock.fault(stamp) for stamp in stamps]
    assert {number: fault for number, fault in enumerate(said) if fault is not None} == faults


def test_the_same_images_are_counted_until_another_comes() -> None:
    doubts, seen = Doubts(), SEEN.copy()
    counts = [doubts.sign(seen).repeats for _ in range(3)]
    seen[2] = np.nextafter(seen[2], np.float32(9))  # in place, by the last bit
    assert [*counts, *(doubts.sign(seen).repeats for _ in range(2))] == [0, 1, 2, 0, 1]


@pytest.mark.parametrize("metres", [0.3, -0.3])
def test_a_camera_is_stuck_once_the_robot_has_driven(metres: float) -> None:
    doubts = Doubts()
    signs = [doubts.sign(SEEN, odometry=metres) for _ in range(RUN + 5)]
    assert [sign.doubtful for sign in signs] == [number > 3 for number in range(RUN + 5)]
    assert [sign.cause for sign in signs] == [None] * (RUN - 1) + [STUCK] * 6
    assert doubts.sign(SEEN[::-1], odometry=metres) == Sign()


@pytest.mark.parametrize("how", [{}, {"odometry": 0.0}, {"point": np.array([3.0, 4.0])}])
def test_who_stands_sees_the_same_without_doubt(how: dict[str, Any]) -> None:
    doubts = Doubts()
    assert [doubts.sign(SEEN, **how) for _ in range(100)] == [Sign(repeats=count) for count in range(100)]


def test_images_without_a_response_say_nothing_of_the_camera() -> None:
    """In a dark tunnel an odometer alone says where the robot is."""
    doubts = Doubts()
    assert not any(doubts.sign(np.zeros(6, np.float32), odometry=5.0).doubtful for _ in range(50))


@pytest.mark.parametrize("frame", ["xy", "UTM 32N", "latlon"])
def test_positions_say_that_the_robot_moves(frame: str) -> None:
    """Three metres an image, and a receiver at rest that errs by four."""
    metres = {"drive": np.arange(30.0) * 3, "rest": np.arange(30.0) % 2 * 4}
    for what, north in metres.items():
        origin, scale = {"latlon": ((60.0, 10.0), 1 / 111_195.0)}.get(frame, ((0.0, 5e5), 1.0))
        values = np.stack([origin[0] + north * scale, np.full(30, origin[1])], axis=1)
        doubts, points = Doubts(), Positions(values, frame).points()
        some = [signs_of(doubts, np.tile(SEEN, (15, 1)), None, points[part]) for part in (slice(15), slice(15, None))]
        signs = [*some[0], *some[1]]
        assert [sign.doubtful for sign in signs] == [what == "drive" and number > 3 for number in range(30)]
        assert [sign.cause for sign in signs] == [STUCK if what == "drive" and k >= 19 else None for k in range(30)]


@pytest.mark.parametrize(
    ("against", "better", "named"),
    [(0.42, 0.03, True), (0.38, 0.03, False), (0.9, 0.021, True), (0.9, 0.019, False), (-0.1, 0.09, False)],
)
def test_images_are_turned_if_the_mean_and_the_places_say_so(against: float, better: float, named: bool) -> None:
    """Both in one sum, the places by no less than their part; from the 20th image on, and at rest never."""

    class Fixed(Likeness):
        def better_turned(self, unit: Any, way: int) -> float:
            return better if way == 1 else 0.0

    mean, edges, shown = np.zeros((4, 8), np.float32), np.zeros(2), np.eye(8, dtype=np.float32)
    mean[2] = -against
    how: Any = (shown, np.ones(8), (2, 2), mean, 0.0, 1.0, np.ones(3), edges, edges)
    for moving in (True, False):
        doubts = Doubts(Fixed(*how))
        causes = [doubts.sign(shown[number % 2 * moving]).cause for number in range(RUN + 5)]
        assert causes == [UPSIDE_DOWN if named and moving and number >= RUN - 1 else None for number in range(RUN + 5)]
