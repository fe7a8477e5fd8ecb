"""How a season, its light and its weather colour a synthetic scene: one `Look` per condition."""

from __future__ import annotations

from dataclasses import dataclass

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
