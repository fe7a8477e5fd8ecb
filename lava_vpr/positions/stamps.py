"""When images were taken: stamps, in seconds; and what file names tell of time and place.

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
from datetime import datetime, timedelta, timezone

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.positions.frames import LAT_LON, XY, Positions, fits, utm_frame

ABSOLUTE = 1e9
"""Stamps from here on are seconds since 1970."""
_MOST = 1e11
"""Seconds since 1970 are below this until the year 5138; larger numbers are in a smaller unit."""
_DATE = re.compile(
    r"(\d{4})-?(\d\d)-?(\d\d)[T _](\d\d)[:-]?(\d\d)[:-]?(\d\d)([.,]\d+)?(?: ?(Z|z)| ?([+-])(\d\d):?(\d\d))?"
)


def is_absolute(stamps: NDArray[np.float64]) -> bool:
    """Whether stamps (n,), of which there is one at least, are seconds since 1970."""
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


def _coordinate(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text) else math.nan


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
    values = np.array([[_coordinate(cell) for cell in fields[1:3]] for fields in split], np.float64)
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
    """The times that file names tell, seconds since 1970, float64 (n,); None if one tells none.

    In a name that begins with @ it is the field of the time. Any other, without its suffix, is a date and time
    (`lava_vpr.positions.stamps.stamp_of`), or milli-, micro-, nano- or whole seconds since 1970: small numbers count
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
