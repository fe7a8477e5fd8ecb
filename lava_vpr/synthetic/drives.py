"""Drives of an event camera through the synthetic world, with the position at every moment as ground truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.events.camera import WRITTEN, EventCamera, Sensor, Sent, write_events
from lava_vpr.positions.frames import shown_stamp
from lava_vpr.synthetic.drawing import Camera
from lava_vpr.synthetic.scene import DRIVE, generator
from lava_vpr.synthetic.world import METRES_PER_S, STARTS, World, check_conditions, course_at, light, replace_folder

STEP_M = 0.2
"""Metres between two pictures, at most: 50 pictures a second at 10 m/s."""
_TRUTH_S = 0.1  # between two rows of ground truth
_SWAY = ((0.05, 31.0), (0.03, 11.0))  # metres to the right, and metres of road that a swing takes
_KINDS = ("reference", "query")


@dataclass(frozen=True)
class EventDrive:
    """One drive along all places of a world.

    Attributes:
        world: The route; its image size is the sensor's.
        condition: Season and light, one of `lava_vpr.synthetic.world.CONDITIONS`.
        speed: Metres a second on average; it swings by a tenth.
        sensor: The camera.
    """

    world: World
    condition: str
    speed: float = METRES_PER_S
    sensor: Sensor = field(default_factory=Sensor)

    def way(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Seconds since the start, and metres along the route, at each picture, float64 (n,) each."""
        length = self.world.places * self.world.spacing_m
        s = np.linspace(0.0, length, math.ceil(length / STEP_M) + 1)
        phase = self._rng(0).uniform(0, 2 * math.pi)
        speed = self.speed * (1 + 0.1 * np.sin(2 * math.pi * s / 170.0 + phase))
        return np.concatenate([[0.0], np.cumsum(np.diff(s) / speed[:-1])]), s

    def events(self, advance: Callable[[int], None] | None = None) -> Iterator[Sent]:
        """The events from picture to picture; ``advance`` is told after each.

        Equal drives give equal events.
        """
        seconds, along = self.way()
        micros = np.rint(seconds * 1e6).astype(np.int64)
        swings = self._rng(1).uniform(0, 2 * math.pi, len(_SWAY))
        camera: EventCamera | None = None
        for k, s in enumerate(along.tolist()):
            right = sum(a * math.sin(2 * math.pi * s / w + p) for (a, w), p in zip(_SWAY, swings.tolist(), strict=True))
            seen = light(self.world, Camera(s=s, right=right), self.condition)
            if camera is None:
                camera = EventCamera(seen, self._rng(2), self.sensor)
            else:
                yield camera.see(seen, int(micros[k - 1]), int(micros[k]))
            if advance is not None:
                advance(1)

    def truth(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Seconds since the start, float64 (n,), from the first event to the last; and x and y in metres, (n, 2)."""
        seconds, along = self.way()
        times = np.append(np.arange(0.0, seconds[-1], _TRUTH_S), seconds[-1])
        return times, course_at(self.world, np.interp(times, seconds, along))

    def _rng(self, role: int) -> np.random.Generator:
        """Random numbers of the drive: its speed (0), its sway (1), its camera (2)."""
        name = [ord(letter) for letter in self.condition]
        return generator(self.world.seed, DRIVE, role, round(1000 * self.speed), *name)


def write_drives(
    folder: Path,
    drives: Sequence[EventDrive],
    end: str = ".h5",
    keep: Collection[str] = (),
    advance: Callable[[int], None] | None = None,
) -> list[int]:
    """Write a reference and a query drive: ``reference_events.h5`` and ``query_events.h5`` (or ``.npz``), and beside
    them ``reference_positions.csv`` and ``query_positions.csv`` (columns time, x, y; ten rows a second).

    Args:
        folder, keep: As in `lava_vpr.synthetic.world.replace_folder`.
        drives: The two.
        end: End of the files' names, one of `lava_vpr.events.camera.WRITTEN`.
        advance: Called after each picture.
    Returns:
        The number of events of each.
    Raises:
        InputError: an unknown condition or end, or the folder cannot be written.
    """
    check_conditions([drive.condition for drive in drives])
    if end not in WRITTEN:
        raise InputError(f"events are not written to {end!r} files; give one of {', '.join(WRITTEN)}")
    counts: list[int] = []

    def write(new: Path) -> None:
        for kind, drive in zip(_KINDS, drives, strict=True):
            size = (drive.world.width, drive.world.height)
            counts.append(write_events(new / f"{kind}_events{end}", drive.events(advance), size, STARTS[kind]))
            times, xy = drive.truth()
            rows = [
                f"{shown_stamp(time + STARTS[kind])},{x:.2f},{y:.2f}"
                for time, (x, y) in zip(times.tolist(), xy.tolist(), strict=True)
            ]
            table = "\n".join(["time,x,y", *rows]) + "\n"
            (new / f"{kind}_positions.csv").write_text(table, encoding="utf-8")

    replace_folder(folder, write, keep)
    return counts
