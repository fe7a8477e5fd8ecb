"""Tracks of satellite receivers as GPX files, read and written by the package gpxpy."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from pathlib import Path
from xml.parsers import expat

import gpxpy
import numpy as np
from gpxpy.gpx import GPX, GPXException, GPXRoutePoint, GPXTrack, GPXTrackPoint, GPXTrackSegment, GPXWaypoint
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief, shown
from lava_vpr.positions.frames import LAT_LON, Positions, fits
from lava_vpr.positions.track import Track
from lava_vpr.storage.limits import within
from lava_vpr.storage.tables import file_text

Point = GPXTrackPoint | GPXRoutePoint | GPXWaypoint
_LATITUDE = re.compile(r"\blat\s*=")  # every point has one
_MOST_NAMESPACES = 100
"""gpxpy looks for each to the end of the text; receivers declare three or four."""
_DEEPEST = 100
"""Levels of elements; a point of a track is on the fourth, and what receivers add to it on a few more."""


def read_gpx(path: Path) -> Track:
    """The points of all tracks in a GPX file, or of its routes, or its waypoints, whichever come first in this order.

    Times are taken if every point has one; without a zone they are UTC.

    Raises:
        InputError: unreadable, no GPX, without points, a point beyond the Earth, times of some points alone, or a time
            before the one above; the message counts points from 1.
    """
    text = file_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # the constructs by which XML attacks its readers
        raise InputError(f"{shown(path)}: is no GPX (it declares a document type); export the track again")
    if text.count("xmlns") > _MOST_NAMESPACES:
        raise InputError(
            f"{shown(path)}: is no GPX (it declares {text.count('xmlns')} namespaces); export the track again"
        )
    within("points", sum(1 for _ in _LATITUDE.finditer(text)), f"{shown(path)}: has")
    try:
        _check_depth(text)
        gpx = gpxpy.parse(text)
    except (GPXException, expat.ExpatError, ValueError, ArithmeticError, RecursionError) as error:
        raise InputError(
            f"{shown(path)}: is no GPX, or cut short ({brief(str(error))}); export the track again"
        ) from None
    points: list[Point] = [point for track in gpx.tracks for segment in track.segments for point in segment.points]
    points = points or [point for route in gpx.routes for point in route.points] or [*gpx.waypoints]
    if not points:
        raise InputError(f"{shown(path)}: holds no points; export a track")
    values = np.array([[p.latitude, p.longitude] for p in points], np.float64)
    good = fits(values, LAT_LON).all(axis=1)
    if not good.all():
        k = int(good.argmin())
        raise InputError(f"{shown(path)}: point {k + 1} is at {values[k, 0]:g}, {values[k, 1]:g}; remove or correct it")
    return Track(Positions(values, LAT_LON), _point_times(path, points), path)


def _check_depth(text: str) -> None:
    """Refuse XML that is nested too deeply: gpxpy copies elements by a recursion in C, which would crash the process.

    Raises:
        ValueError: the XML is nested too deeply.
        expat.ExpatError: the text is not XML.
    """
    depth = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise ValueError(f"its elements are nested more than {_DEEPEST} deep")

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.Parse(text, True)


def _point_times(path: Path, points: list[Point]) -> NDArray[np.float64] | None:
    """Times of the points, seconds since 1970, float64 (n,); None if no point has one."""
    times = [point.time for point in points]
    stamps = np.array([np.nan if time is None else _utc(time).timestamp() for time in times], np.float64)
    known = np.isfinite(stamps)
    if not known.any():
        return None
    if not known.all():
        raise InputError(f"{shown(path)}: point {known.argmin() + 1} has no time, but others have; export it again")
    back = np.flatnonzero(np.diff(stamps) < 0)
    if len(back):
        raise InputError(
            f"{shown(path)}: point {back[0] + 2} is earlier than the point before it; keep one track, in its order"
        )
    return stamps


def _utc(time: datetime) -> datetime:
    """``time`` with its zone; without one it is in UTC."""
    return time if time.tzinfo is not None else time.replace(tzinfo=timezone.utc)


def gpx_text(positions: Positions, stamps: NDArray[np.float64]) -> str:
    """A GPX file of one track; degrees to a centimetre, times to a microsecond.

    Args:
        positions: The points, in degrees.
        stamps: Seconds since 1970 of each, float64 (n,).
    """
    segment = GPXTrackSegment(
        [
            GPXTrackPoint(round(lat, 7), round(lon, 7), time=datetime.fromtimestamp(stamp, timezone.utc))
            for (lat, lon), stamp in zip(positions.values.tolist(), stamps.tolist(), strict=True)
        ]
    )
    whole, track = GPX(), GPXTrack()
    track.segments.append(segment)
    whole.tracks.append(track)
    whole.creator = "lava-vpr"
    return whole.to_xml() + "\n"
