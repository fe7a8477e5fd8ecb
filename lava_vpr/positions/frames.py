"""Positions of images, and the frames in which their coordinates are given.

A frame is named by one of these texts, which a model file keeps:

    xy          x and y in metres on a plane of its own
    latlon      latitude and longitude in degrees (WGS 84)
    UTM 32N     easting and northing in metres of UTM zone 32 (1 to 60), northern hemisphere (S: southern), as EPSG
                names zones; the letter is no latitude band

``xy`` is taken for whatever metres it is compared with: of eastings and northings without a zone only their owner knows
it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import utm
from numpy.typing import ArrayLike, NDArray

from lava_vpr.errors import InputError, brief

XY, LAT_LON = "xy", "latlon"
EARTH_RADIUS_M = 6_371_008.8  # mean radius, IUGG
MOST_METRES = 2**53
"""No coordinate in metres is larger: from there on they are farther than a metre apart in float64."""
_UTM = re.compile(r"UTM ([1-9]|[1-5]\d|60)([NS])")


def utm_frame(zone: int, north: bool) -> str:
    """The frame of UTM zone ``zone``, 1 to 60."""
    return f"UTM {zone}{'N' if north else 'S'}"


def is_frame(text: object) -> bool:
    """Whether ``text`` names a frame."""
    return isinstance(text, str) and (text in (XY, LAT_LON) or _UTM.fullmatch(text) is not None)


def columns(frame: str) -> tuple[str, str]:
    """The names of a frame's two coordinates, as tables head their columns."""
    return ("lat", "lon") if frame == LAT_LON else ("x", "y")


def fits(values: NDArray[np.float64], frame: str) -> NDArray[np.bool_]:
    """Which of the coordinates (n, 2) are finite and within the frame's range, bool (n, 2).

    Latitude is within 90 degrees, longitude within 360, since some write 0 to 360; metres are below 2^53.
    """
    limits = (90.0, 360.0) if frame == LAT_LON else (MOST_METRES, MOST_METRES)
    return np.abs(values) <= limits  # NaN is not


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of images, each finite and within the range of its frame.

    Attributes:
        values: Coordinates, float64 (images, 2): a copy of what is given, which may be any rows of two numbers.
        frame: The frame that they are in.
    Raises:
        InputError: they are none, one is out of range, or there is no such frame.
    """

    values: NDArray[np.float64]
    frame: str

    def __post_init__(self) -> None:
        if not is_frame(self.frame):
            raise InputError(f"positions have the frame {brief(self.frame)}; name xy, latlon, or a zone as in UTM 32N")
        try:
            given = np.asarray(self.values)
        except ValueError:  # rows of unequal length
            given = np.empty(0, object)
        if given.dtype.kind not in "fiu" or given.ndim != 2 or given.shape[1] != 2:
            raise InputError(
                f"positions are of type {given.dtype} and shape {given.shape}; give two real numbers for each image"
            )
        values = given.astype(np.float64)
        good = fits(values, self.frame).all(axis=1)
        if not good.all():
            row = int(good.argmin())
            raise InputError(
                f"position {row} is {brief(values[row].tolist())}, not finite or out of the range of {self.frame}; "
                "correct it or leave it out"
            )
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.values)

    def take(self, chosen: Any) -> Positions:
        """The positions with these numbers, in this order."""
        return Positions(self.values[chosen], self.frame)

    def to(self, frame: str) -> Positions:
        """The same positions in another frame.

        Raises:
            InputError: one frame is a plane of its own and the other is in degrees, or a position is no UTM zone's.
        """
        if frame == self.frame:
            return self
        if XY in (frame, self.frame):
            if LAT_LON in (frame, self.frame):
                raise InputError("positions in x,y and in lat,lon cannot be compared; give both in the same frame")
            return Positions(self.values, frame)
        degrees = self.values if self.frame == LAT_LON else _degrees(self.values, self.frame)
        return Positions(degrees if frame == LAT_LON else _in_zone(degrees, frame), frame)

    def points(self) -> NDArray[np.float64]:
        """Coordinates in metres whose straight distances are those of the positions, float64 (images, 2 or 3).

        Degrees become points on a sphere of the Earth's mean radius: distances are within 0.6 % of those on the
        ellipsoid, and the chord is a metre shorter than the arc at 99 km.
        """
        if self.frame != LAT_LON:
            return self.values
        lat, lon = np.radians(self.values).T
        flat = np.cos(lat)
        return EARTH_RADIUS_M * np.stack([flat * np.cos(lon), flat * np.sin(lon), np.sin(lat)], axis=1)

    def plane(self) -> NDArray[np.float64]:
        """East and north in metres for a drawing, float64 (images, 2); degrees are projected about their middle.

        x = R cos(lat0) (lon - lon0), y = R (lat - lat0).
        """
        if self.frame != LAT_LON or not len(self):
            return self.values
        first = self.values[0]
        away = (self.values - first + 180.0) % 360.0 - 180.0  # across the date line, too
        middle = first + (away.min(axis=0) + away.max(axis=0)) / 2
        north, east = np.radians((self.values - middle + 180.0) % 360.0 - 180.0).T
        return EARTH_RADIUS_M * np.stack([east * np.cos(np.radians(middle[0])), north], axis=1)


def placed(given: Positions | ArrayLike | None, frame: str) -> Positions | None:
    """Positions as given, and an array of coordinates (images, 2) as positions in ``frame``; None stays None.

    Raises:
        InputError: as `Positions`.
    """
    return (
        given if given is None or isinstance(given, Positions) else Positions(cast(NDArray[np.float64], given), frame)
    )


def distances(ours: Positions, theirs: Positions) -> NDArray[np.float64]:
    """Metres between positions of equal number, one by one, float64 (n,).

    Raises:
        InputError: their frames cannot be compared.
    """
    difference = ours.points() - theirs.to(ours.frame).points()
    return np.sqrt((difference**2).sum(axis=1))


def joined(parts: Sequence[Positions]) -> Positions:
    """Several positions, one after another, in the first one's frame.

    Raises:
        InputError: their frames cannot be compared.
    """
    frame = parts[0].frame
    return Positions(np.concatenate([part.to(frame).values for part in parts]), frame)


def _zone(frame: str) -> tuple[int, bool]:
    """Number of a UTM zone, and whether it is northern."""
    return int(frame[4:-1]), frame[-1] == "N"


def _degrees(values: NDArray[np.float64], frame: str) -> NDArray[np.float64]:
    """Latitude and longitude of eastings and northings."""
    number, north = _zone(frame)
    if not len(values):
        return values
    return np.stack(utm.to_latlon(values[:, 0], values[:, 1], number, northern=north, strict=False), axis=1)


def _in_zone(degrees: NDArray[np.float64], frame: str) -> NDArray[np.float64]:
    """Eastings and northings of latitude and longitude, in a zone that need not be their own."""
    number, north = _zone(frame)
    if not len(degrees):
        return degrees
    lat, lon = degrees[:, 0], (degrees[:, 1] + 180.0) % 360.0 - 180.0
    try:
        east, north_m, *_ = utm.from_latlon(lat, lon, force_zone_number=number, force_northern=north)
    except utm.OutOfRangeError:
        raise InputError(
            "a latitude is beyond UTM, which ends at 80 S and 84 N; give all positions as lat,lon"
        ) from None
    return np.stack([east, north_m], axis=1)
