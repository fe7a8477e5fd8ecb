"""Position and time of a photo from its EXIF block.

Source: EXIF 2.32 (CIPA DC-008), its tags and types; the structure is TIFF's, which `lava_vpr.images.formats` walks.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any, NamedTuple

from lava_vpr.errors import InputError, UnreadableError, shown
from lava_vpr.images.files import file_bytes
from lava_vpr.images.formats import entries, walk
from lava_vpr.images.windows import DamagedError, Window

_TIFF = (b"II*\0", b"MM\0*")
_EXIF_PART, _GPS_PART = 34665, 34853
_TAKEN, _SUB_SECONDS, _OFFSET = 36867, 37521, 36881
_NORTH, _LATITUDE, _EAST, _LONGITUDE, _STATUS = 1, 2, 3, 4, 9
_TEXT, _LONG, _FRACTION = {2: "s"}, {4: "I", 13: "I"}, {5: "II"}


class Taken(NamedTuple):
    """Position and time of a photo.

    Attributes:
        where: Latitude and longitude in degrees (WGS 84), north and east positive; None if unknown.
        when: Seconds since 1970; local time read as UTC where ``zoned`` is false; None if unknown.
        zoned: Whether the offset of its local time from UTC is known.
    """

    where: tuple[float, float] | None
    when: float | None
    zoned: bool


def taken(path: Path) -> Taken:
    """Position and time of the photo in file ``path`` from its EXIF block (JPEG, PNG, WebP, HEIC); damaged values are
    ignored.

    A position of 0, 0, or one that the receiver marks as void, counts as none.

    Raises:
        UnreadableError: the file cannot be read, or is no whole image.
    """
    data = file_bytes(path)
    try:
        block = walk(data).exif
    except DamagedError as error:
        raise UnreadableError(f"{shown(path)}: cannot be read ({error}); copy it again or remove it") from None
    except InputError as error:
        raise UnreadableError(f"{shown(path)}: {error}") from None
    main = _values(block, (_EXIF_PART, _GPS_PART), _LONG)
    camera, receiver = ((main[part][0] if part in main else None) for part in (_EXIF_PART, _GPS_PART))
    return Taken(_position(block, receiver), *_time(block, camera))


def _values(
    block: bytes, tags: tuple[int, ...], types: Mapping[int, str], at: int | None = None
) -> dict[int, tuple[Any, ...]]:
    """The values of ``tags`` in a directory of an EXIF block, the first or the one ``at`` a byte; damaged ones are left
    out."""
    found: dict[int, tuple[Any, ...]] = {}
    if block[:4] in _TIFF:
        with contextlib.suppress(DamagedError, InputError):
            for tag, values in entries(Window(block, "image_parts"), tags, types, at):
                if values:
                    found[tag] = values
    return found


def _text(values: tuple[Any, ...]) -> str:
    """The text of a tag, up to its first zero."""
    return bytes(values[0]).split(b"\0")[0].decode("ascii", "replace").strip()


def _position(block: bytes, at: int | None) -> tuple[float, float] | None:
    """Latitude and longitude in degrees."""
    if at is None:
        return None
    texts = {tag: _text(values) for tag, values in _values(block, (_NORTH, _EAST, _STATUS), _TEXT, at).items()}
    parts = _values(block, (_LATITUDE, _LONGITUDE), _FRACTION, at)
    lat, lon = (_degrees(parts.get(tag, ())) for tag in (_LATITUDE, _LONGITUDE))
    if lat is None or lon is None or lat > 90 or lon > 180 or (lat, lon) == (0, 0) or texts.get(_STATUS) == "V":
        return None
    if texts.get(_NORTH) not in ("N", "S") or texts.get(_EAST) not in ("E", "W"):
        return None
    return (-lat if texts[_NORTH] == "S" else lat), (-lon if texts[_EAST] == "W" else lon)


def _degrees(parts: tuple[int, ...]) -> float | None:
    """Degrees, minutes and seconds as degrees: six numbers, each a numerator and its denominator."""
    if len(parts) != 6 or not all(parts[1::2]):
        return None
    return sum(parts[2 * k] / parts[2 * k + 1] / 60.0**k for k in range(3))


def _time(block: bytes, at: int | None) -> tuple[float | None, bool]:
    """Seconds since 1970, and whether the offset from UTC is known."""
    found = {} if at is None else _values(block, (_TAKEN, _SUB_SECONDS, _OFFSET), _TEXT, at)
    texts = {tag: _text(values) for tag, values in found.items()}
    try:
        plain = datetime.strptime(texts.get(_TAKEN, ""), "%Y:%m:%d %H:%M:%S").replace(tzinfo=timezone.utc)
    except ValueError:  # none, or spaces for a clock that was never set
        return None, False
    digits, away = texts.get(_SUB_SECONDS, ""), texts.get(_OFFSET, "")
    seconds = plain.timestamp() + (float(f"0.{digits}") if digits.isascii() and digits.isdigit() else 0.0)
    zoned = len(away) == 6 and away[0] in "+-" and away[3] == ":" and (away[1:3] + away[4:]).isdigit()
    if not zoned:
        return seconds, False
    distance = timedelta(hours=int(away[1:3]), minutes=int(away[4:])).total_seconds()
    return seconds - (distance if away[0] == "+" else -distance), True
