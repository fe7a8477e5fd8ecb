"""The built-in synthetic world: one route seen from a vehicle, in several seasons, lights and weathers.

Commands `demo` and `synth` show this world, and tests measure on it without a data set. A place is drawn from its own
geometry (`lava_vpr.synthetic.scene`), so neighbours share what stands between them. A condition changes colours, light,
air, weather, the vehicle's stance and traffic, and nothing else. Snow turns much of what was dark against its
surroundings into something bright, as on real winter journeys. Every image depends on (seed, place, condition) only.
"""

from __future__ import annotations

import math
import os
import re
import shutil
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError, InputError, shown
from lava_vpr.interrupts import held
from lava_vpr.positions.frames import LAT_LON, Positions, shown_stamp, utm_frame
from lava_vpr.positions.gpx import gpx_text
from lava_vpr.storage.writing import folder_beside, read_only
from lava_vpr.synthetic.drawing import Camera, Painter, draw_backdrop, draw_land
from lava_vpr.synthetic.scene import LOOKS, OCCLUDER, SKY, SURVEY, VIEW, WEATHER, ahead, generator, route
from lava_vpr.synthetic.things import draw_occluder, draw_things

CONDITIONS: tuple[str, ...] = tuple(LOOKS)
MAX_PLACES = 100_000

_SAMPLING = 2  # canvas pixels per image pixel and axis
_SKY_PLACES = 4  # so many places share a sky: minutes of a journey
_GPS_ERROR_M = 1.5
_FOLDERS = ("reference", "query")
_ENDS = ("_positions.csv", ".gpx", "_events.h5", "_events.npz")
_ENTRIES = (*_FOLDERS, *(f"{kind}{end}" for end in _ENDS for kind in _FOLDERS))
METRES_PER_S = 10.0
"""Speed of the vehicle."""
_ORIGIN = Positions(np.array([[610_000.0, 6_640_000.0]]), utm_frame(32, north=True))  # where x and y are 0, for GPX
STARTS = {"reference": 1_719_835_200.0, "query": 1_736_942_400.0}
"""When the journeys begin, seconds since 1970: 2024-07-01 and 2025-01-15, 12:00 UTC."""
_IMAGE = re.compile(r"place_\d{5,}\.png")


@dataclass(frozen=True)
class World:
    """A route with its places.

    Attributes:
        seed: Seed of everything drawn, in [0, 2^63).
        places: Number of places.
        width, height: Size of an image in pixels.
        spacing_m: Metres of track between two places.
    """

    seed: int = 0
    places: int = 100
    width: int = 128
    height: int = 64
    spacing_m: float = 20.0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("seed", self.seed, 0, 2**63 - 1),
            ("places", self.places, 1, MAX_PLACES),
            ("width", self.width, 32, 512),
            ("height", self.height, 24, 512),
            ("spacing_m", self.spacing_m, 1, 1000),
        ):
            if not low <= value <= high:
                raise ConfigError(f"the synthetic world's {name} is {value!r}, but must be in {low}..{high}")


def _number(condition: str) -> int:
    """A condition's number, the key of its random streams."""
    if condition not in CONDITIONS:
        raise InputError(f"there is no condition {condition!r}; choose from {', '.join(CONDITIONS)}")
    return CONDITIONS.index(condition)


def _camera(world: World, place: int, number: int) -> Camera:
    """Where the vehicle was when it took the picture: a little ahead or behind, beside, turned and tilted."""
    forward, right, yaw, pitch = generator(world.seed, VIEW, place, number).uniform(-1, 1, 4).tolist()
    s = place * world.spacing_m + 0.4 * forward
    return Camera(s=s, right=0.07 * right, yaw=0.009 * yaw, pitch=0.0045 * pitch)


def _clouds(world: World, place: int, number: int, count: int) -> list[tuple[float, float, float]]:
    """The clouds over a place and its neighbours: column, row and size as shares of the sky."""
    rng = generator(world.seed, SKY, place // _SKY_PLACES, number)
    return [(rng.uniform(-0.1, 1.1), rng.uniform(0.0, 0.7), rng.uniform(0.04, 0.14)) for _ in range(count)]


def _precipitation(image: NDArray[np.uint8], flakes: int, streaks: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """``image`` with up to so many snow flakes and so many streaks of rain."""
    h, w = image.shape[:2]
    if flakes:
        for _ in range(int(rng.integers(flakes // 5, flakes))):
            x, y, radius = int(rng.integers(8 * w)), int(rng.integers(8 * h)), int(rng.integers(3, 7))
            cv2.circle(image, (x, y), radius, (252, 250, 248), -1, cv2.LINE_8, 3)
    if streaks:
        wet = image.copy()
        for _ in range(streaks):
            x, y, length = int(rng.integers(w)), int(rng.integers(-5, h)), int(rng.integers(4, 10))
            cv2.line(wet, (x, y), (x - length // 4, y + length), (210, 206, 202), 1)
        image = cv2.addWeighted(image, 0.65, wet, 0.35, 0)
    return image


def _grain(image: NDArray[np.uint8], amount: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """``image`` with the sensor's noise, in brightness and in colour, at most twice ``amount`` grey levels."""
    h, w = image.shape[:2]
    noise = rng.integers(-amount, amount + 1, (h, w, 1), dtype=np.int16)
    noise = noise + rng.integers(-amount, amount + 1, (h, w, 3), dtype=np.int16)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def render(world: World, place: int, condition: str) -> NDArray[np.uint8]:
    """One image of a place.

    Args:
        world: The route.
        place: Number of the place, in [0, world.places).
        condition: One of `CONDITIONS`.
    Returns:
        BGR image, uint8 (world.height, world.width, 3); equal arguments give equal bytes.
    Raises:
        InputError: there is no such place or condition.
    """
    number = _number(condition)
    if not 0 <= place < world.places:
        raise InputError(f"place {place} is not in the synthetic world; choose one of 0..{world.places - 1}")
    look = LOOKS[condition]
    painter = _painted(world, _camera(world, place, number), condition, _clouds(world, place, number, look.cloudiness))
    rng = generator(world.seed, OCCLUDER, place, number)
    if rng.uniform(0, 1) < look.occluders:
        draw_occluder(painter, rng)
    canvas = painter.canvas
    image = cv2.resize(canvas, (world.width, world.height), interpolation=cv2.INTER_AREA)
    rng = generator(world.seed, WEATHER, place, number)
    return _grain(_precipitation(image, look.flakes, look.streaks, rng), look.grain, rng)


def light(world: World, camera: Camera, condition: str) -> NDArray[np.float32]:
    """What a camera anywhere on the route sees of the world alone, grey levels, float32 (height, width).

    There is neither weather in the air nor noise of a sensor, and the clouds are those over the first place, so that
    nothing changes but by the camera's motion.
    """
    clouds = _clouds(world, 0, _number(condition), LOOKS[condition].cloudiness)
    grey = cv2.cvtColor(_painted(world, camera, condition, clouds).canvas, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return np.asarray(cv2.resize(grey, (world.width, world.height), interpolation=cv2.INTER_AREA))


def _painted(world: World, camera: Camera, condition: str, clouds: list[tuple[float, float, float]]) -> Painter:
    """The world as a camera sees it, on a canvas that is to be averaged."""
    canvas = np.empty((_SAMPLING * world.height, _SAMPLING * world.width, 3), dtype=np.uint8)
    painter = Painter(canvas, camera, LOOKS[condition], route(world.seed))
    draw_backdrop(painter, clouds)
    things = ahead(world.seed, camera.s)
    draw_land(painter, things)
    draw_things(painter, things)
    return painter


def positions(world: World, condition: str) -> NDArray[np.float64]:
    """Positions as a satellite receiver reported them on the journey, x and y in metres, shape (places, 2)."""
    steps = max(1, round(world.spacing_m))
    return course(world, world.places * steps)[::steps] + _receiver_error(world, condition, 0, world.places)


def track(world: World, condition: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a receiver reported once a second, as many do, beside images at other times.

    Returns:
        Seconds since the start, float64 (n,), from that of the first image to that of the last or a little later; and
        x and y in metres as in `positions`, but each with an error of its own, shape (n, 2).
    """
    seconds = np.arange(math.ceil((world.places - 1) * world.spacing_m / METRES_PER_S) + 1, dtype=np.float64)
    return seconds, course_at(world, seconds * METRES_PER_S) + _receiver_error(world, condition, 1, len(seconds))


def course(world: World, points: int) -> NDArray[np.float64]:
    """The way from the first place on, a point about every metre, float64 (points, 2)."""
    step = world.spacing_m / max(1, round(world.spacing_m))
    s = np.arange(points) * step
    heading = np.zeros_like(s)
    for amplitude, frequency, phase in route(world.seed).heading.terms:
        heading += amplitude * np.sin(frequency * s + phase)
    path = np.cumsum(np.stack([np.cos(heading), -np.sin(heading)], axis=1), axis=0) * step
    return np.asarray(path - path[0])


def course_at(world: World, metres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the way is so many ``metres``, ascending, from the first place, float64 (n, 2)."""
    step = world.spacing_m / max(1, round(world.spacing_m))
    path = course(world, math.ceil(metres[-1] / step) + 1)
    return np.stack([np.interp(metres, np.arange(len(path)) * step, axis) for axis in path.T], axis=1)


def _receiver_error(world: World, condition: str, role: int, count: int) -> NDArray[np.float64]:
    """Errors of reported positions in metres, float64 (count, 2): of images (role 0) or of a track (role 1)."""
    key = (_number(condition),) if role == 0 else (_number(condition), role)
    return generator(world.seed, SURVEY, *key).uniform(-_GPS_ERROR_M, _GPS_ERROR_M, (count, 2))


def _write_journey(folder: Path, kind: str, world: World, condition: str, drawn: Callable[[], None]) -> None:
    """Write one journey's images and positions below ``folder``, which exists."""
    (folder / kind).mkdir()
    rows = ["name,x,y,time"]
    for place, (x, y) in enumerate(positions(world, condition)):
        time = STARTS[kind] + place * world.spacing_m / METRES_PER_S
        name = f"place_{place:05d}.png"
        encoded = cv2.imencode(".png", render(world, place, condition))[1]
        (folder / kind / name).write_bytes(encoded.tobytes())
        drawn()
        rows.append(f"{name},{x:.2f},{y:.2f},{shown_stamp(time)}")
    (folder / f"{kind}_positions.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    seconds, xy = track(world, condition)
    reported = Positions(xy + _ORIGIN.values, _ORIGIN.frame).to(LAT_LON)
    (folder / f"{kind}.gpx").write_text(gpx_text(reported, seconds + STARTS[kind]), encoding="utf-8")


def _foreign(folder: Path, keep: Collection[str]) -> Path | None:
    """The first entry of ``folder`` that `write_traverses` did not write and that is not named in ``keep``, if any."""
    for entry in sorted(folder.iterdir()):
        if entry.name in keep and entry.name not in _ENTRIES:
            continue
        if entry.name not in _ENTRIES or entry.is_symlink() or entry.is_dir() != (entry.name in _FOLDERS):
            return entry
        if entry.is_dir():
            inside = (e for e in sorted(entry.iterdir()) if not (e.is_file() and _IMAGE.fullmatch(e.name)))
            if (stranger := next(inside, None)) is not None:
                return stranger
    return None


def _read_only(folder: Path) -> Path | None:
    """What of ``folder`` and the entries that `write_traverses` replaces in it is closed to writing, if anything is."""
    entries = [folder / name for name in _ENTRIES if (folder / name).exists()]
    whole = [folder, *entries, *(image for entry in entries if entry.is_dir() for image in sorted(entry.iterdir()))]
    return next((path for path in whole if read_only(path)), None)


def _install(new: Path, folder: Path, spare: Path) -> None:
    """Move what is in ``new`` to ``folder``; what it replaces is moved to ``spare``, and its permissions are kept.

    On failure it goes back.
    """
    if not folder.exists():
        os.rename(new, folder)
        return
    for path in new.rglob("*"):
        if (before := folder / path.relative_to(new)).exists():
            shutil.copymode(before, path)
    spare.mkdir()
    try:
        for name in _ENTRIES:
            if (folder / name).exists():
                os.rename(folder / name, spare / name)
        for name in _ENTRIES:
            if (new / name).exists():
                os.rename(new / name, folder / name)
    except OSError:
        for old in spare.iterdir():
            if (folder / old.name).exists():
                os.rename(folder / old.name, new / old.name)
            os.rename(old, folder / old.name)
        raise


def write_traverses(
    folder: Path,
    places: int,
    seed: int,
    conditions: Sequence[str] = ("summer", "winter"),
    keep: Collection[str] = (),
    spacing_m: float = 20.0,
    drawn: Callable[[], None] = lambda: None,
) -> None:
    """Write two journeys along a synthetic route as folders of images.

    ``folder`` receives ``reference/`` and ``query/`` with ``place_00000.png`` ...; ``reference_positions.csv`` and
    ``query_positions.csv`` (columns name, x, y, time; metres, and seconds since 1970 at 10 m/s); and ``reference.gpx``
    and ``query.gpx``, a point every second. The folders appear when all are complete, or not at
    all. An earlier result of this function is replaced; its permissions stay.

    Args:
        folder: The folder to write to; created with its parents.
        places, seed: As in `World`.
        conditions: The conditions of the reference and of the query journey, each one of `CONDITIONS`.
        keep: Names of other entries that ``folder`` may hold; they stay as they are.
        spacing_m: As in `World`.
        drawn: Called after each image, of ``2 places``.
    Raises:
        ConfigError: ``places`` or ``seed`` out of range.
        InputError: an unknown condition, a folder that holds something else or what is read-only, or a folder that
            cannot be written.
    """
    world = World(seed=seed, places=places, spacing_m=spacing_m)
    check_conditions(conditions)

    def write(new: Path) -> None:
        for kind, condition in zip(_FOLDERS, conditions, strict=True):
            _write_journey(new, kind, world, condition, drawn)

    replace_folder(folder, write, keep)


def check_conditions(conditions: Sequence[str]) -> None:
    """Refuse anything but the conditions of a reference and of a query journey.

    Raises:
        InputError: there are not two, or one is unknown.
    """
    if len(conditions) != 2:
        raise InputError(f"{len(conditions)} conditions are given; give two, of the reference and of the query journey")
    for condition in conditions:
        _number(condition)


def replace_folder(folder: Path, write: Callable[[Path], None], keep: Collection[str] = ()) -> None:
    """Let ``write`` fill a new folder with journeys, and replace ``folder`` with it when it is complete.

    Args:
        folder: The folder; created with its parents. An earlier result is replaced; its permissions stay.
        write: Writes to the folder that it is given.
        keep: Names of other entries that ``folder`` may hold; they stay as they are.
    Raises:
        InputError: the folder holds something else or what is read-only, or cannot be written.
    """
    target = Path(os.path.abspath(folder))
    try:
        if os.path.lexists(target) and not target.is_dir():
            raise InputError(f"{shown(folder)}: exists and is not a folder; choose another name")
        if target.is_dir() and (stranger := _foreign(target, keep)) is not None:
            raise InputError(
                f"{shown(folder)}: holds something else ({shown(stranger.name)}); choose a new or an empty folder"
            )
        if target.is_dir() and (closed := _read_only(target)) is not None:
            name = folder / closed.relative_to(target)
            raise InputError(
                f"{shown(name)}: is read-only and would be replaced; make it writable or choose another folder"
            )
        target.parent.mkdir(parents=True, exist_ok=True)
        with folder_beside(target) as workshop:
            (workshop / "new").mkdir()
            write(workshop / "new")
            with held():  # half of it done would leave neither result
                _install(workshop / "new", target, workshop / "old")
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(
            f"{shown(folder)}: cannot be written ({reason}); choose a folder on a disk with free space where you may "
            "write"
        ) from None


__all__ = [
    "CONDITIONS",
    "MAX_PLACES",
    "World",
    "check_conditions",
    "course",
    "course_at",
    "light",
    "positions",
    "render",
    "replace_folder",
    "track",
    "write_traverses",
]
