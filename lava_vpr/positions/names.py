"""Positions and times in file names, as benchmarks of visual place recognition write them.

The convention is that of VPR-methods-evaluation and VPR-datasets-downloader (both by G. Berton on GitHub):

    @UTM_east@UTM_north@zone number@zone letter@latitude@longitude@pano_id@tile_num@heading@pitch@roll@height@time@
    note@.jpg (on one line)

Only easting and northing must be there; every other field may be empty or missing. Without zone number and letter, a
latitude band, positions are metres in a plane of their own. The time is YYYYMMDD_hhmmss.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.positions.frames import LAT_LON, XY, Positions, fits, utm_frame
from lava_vpr.positions.stamps import ABSOLUTE, in_seconds, stamp_of

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
