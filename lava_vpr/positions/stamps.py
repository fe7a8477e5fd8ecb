"""When images were taken: stamps, in seconds.

Stamps of one source are all absolute, seconds since 1970 (Unix time), or all relative, seconds since some start of
their own. From 10^9 on (September 2001) they are absolute.
"""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta, timezone

import numpy as np
from numpy.typing import NDArray

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
