"""What stands where along a synthetic route: its bends and hills, the land on both sides, and the things on it.

It belongs to the place alone: no season, light or weather. It depends on the seed and the position only, so a place
looks the same drawn alone or in a batch, and what one place sees ahead the next one passes by. How a season, its light
and its weather colour it says a `Look`, one per condition.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

SEGMENT_M = 10.0
SIGHT_M = 150.0
SHOULDER_M = 3.4
SLOPE_M = 7.5
MAST_SPACING_M = 37.0
WATER = 0.9  # `Side.water` above this is a lake
GROUND = ("land", "lake")

# Keys that keep the random streams of a world apart.
ROUTE, THINGS, VIEW, WEATHER, OCCLUDER, SKY, SURVEY, DRIVE = range(8)
_WORD = 0xFFFFFFFF  # words of a SeedSequence are never negative; segments behind the start are


def generator(*key: int) -> np.random.Generator:
    """The generator of stream ``key`` = (seed, purpose, ...); every key has its own independent numbers."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


@dataclass(frozen=True)
class Waves:
    """A smooth random function of position: a sum of sine waves, each (amplitude, radians per metre, phase)."""

    terms: tuple[tuple[float, float, float], ...]

    def __call__(self, s: float) -> float:
        return math.fsum(a * math.sin(w * s + p) for a, w, p in self.terms)

    def integral(self, s: float, ahead: NDArray[np.float64]) -> NDArray[np.float64]:
        """Integrals from ``s`` to ``s + ahead``, for every element of ``ahead``."""
        total = np.zeros_like(ahead)
        for a, w, p in self.terms:
            total += a / w * (math.cos(w * s + p) - np.cos(w * (s + ahead) + p))
        return total


def _waves(rng: np.random.Generator, amplitude: float, *lengths_m: float) -> Waves:
    """Waves of about these lengths, together of standard deviation ``amplitude``."""
    each = amplitude * math.sqrt(2.0 / len(lengths_m))
    return Waves(
        tuple(
            (each, 2 * math.pi / (length * rng.uniform(0.85, 1.18)), rng.uniform(0, 2 * math.pi))
            for length in lengths_m
        )
    )


@dataclass(frozen=True)
class Side:
    """One side of the route: height of the land in metres, and how much stands on it (about -2..2, 0 is usual)."""

    bank: Waves
    trees: Waves
    village: Waves
    fence: Waves
    water: Waves

    def level(self, s: float) -> float:
        """Height of the land beyond the slope, metres above the track; negative on an embankment."""
        return max(-1.6, self.bank(s)) if self.water(s) <= WATER else -1.2


@dataclass(frozen=True)
class RouteShape:
    """The way itself. ``railway``: rails and masts, else a road; ``heading`` in radians, ``grade`` as a ratio."""

    seed: int
    railway: bool
    mast_side: int
    heading: Waves
    grade: Waves
    conifers: Waves
    sides: tuple[Side, Side]
    ridges: tuple[Waves, Waves, Waves]

    def offsets(self, s: float, ahead: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far the track at ``s + ahead`` lies to the right of and above the tangent at ``s``, metres, (2, n)."""
        right = self.heading.integral(s, ahead) - self.heading(s) * ahead
        return np.stack([right, self.grade.integral(s, ahead) - self.grade(s) * ahead])

    def foot(self, s: float, x: float) -> float:
        """Height of the ground at ``s``, ``x`` metres to the right: slope from the shoulder to the land beyond."""
        share = min(1.0, max(0.0, (abs(x) - SHOULDER_M) / (SLOPE_M - SHOULDER_M)))
        return share * self.side(x).level(s)

    def side(self, x: float) -> Side:
        """The side on which ``x`` (metres to the right) lies."""
        return self.sides[0 if x < 0 else 1]


@lru_cache(maxsize=16)
def route(seed: int) -> RouteShape:
    """The route of a world."""
    rng = generator(seed, ROUTE)

    def side() -> Side:
        return Side(
            bank=_waves(rng, 1.5, 90, 160, 310),
            trees=_waves(rng, 1.0, 70, 130, 330),
            village=_waves(rng, 1.0, 150, 380),
            fence=_waves(rng, 1.0, 110, 240),
            water=_waves(rng, 1.0, 210, 520),
        )

    return RouteShape(
        seed=seed,
        railway=bool(rng.random() < 0.5),
        mast_side=1 if rng.random() < 0.5 else -1,
        heading=_waves(rng, 0.14, 180, 330, 700),
        grade=_waves(rng, 0.016, 240, 520),
        conifers=_waves(rng, 1.0, 160, 420),
        sides=(side(), side()),
        # Of bearing in units of a tenth of a radian, not of metres.
        ridges=(_waves(rng, 1.0, 9, 4.1, 2.3, 1.1), _waves(rng, 1.0, 7, 3.3, 1.7), _waves(rng, 1.0, 1.9, 0.83, 0.41)),
    )


@dataclass(frozen=True)
class Thing:
    """A thing beside the track, or a piece of its ground.

    Attributes:
        kind: ``conifer``, ``broadleaf``, ``bush``, ``rock``, ``house``, ``barn``, ``church``, ``silo``, ``fence``,
            ``sign``, ``mast``, ``bridge``; or ground: ``land``, ``lake``.
        s: Position along the route, metres.
        x: Metres to the right of the track; of ground, -1 (left) or 1 (right).
        y: Metres of its foot above the track.
        width, height: Metres; of ground and fences, ``width`` is the height of the far end's foot.
        tint: What colour it has among its kind, in [0, 1).
        shape: Random numbers in [0, 1) that fix its details.
    """

    kind: str
    s: float
    x: float
    y: float = 0.0
    width: float = 0.0
    height: float = 0.0
    tint: float = 0.0
    shape: tuple[float, ...] = ()


def _buildings(rng: np.random.Generator, way: RouteShape, s: float, sign: int) -> Iterator[Thing]:
    """Buildings of one segment on one side; none stands in a lake."""
    side = way.side(sign)
    if rng.random() >= 0.10 + 0.30 * max(0.0, side.village(s)) or side.water(s) > WATER:
        return
    draw = rng.random()
    kind = "church" if draw < 0.06 else "silo" if draw < 0.14 else "barn" if draw < 0.38 else "house"
    width, height = {
        "church": (7.0, 6.0),
        "silo": (4.0, 9.0 + 4 * rng.random()),
        "barn": (9.0 + 5 * rng.random(), 4.0 + rng.random()),
        "house": (6.5 + 3 * rng.random(), 3.0 + 2.6 * rng.random()),
    }[kind]
    x = sign * (SHOULDER_M + 3.0 + width / 2 + 16 * rng.random() ** 1.5)
    at = s + SEGMENT_M * rng.random()
    # A building stands level, even where the land behind it rises.
    yield Thing(kind, at, x, side.level(at), width, height, rng.random(), tuple(rng.random(6).tolist()))


def _plants(rng: np.random.Generator, way: RouteShape, s: float, sign: int) -> Iterator[Thing]:
    """Trees, bushes and rocks of one segment on one side."""
    side = way.side(sign)
    wet = side.water(s) > WATER
    density = 0.2 if wet else min(2.6, max(0.12, 0.95 + 0.85 * side.trees(s)))
    reach = 3.0 if wet else 24.0  # at a lake trees stand on its shore only
    conifers = 0.5 + 0.3 * way.conifers(s)
    plants: list[tuple[str, float, float, float]] = []
    for _ in range(int(rng.poisson(density))):
        conifer = rng.random() < conifers
        height = (6.0 if conifer else 5.0) + 8.0 * rng.random()
        width = height * (0.34 + 0.12 * rng.random() if conifer else 0.55 + 0.3 * rng.random())
        x = sign * (SHOULDER_M + 2.6 + reach * rng.random() ** 1.6)
        plants.append(("conifer" if conifer else "broadleaf", x, width, height))
    if rng.random() < 0.28:
        size = 0.9 + 1.5 * rng.random()
        kind = "rock" if rng.random() < 0.35 else "bush"
        plants.append((kind, sign * (SHOULDER_M + 1.0 + 5 * rng.random()), 1.5 * size, size))
    for kind, x, width, height in plants:
        at = s + SEGMENT_M * rng.random()
        yield Thing(kind, at, x, way.foot(at, x), width, height, rng.random(), tuple(rng.random(12).tolist()))


def _land(rng: np.random.Generator, way: RouteShape, index: int, sign: int) -> Thing:
    """The ground of one segment on one side; fields are parcels of six segments."""
    s, side = index * SEGMENT_M, way.side(sign)
    crop = generator(way.seed, THINGS, (index // 6) & _WORD, 2 + sign).random()
    kind = "lake" if side.water(s) > WATER else "land"
    details = tuple(rng.random(4).tolist())
    return Thing(kind, s, float(sign), side.level(s), side.level(s + SEGMENT_M), side.level(s), crop, details)


@lru_cache(maxsize=8192)
def segment(seed: int, index: int) -> tuple[Thing, ...]:
    """All things of the ``index``-th stretch of `SEGMENT_M` metres."""
    way = route(seed)
    rng = generator(seed, THINGS, index & _WORD)
    s = index * SEGMENT_M
    things: list[Thing] = []
    for sign in (-1, 1):
        side = way.side(sign)
        things.append(_land(rng, way, index, sign))
        if side.fence(s) > 0.35:
            x = sign * (SHOULDER_M + 1.1)
            things.append(Thing("fence", s, x, way.foot(s, x), way.foot(s + SEGMENT_M, x), tint=rng.random()))
        things.extend(_buildings(rng, way, s, sign))
        things.extend(_plants(rng, way, s, sign))
    if rng.random() < 0.09:
        sign = 1 if rng.random() < 0.7 else -1
        things.append(Thing("sign", s + 5, sign * (SHOULDER_M + 0.4), 0.0, 0.9, 2.6 + rng.random(), rng.random()))
    if rng.random() < 0.012:
        things.append(Thing("bridge", s + 5, 0.0, 0.0, 3.0, 6.2, rng.random()))
    mast = math.ceil(s / MAST_SPACING_M) * MAST_SPACING_M
    if mast < s + SEGMENT_M:
        x = way.mast_side * (SHOULDER_M + (0.1 if way.railway else 1.6))
        things.append(Thing("mast", mast, x, 0.0, 0.3, 6.6))
    return tuple(things)


def ahead(seed: int, s: float) -> list[Thing]:
    """All things within sight of position ``s``: the land first, then the others, the farthest first."""
    first = math.floor(s / SEGMENT_M)
    things = [t for i in range(first, first + int(SIGHT_M / SEGMENT_M)) for t in segment(seed, i)]
    return sorted(things, key=lambda t: (t.kind not in GROUND, -t.s, -abs(t.x)))


Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """How a season and its light colour things; colours are BGR, 0..255, before light and haze.

    Attributes:
        sky: Colours of the sky at the zenith and at the horizon.
        clouds: Colour of clouds.
        cloudiness: Number of clouds.
        haze: Colour of the air, and ``haze_m`` the distance in which it hides 63 % of a thing.
        light: Gain of blue, green and red.
        ridges: Colours of far mountains, hills and distant wood.
        crops: Colours of the land, by parcel.
        verge, bank, steep: Colours beside the track, of gentle and of steep slopes.
        water: Colour of lakes.
        way, rail, mark: Colours of ballast or asphalt, of rails, and of the road's lines.
        needles, leaves: Dark and bright colour of conifers and of broadleaved trees.
        bark, rock, wood: Colours of trunks, rocks, and posts.
        snow: How much snow lies on roofs, trees and fields, 0..1.
        bare: Whether broadleaved trees have lost their leaves.
        sun: -1, 0, 1: sun from the left, none, from the right.
        lamp: Gain that the vehicle's own headlamps add to near things.
        windows: Colour of lit windows, which shine through night and haze; ``lit``: whether some are.
        flakes, streaks: At most so many snow flakes, and so many streaks of rain.
        grain: The sensor's noise in grey levels.
        occluders: Share of images in which traffic or a branch hides something.
    """

    sky: tuple[Colour, Colour]
    clouds: Colour
    cloudiness: int
    haze: Colour
    haze_m: float
    light: Colour
    ridges: tuple[Colour, Colour, Colour]
    crops: tuple[Colour, Colour, Colour]
    verge: Colour
    bank: Colour
    steep: Colour
    water: Colour
    way: Colour
    rail: Colour
    mark: Colour
    needles: tuple[Colour, Colour]
    leaves: tuple[Colour, Colour]
    bark: Colour = (46, 58, 72)
    rock: Colour = (120, 122, 126)
    wood: Colour = (70, 84, 98)
    windows: Colour = (120, 214, 252)
    lit: bool = False
    snow: float = 0.0
    bare: bool = False
    sun: int = 0
    lamp: float = 0.0
    flakes: int = 0
    streaks: int = 0
    grain: int = 4
    occluders: float = 0.08


SNOW: Colour = (246, 241, 238)
WALLS: tuple[Colour, ...] = (
    (48, 52, 158), (222, 228, 230), (96, 176, 214), (134, 140, 146), (150, 128, 98), (72, 92, 134), (196, 206, 196),
)  # fmt: skip
ROOFS: tuple[Colour, ...] = ((58, 56, 60), (52, 66, 128), (84, 82, 80))


SUMMER = Look(
    sky=((214, 160, 96), (240, 222, 196)), clouds=(250, 248, 246), cloudiness=4,
    haze=(226, 206, 178), haze_m=420.0, light=(1.0, 1.0, 1.0),
    ridges=((186, 160, 132), (118, 128, 96), (62, 88, 58)),
    crops=((72, 146, 112), (84, 178, 178), (66, 118, 82)),
    verge=(88, 134, 122), bank=(62, 128, 92), steep=(112, 120, 124), water=(186, 142, 90),
    way=(104, 108, 114), rail=(190, 196, 200), mark=(230, 232, 232),
    needles=((40, 62, 30), (58, 96, 52)), leaves=((42, 96, 56), (66, 150, 104)), sun=1, grain=3, occluders=0.03,
)  # fmt: skip
WINTER = Look(
    sky=((128, 116, 108), (172, 160, 152)), clouds=(160, 150, 144), cloudiness=2,
    haze=(196, 188, 182), haze_m=400.0, light=(0.94, 0.92, 0.90),
    ridges=((232, 224, 218), (206, 198, 190), (236, 228, 220)),
    crops=((250, 244, 240), (240, 232, 226), (246, 240, 234)),
    verge=(236, 230, 224), bank=(226, 218, 212), steep=(150, 146, 146), water=(206, 192, 172),
    way=(206, 202, 198), rail=(64, 62, 66), mark=(150, 146, 142),
    needles=((48, 60, 42), (70, 84, 62)), leaves=((66, 78, 92), (92, 106, 120)),
    snow=1.0, bare=True, flakes=24,
)  # fmt: skip
RAIN = Look(
    sky=((138, 132, 126), (168, 164, 158)), clouds=(120, 116, 112), cloudiness=5,
    haze=(166, 162, 156), haze_m=110.0, light=(0.72, 0.70, 0.66),
    ridges=((158, 154, 148), (146, 144, 136), (122, 124, 114)),
    crops=((78, 128, 108), (92, 146, 150), (70, 108, 84)),
    verge=(84, 112, 106), bank=(66, 112, 92), steep=(96, 100, 104), water=(170, 162, 152),
    way=(118, 118, 118), rail=(180, 180, 180), mark=(220, 220, 220),
    needles=((44, 58, 36), (58, 82, 52)), leaves=((46, 84, 58), (66, 118, 90)), streaks=60,
)  # fmt: skip
NIGHT = Look(
    sky=((44, 22, 14), (92, 58, 44)), clouds=(70, 46, 38), cloudiness=3,
    haze=(58, 38, 30), haze_m=190.0, light=(0.30, 0.24, 0.20),
    ridges=((60, 38, 28), (44, 30, 22), (26, 20, 14)),
    crops=SUMMER.crops, verge=SUMMER.verge, bank=SUMMER.bank, steep=SUMMER.steep, water=(200, 150, 110),
    way=SUMMER.way, rail=SUMMER.rail, mark=SUMMER.mark, needles=SUMMER.needles, leaves=SUMMER.leaves,
    lamp=4.5, windows=(120, 214, 252), lit=True, grain=6,
)  # fmt: skip
LOOKS: dict[str, Look] = {"summer": SUMMER, "winter": WINTER, "rain": RAIN, "night": NIGHT}
