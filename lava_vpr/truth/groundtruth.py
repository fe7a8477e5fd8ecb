"""Which place is right for a query, from a file of index sets, in absolute indices."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.storage.arrays import read_array
from lava_vpr.storage.reading import parse_json
from lava_vpr.storage.tables import file_text, text_lines
from lava_vpr.storage.text import shown


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
