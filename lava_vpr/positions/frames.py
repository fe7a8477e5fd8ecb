"""Where and when images were taken: positions with their coordinate frames, stamps in seconds, and both from file
names.

A frame has one of these names, which model files store:

    xy          x and y in metres on a plane of its own
    latlon      latitude and longitude in degrees (WGS 84)
    UTM 32N     easting and northing in metres of UTM zone 32 (1 to 60), northern hemisphere (S: southern), as EPSG
                names zones; the letter is no latitude band

``xy`` is compared with any other metres as if their frames were equal: only their owner knows the zone of eastings and
northings that come without one.

Stamps of one source are all absolute, seconds since 1970 (Unix time), or all relative, seconds since some start of
their own. From 10^9 on (September 2001) they are absolute.

Names are those of benchmarks of visual place recognition, by the convention of VPR-methods-evaluation and
VPR-datasets-downloader (both by G. Berton on GitHub):

    @UTM_east@UTM_north@zone number@zone letter@latitude@longitude@pano_id@tile_num@heading@pitch@roll@height@time@
    note@.jpg (on one line)

Only easting and northing must be there; every other field may be empty or missing. Without zone number and letter, a
latitude band, positions are metres in a plane of their own. The time is YYYYMMDD_hhmmss.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any, cast

import numpy as np
import utm
from numpy.typing import ArrayLike, NDArray

from lava_vpr.errors import InputError, brief

XY, LAT_LON = "xy", "latlon"
EARTH_RADIUS_M = 6_371_008.8  # mean radius, IUGG
MOST_METRES = 2**53
"""Largest coordinate in metres; beyond it, neighbouring float64 values are more than a metre apart."""
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
        InputError: there are no positions, one is out of range, or the frame is unknown.
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
            InputError: one frame is a plane of its own and the other is in degrees, or a position is outside all UTM
                zones.
        """
        if frame == self.frame:
            return self
        if XY in (frame, self.frame):
            if LAT_LON in (frame, self.frame):
                raise InputError("positions in x,y and in lat,lon cannot be compared; give both in the same frame")
            return Positions(self.values, frame)
        if not len(self):
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
    """``given`` as positions: an array of coordinates (images, 2) is taken to be in ``frame``; None stays None.

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
    return np.stack(utm.to_latlon(values[:, 0], values[:, 1], number, northern=north, strict=False), axis=1)


def _in_zone(degrees: NDArray[np.float64], frame: str) -> NDArray[np.float64]:
    """Eastings and northings of latitude and longitude, in a zone that need not be their own."""
    number, north = _zone(frame)
    lat, lon = degrees[:, 0], (degrees[:, 1] + 180.0) % 360.0 - 180.0
    try:
        east, north_m, *_ = utm.from_latlon(lat, lon, force_zone_number=number, force_northern=north)
    except utm.OutOfRangeError:
        raise InputError(
            "a latitude is beyond UTM, which ends at 80 S and 84 N; give all positions as lat,lon"
        ) from None
    return np.stack([east, north_m], axis=1)


EXIF = "exif"
"""Value of a positions option instead of a file: the EXIF of each photo gives its position and time."""


def in_photos(positions: object) -> bool:
    """Whether ``positions`` is `EXIF`, the value that stands for the photos' own positions."""
    return str(positions) == EXIF


ABSOLUTE = 1e9
"""Smallest stamp that counts as seconds since 1970."""
_MOST = 1e11
"""Seconds since 1970 are below this until the year 5138; larger numbers are in a smaller unit."""
_DATE = re.compile(
    r"(\d{4})-?(\d\d)-?(\d\d)[T _](\d\d)[:-]?(\d\d)[:-]?(\d\d)([.,]\d+)?(?: ?(Z|z)| ?([+-])(\d\d):?(\d\d))?"
)


def is_absolute(stamps: NDArray[np.float64]) -> bool:
    """Whether stamps (n,), at least one, are seconds since 1970."""
    return bool(stamps[0] >= ABSOLUTE)


def stamp_of(text: str) -> float:
    """The number that ``text`` is, or the seconds since 1970 of a date and time; NaN if it is neither.

    Dates are written as in ISO 8601, ``2024-05-01T12:00:00.5Z``, or ``20240501_120000``; without a zone they are UTC.
    """
    date = _DATE.fullmatch(text)
    if date is None:
        try:
            return float(text)
        except ValueError:
            return math.nan
    fraction = float("0." + date[7][1:]) if date[7] else 0.0
    away = timedelta(hours=int(date[10]), minutes=int(date[11])) if date[9] else timedelta()
    try:
        year, month, day, hour, minute, second = map(int, date.groups()[:6])
        plain = datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc)
        return (plain - (-away if date[9] == "-" else away)).timestamp() + fraction
    except (ValueError, OverflowError):  # a 13th month; a year 0
        return math.nan


def in_seconds(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stamps of one source in seconds: numbers of 10^11 and more are milli-, micro- or nanoseconds since 1970."""
    unit = 1.0
    while len(numbers) and np.abs(numbers).max() / unit >= _MOST and unit < 1e9:
        unit *= 1e3
    return numbers / unit


def shown_stamp(stamp: float) -> str:
    """A stamp as text, to a microsecond."""
    return f"{stamp:.6f}".rstrip("0").rstrip(".")


_ZONE, _LETTER, _TIME = 3, 4, 13
_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?|[+-]?\.\d+")


def _frame(fields: Sequence[str]) -> str:
    """The frame of one name's easting and northing."""
    number, letter = (*fields, "", "", "", "", "")[_ZONE : _LETTER + 1]
    if (
        number.isascii()
        and number.isdigit()
        and 1 <= int(number[:9]) <= 60
        and re.fullmatch("[C-HJ-NP-Xc-hj-np-x]", letter)
    ):
        return utm_frame(int(number), letter.upper() >= "N")
    return XY


def carry_positions(names: Sequence[str]) -> bool:
    """Whether file names are of this convention: all begin with @ and two numbers."""
    return (
        bool(names)
        and names[0][:1] == "@"
        and all(
            name.startswith("@") and len(fields := name.split("@")) > 3 and all(map(_NUMBER.fullmatch, fields[1:3]))
            for name in names
        )
    )


def positions_of_names(names: Sequence[str], source: str) -> Positions | None:
    """The positions in file names; None if the names are not of this convention (`carry_positions`).

    They are in the frame of their UTM zone, if they are of one; of several they are given in degrees.

    Args:
        names: File names without folders.
        source: Where they are from, for messages.
    Raises:
        InputError: a number is beyond all bounds, or some names have a zone and others none.
    """
    if not carry_positions(names):
        return None
    split = [name.split("@") for name in names]
    values = np.array([[float(cell) for cell in fields[1:3]] for fields in split], np.float64)
    if not (good := fits(values, XY).all(axis=1)).all():
        raise InputError(f"{source}: the name {brief(names[int(good.argmin())])} has no position in metres; rename it")
    frames = np.array([_frame(fields) for fields in split])
    kinds = np.unique(frames).tolist()
    if len(kinds) == 1:
        return Positions(values, kinds[0])
    if XY in kinds:
        lacking = brief(names[int((frames == XY).argmax())])
        raise InputError(f"{source}: the name {lacking} has no UTM zone, but others have; complete it")
    for kind in kinds:
        own = frames == kind
        values[own] = Positions(values[own], kind).to(LAT_LON).values
    return Positions(values, LAT_LON)


def stamps_of_names(names: Sequence[str]) -> NDArray[np.float64] | None:
    """The times in file names, seconds since 1970, float64 (n,); None if a name has none.

    In a name that begins with @ this is the field of the time. Any other name, without its suffix, is a date and time
    (`lava_vpr.positions.frames.stamp_of`), or milli-, micro-, nano- or whole seconds since 1970: small numbers count
    images, they are no times.
    """
    if not names or not (names[0][:1] == "@" or math.isfinite(stamp_of(names[0].rpartition(".")[0]))):
        return None  # without a look at a million others
    fields = [name.split("@")[_TIME : _TIME + 1] for name in names]
    if carry_positions(names):
        texts = [field[0] if field and "_" in field[0] else "" for field in fields]
    else:
        texts = [name.rpartition(".")[0] for name in names]
    stamps = in_seconds(np.array([stamp_of(text) for text in texts], np.float64))
    return stamps if (np.isfinite(stamps) & (stamps >= ABSOLUTE)).all() else None
