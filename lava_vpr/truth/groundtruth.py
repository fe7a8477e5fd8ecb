"""Which place is right for a query: positions with a radius, or a file of index sets, both in absolute indices."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.storage.npy import read_array
from lava_vpr.storage.reading import parse_json
from lava_vpr.storage.tables import csv_rows, file_text, text_lines
from lava_vpr.storage.text import shown

EARTH_RADIUS_M = 6_371_008.8  # mean radius, IUGG

_XY = (("x", "y"), ("easting", "northing"))
_LAT_LON = (("lat", "lon"), ("latitude", "longitude"), ("lat", "lng"))


def _coordinates(path: Path) -> tuple[NDArray[np.float64], bool]:
    """The two coordinate columns of a position file (n, 2), and whether they are latitude and longitude."""
    rows = csv_rows(path)
    columns, geographic = (0, 1), False
    if rows and not all(_is_number(cell) for cell in rows[0][1]):
        line, header = rows[0][0], [cell.lower() for cell in rows[0][1]]
        pairs = [pair for pair in _XY + _LAT_LON if set(pair) <= set(header)]
        if not pairs:
            names = ", ".join(map(brief, header[:8])) + (", ..." if len(header) > 8 else "")
            raise InputError(f"{shown(path)} line {line}: no columns x,y or lat,lon among {names}; name them")
        columns, geographic = (header.index(pairs[0][0]), header.index(pairs[0][1])), pairs[0] in _LAT_LON
        rows = rows[1:]
    elif rows and len(rows[0][1]) != 2:
        raise InputError(f"{shown(path)} line {rows[0][0]}: has {len(rows[0][1])} columns and no header; add one: x,y")
    if not rows:
        raise InputError(f"{shown(path)}: holds no positions; write one row an image, columns x,y or lat,lon")
    out = np.empty((len(rows), 2), dtype=np.float64)
    for k, (line, cells) in enumerate(rows):
        for axis, column in enumerate(columns):
            cell = cells[column] if column < len(cells) else ""
            value = float(cell) if _is_number(cell) else math.nan
            limit = math.inf if not geographic else (90.0, 360.0)[axis]
            if not (math.isfinite(value) and abs(value) <= limit):
                what = ("latitude", "longitude") if geographic else ("x", "y")
                raise InputError(
                    f"{shown(path)} line {line}: {what[axis]} is {brief(cell)}; give a number in its range"
                )
            out[k, axis] = value
    return out, geographic


def _is_number(cell: str) -> bool:
    """Whether the text of a cell reads as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _metres(degrees: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """Equirectangular projection of (latitude, longitude) about ``origin``, same units: (east, north) in metres.

    x = R cos(lat0) (lon - lon0), y = R (lat - lat0); distances within 1 % for routes of 20 km below 60 degrees.
    """
    difference = np.radians((degrees - origin + 180.0) % 360.0 - 180.0)
    return EARTH_RADIUS_M * np.stack([difference[:, 1] * np.cos(np.radians(origin[0])), difference[:, 0]], axis=1)


def read_positions(path: Path) -> NDArray[np.float64]:
    """Positions in metres, float64 (n, 2): row k is where the image with absolute index k was taken.

    A CSV file with columns x,y (or easting,northing) in metres, or lat,lon (latitude,longitude) in degrees, which are
    projected about the first row. Without a header: two columns, x and y.
    Raises:
        InputError: unreadable, no such columns, or a cell that is no finite number in its range; names file and line.
    """
    values, geographic = _coordinates(path)
    return _metres(values, values[0]) if geographic else values


def read_positions_pair(reference: Path, query: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """`read_positions` of references and queries about one common origin: metres, float64 (n, 2) and (m, 2).
    Raises:
        InputError: as `read_positions`; or one file is in metres, the other in degrees.
    """
    (ours, ours_geographic), (theirs, theirs_geographic) = _coordinates(reference), _coordinates(query)
    if ours_geographic != theirs_geographic:
        cause = f"only one of it and {shown(reference)} holds lat,lon"
        raise InputError(f"{shown(query)}: {cause}; give both in the same coordinates")
    return (_metres(ours, ours[0]), _metres(theirs, ours[0])) if ours_geographic else (ours, theirs)


def read_ground_truth(
    path: Path, query_indices: NDArray[np.int64], place_indices: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which places are correct for which query, from a file in absolute indices (those of the whole sequences).

    * .txt, .csv: a line is a query and its places, as ``7: 6 7 8``, ``7,6;7;8`` or ``7,6``; a query may have several
      lines, or none (then no place is correct); # comments and one header line without digits are skipped;
    * .json: ``{"7": [6, 7, 8], "9": 9}``, or a list whose item k is for query k;
    * .npy, integers (n,): entry k is the place of query k, negative for none; (n, 2): rows of query and place;
    * .npy, booleans, or numbers 0 and 1 in at least 3 columns, (n, m): row k for query k, column l for place l.

    Arrays and lists have an entry for every query (and column for every place) of this run, or of the whole sequences.
    Places that are not in this run are left out.
    Args:
        path: The file.
        query_indices: Absolute index of each query of this run, int64 (n_queries,).
        place_indices: Absolute index of each place of this run, int64 (n_places,).
    Returns:
        Boolean (n_queries, n_places).
    Raises:
        InputError: unreadable or malformed (names file and line), or about no query or no place of this run.
    """
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return _truth_of_array(path, query_indices, place_indices)
    if suffix == ".json":
        pairs = _json_truth(path, query_indices)
    elif suffix in (".txt", ".csv"):
        pairs = _text_truth(path)
    else:
        raise InputError(f"{shown(path)}: is no known type of ground truth; give a .txt, .csv, .json or .npy file")
    return _truth_of_sets(path, pairs, query_indices, place_indices)


def _truth_of_sets(
    path: Path, places_of: dict[int, set[int]], query_indices: NDArray[np.int64], place_indices: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """The matrix of {query: places}, checked to be about this run."""
    truth = np.zeros((len(query_indices), len(place_indices)), dtype=np.bool_)
    column = {int(place): k for k, place in enumerate(place_indices)}
    named = [(row, places_of[int(q)]) for row, q in enumerate(query_indices) if int(q) in places_of]
    if not named:
        raise InputError(f"{shown(path)}: names no query of this run ({_span(query_indices)}); use absolute indices")
    for row, places in named:
        truth[row, [column[place] for place in places if place in column]] = True
    if not truth.any() and any(places for _, places in named):
        raise InputError(f"{shown(path)}: names no place of this run ({_span(place_indices)}); use absolute indices")
    return truth


def _span(indices: NDArray[np.int64]) -> str:
    return f"{indices.min()}..{indices.max()}" if len(indices) else "it is empty"


def _text_truth(path: Path) -> dict[int, set[int]]:
    """Correct places by query, from a text file."""
    places_of: dict[int, set[int]] = {}
    lines = [(number, line.split("#")[0]) for number, line in enumerate(text_lines(path), start=1)]
    lines = [(number, line) for number, line in lines if line.strip()]
    if lines and not any(c.isdigit() for c in lines[0][1]):
        lines = lines[1:]  # a header
    for number, line in lines:
        words = line.replace(",", " ").replace(";", " ").replace(":", " ").split()
        wrong = [word for word in words if not _is_index(word)]
        if wrong or not words:
            what = brief(wrong[0] if wrong else line)
            raise InputError(f"{shown(path)} line {number}: {what} is no index; write lines such as 7: 6 7 8")
        places_of.setdefault(int(words[0]), set()).update(map(int, words[1:]))
    if not places_of:
        raise InputError(f"{shown(path)}: holds no ground truth; write lines such as 7: 6 7 8")
    return places_of


def _is_index(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= 18


def _json_truth(path: Path, query_indices: NDArray[np.int64]) -> dict[int, set[int]]:
    """Correct places by query, from a JSON file."""
    try:
        # Pairs, since a repeated key would silently replace the one before it.
        content = parse_json(file_text(path), object_pairs_hook=lambda pairs: {"pairs": pairs})
    except ValueError as error:
        at = (f" line {error.lineno}", error.msg) if isinstance(error, json.JSONDecodeError) else ("", str(error))
        raise InputError(f"{shown(path)}{at[0]}: is not JSON ({at[1]}); correct it") from None
    if isinstance(content, dict):
        entries = content["pairs"]
    elif isinstance(content, list):
        entries = list(zip(map(str, _row_queries(path, len(content), query_indices)), content, strict=True))
    else:
        raise InputError(f'{shown(path)}: holds a single value; write {{"7": [6, 7, 8]}} or a list of lists')
    places_of: dict[int, set[int]] = {}
    for key, value in entries:
        places = value if isinstance(value, list) else [value]
        if not _is_index(key):
            raise InputError(f"{shown(path)}: key {brief(key)} is no index of a query; use whole numbers from 0")
        if not all(type(place) is int and place >= 0 for place in places):
            raise InputError(
                f"{shown(path)}: query {brief(int(key))} has a place that is no index; use whole numbers from 0"
            )
        places_of.setdefault(int(key), set()).update(places)
    return places_of


def _row_queries(path: Path, rows: int, indices: NDArray[np.int64], what: str = "queries") -> NDArray[np.int64]:
    """The absolute index of each row: those of the run if it has as many, else of the whole sequence."""
    if rows == len(indices):
        return indices
    if len(indices) and rows > indices.max():
        return np.arange(rows, dtype=np.int64)
    raise InputError(
        f"{shown(path)}: has {rows} entries for {len(indices)} {what} ({_span(indices)}); "
        "give one for each of this run, or of the whole sequence"
    )


def _truth_of_array(
    path: Path, query_indices: NDArray[np.int64], place_indices: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """The matrix of a NumPy file of any of the three shapes."""
    wants = "integers (n,), rows of query and place (n, 2), or booleans (queries, places)"
    array = read_array(path, f"save {wants}")
    whole = array.dtype.kind in "iu"
    if array.ndim == 1 and whole:
        rows = _row_queries(path, len(array), query_indices)
        sets = {int(q): {int(place)} if place >= 0 else set() for q, place in zip(rows, array, strict=True)}
        return _truth_of_sets(path, sets, query_indices, place_indices)
    if array.ndim == 2 and array.shape[1] == 2 and whole:
        pairs: dict[int, set[int]] = {}
        for q, place in array:
            pairs.setdefault(int(q), set()).add(int(place))
        return _truth_of_sets(path, pairs, query_indices, place_indices)
    if array.ndim != 2 or not np.isin(array, (0, 1)).all():
        raise InputError(f"{shown(path)}: holds {array.dtype} {array.shape}; save {wants}")
    rows = _row_queries(path, array.shape[0], query_indices)
    columns = _row_queries(path, array.shape[1], place_indices, "places")
    named = array.astype(np.bool_)
    sets = {int(q): set(columns[row].tolist()) for q, row in zip(rows, named, strict=True)}
    return _truth_of_sets(path, sets, query_indices, place_indices)
