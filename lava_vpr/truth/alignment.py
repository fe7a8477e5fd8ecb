"""Which images of a query traverse are answered, and which place each of them shows: by order, by position, or by a
file of index sets, in absolute indices.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief, shown
from lava_vpr.matching.evaluation import truth_from_indices, truth_from_positions
from lava_vpr.model import Model
from lava_vpr.positions.frames import Positions, distances
from lava_vpr.positions.track import read_track, rows_of
from lava_vpr.storage.arrays import note_zeros, read_array
from lava_vpr.storage.reading import parse_json
from lava_vpr.storage.tables import file_text, text_lines
from lava_vpr.traverse import Traverse

_NOTES = logging.getLogger("lava_vpr")


def by_number(model: Model, indices: NDArray[np.int64]) -> bool:
    """Whether all queries' absolute ``indices`` are those of places, so that equal indices are the same place."""
    return bool(np.isin(indices, model.place_indices).all())


def _contiguous(model: Model) -> bool:
    """Whether every image between a model's first and last place is a place, too."""
    indices = model.place_indices
    return int(indices.max() - indices.min()) + 1 == model.places


def choose_queries(model: Model, whole: Traverse, places: tuple[int, int] | None, *, aligned: bool) -> Traverse:
    """The queries to answer: ``places``; else the model's own range of as many images as its route had; else all.

    Of a model whose places are some images of its route only, and of as many queries, it is those with the places'
    indices.

    Args:
        model: The model that answers.
        whole: All query images.
        places: Range that the user asked for.
        aligned: No ground truth is given: the traverses must show the same places in the same order.
    Raises:
        InputError: the range exceeds the images, or nothing says which query belongs to which place.
    """
    thinned = aligned and len(whole) == model.route_images and not _contiguous(model)
    if thinned:  # the images between the places show none of their own
        wanted = range(*places) if places is not None else range(len(whole))
        chosen = whole.take(i for i in np.sort(model.place_indices).tolist() if i in wanted)
        if len(chosen):
            return chosen
    if places is not None:
        chosen = whole.between(*places)
        known = np.isin(chosen.indices, model.place_indices)
        if aligned and known.any() and not known.all() and len(whole) == model.route_images:
            raise InputError(
                f"{shown(whole.source)}: --places {places[0]}:{places[1]} are partly places of the model and "
                f"partly not; stay within {model.place_indices.min()}:{model.place_indices.max() + 1}, or give --gt or "
                "--positions"
            )
        if aligned and len(chosen) != model.places and not known.all():
            raise InputError(
                f"{shown(whole.source)}: --places {places[0]}:{places[1]} are {len(chosen)} queries for {model.places} "
                "other places; take as many, or say with --gt or --positions which place each query shows"
            )
        return chosen
    if not aligned and len(whole) != model.route_images:
        return whole
    if len(whole) != model.route_images:
        queries = "1 query" if len(whole) == 1 else f"{len(whole)} queries"
        fewer = f" (places of the map: {model.places})" if model.places < model.route_images else ""
        raise InputError(
            f"{shown(whole.source)}: has {queries}, the references {model.route_images}{fewer}: nothing says which "
            "place a query shows; give --gt FILE, or --places A:B, or positions: train with --positions FILE|exif, "
            "then --query-positions FILE|exif; the command query needs none of these"
        )
    return whole.between(int(model.place_indices.min()), int(model.place_indices.max()) + 1)


def aligned_truth(
    model: Model, queries: Traverse, tolerance: int = 0, among: NDArray[np.int64] | None = None
) -> NDArray[np.bool_]:
    """Ground truth of traverses in step, bool (queries, places): by absolute index, or else by order.

    Args:
        model: The model that answers.
        queries: The queries.
        tolerance: Number of places by which a match may be off and still be correct.
        among: Absolute indices of what `choose_queries` chose, as many as the model's places, or some of them
            (`by_number`), in increasing order; None: all of them are queries.
    """
    among = queries.indices if among is None else among
    if by_number(model, among):
        return truth_from_indices(queries.indices, model.place_indices, tolerance)
    return truth_from_indices(np.searchsorted(among, queries.indices), np.arange(model.places), tolerance)


def shown_places(model: Model, queries: Traverse, gt: Path | None = None) -> NDArray[np.int64]:
    """The place that each query shows, -1 for none, int64 (queries,): by ``gt``, or because its file is called so.

    Args:
        model: A model.
        queries: Images.
        gt: A file as `read_ground_truth` takes it; the first correct place counts.
    Raises:
        InputError: the file cannot be used, or no image file is called as one of a place.
    """
    if gt is not None:
        truth = read_ground_truth(gt, queries.indices, model.place_indices)
        return np.where(truth.any(axis=1), truth.argmax(axis=1), -1)
    places = {name: place for place, name in enumerate(model.place_names)} if queries.frames is None else {}
    found = np.array([places.get(name, -1) for name in queries.names], np.int64)
    if (found < 0).all():
        raise InputError(
            f"{shown(queries.source)}: no image is called as one of the map's places; say with --gt FILE which place "
            "each shows"
        )
    return found


NEAR_M = 25.0
"""Metres within which two images show the same place, unless a user says otherwise: the field's usual radius
(VPR-methods-evaluation, ``positive_dist_threshold``)."""


class Located(NamedTuple):
    """Where a model's places and some queries were taken, in one frame.

    Attributes:
        places: Of each place.
        queries: Of each query.
    """

    places: Positions
    queries: Positions

    @classmethod
    def of(cls, places: Positions, queries: Positions, source: str) -> Located:
        """Both in the frame of the places.

        Args:
            places, queries: Positions in any frames.
            source: Where the queries' are from, for the message.
        Raises:
            InputError: their frames cannot be compared.
        """
        try:
            return cls(places, queries.to(places.frame))
        except InputError as error:
            raise InputError(f"{shown(source)}: {error}") from None

    def truth(self, radius: float) -> NDArray[np.bool_]:
        """Which places are within ``radius`` metres of each query, bool (queries, places)."""
        return truth_from_positions(self.places.points(), self.queries.points(), radius)

    def errors(self, matches: NDArray[np.int64]) -> NDArray[np.float64]:
        """Metres from each query to the place that it was matched with, float64 (n,); NaN without a match.

        Args:
            matches: Place of each of the first n queries, -1 for none, int64 (n,).
        """
        metres = distances(self.queries.take(slice(len(matches))), self.places.take(matches))
        return np.where(matches >= 0, metres, np.nan)


@dataclass(frozen=True)
class PositionErrors:
    """How far from their true positions queries were placed.

    Attributes:
        located: Where places and queries were taken.
        metres: From each query to its match, float64 (n,); NaN without a match.
        near: Metres within which a match counts.
    """

    located: Located
    metres: NDArray[np.float64]
    near: float

    def quantile(self, share: float) -> float:
        """Metres that a ``share`` of the matched queries does not exceed; NaN if none was matched."""
        known = self.metres[np.isfinite(self.metres)]
        return float(np.quantile(known, share)) if len(known) else math.nan

    @property
    def within(self) -> float:
        """The share of all queries that were matched within ``near``."""
        return float((self.metres <= self.near).mean())

    def in_words(self) -> str:
        """The figures as a sentence."""
        matched = int(np.isfinite(self.metres).sum())
        if not matched:
            return "metres of error: no query was matched"
        return (
            f"metres of error: median {self.quantile(0.5):.1f}, 90 % up to {self.quantile(0.9):.1f} (of {matched} "
            f"matched); {100 * self.within:.1f} % of {len(self.metres)} within {self.near:g} m"
        )

    def as_json(self) -> dict[str, float | int | None]:
        """The figures; None where nothing was matched."""
        values = {"median_m": self.quantile(0.5), "p90_m": self.quantile(0.9)}
        figures: dict[str, float | int | None] = {k: None if math.isnan(v) else v for k, v in values.items()}
        return {**figures, "within": self.within, "radius_m": self.near, "matched": int((self.metres >= 0).sum())}


def located_by(model: Model, queries: Traverse, files: tuple[Path, Path]) -> Located:
    """Positions of all images of both traverses, from files with a row for each.

    Args:
        model: The model that answers.
        queries: The queries.
        files: Positions of the reference and of the query images; row k is the image with absolute index k.
    Raises:
        InputError: a file cannot be used, or lacks an image's position.
    """
    places, shown_at = (read_track(path) for path in files)
    return Located.of(
        rows_of(places, model.place_indices), rows_of(shown_at, queries.indices), f"{files[1]}, {files[0]}"
    )


def read_ground_truth(
    path: Path, query_indices: NDArray[np.int64], place_indices: NDArray[np.int64], tolerance: int = 0
) -> NDArray[np.bool_]:
    """Which places are correct for which query, from a file in absolute indices (those of the whole sequences).

    * .txt, .csv: a line is a query and its places, as ``7: 6 7 8``, ``7,6;7;8`` or ``7,6``; a query may have several
      lines, or none (then no place is correct); # comments and one header line without digits are skipped;
    * .json: ``{"7": [6, 7, 8], "9": 9}``, or a list whose item k is for query k;
    * .npy, integers (n,): entry k is the place of query k, negative for none; (n, 2): rows of query and place;
    * .npy, booleans, or numbers 0 and 1 in at least 3 columns, (n, m): row k for query k, column l for place l; or the
      other way round, which is recognised where only that fits the numbers of queries and places, and told.

    Arrays and lists have an entry for every query (and column for every place) of this run, or of the whole sequences.
    Places that are not in this run are left out.
    Args:
        path: The file.
        query_indices: Absolute index of each query of this run, int64 (n_queries,).
        place_indices: Absolute index of each place of this run, int64 (n_places,).
        tolerance: How far a place may be off a correct one, by index, and is correct, too.
    Returns:
        Boolean (n_queries, n_places).
    Raises:
        InputError: unreadable or malformed (names file and line), or about no query or no place of this run.
    """
    suffix = path.suffix.lower()
    if suffix == ".npy":
        entries = _array_entries(path, query_indices, place_indices)
    elif suffix == ".json":
        entries = _json_entries(path, query_indices)
    elif suffix in (".txt", ".csv"):
        entries = _text_entries(path)
    else:
        raise InputError(f"{shown(path)}: is no known type of ground truth; give a .txt, .csv, .json or .npy file")
    places_of: dict[int, set[int]] = {}
    for query, places in entries:
        places_of.setdefault(query, set()).update(places)
    return _truth_of_sets(path, places_of, query_indices, place_indices, tolerance)


Entries = Iterable[tuple[int, Iterable[int]]]
"""Queries and places that are correct for them; a query may come several times."""


def _truth_of_sets(
    path: Path,
    places_of: dict[int, set[int]],
    query_indices: NDArray[np.int64],
    place_indices: NDArray[np.int64],
    tolerance: int,
) -> NDArray[np.bool_]:
    """The matrix of {query: places}, and of places at most ``tolerance`` off, checked to be about this run."""
    truth = np.zeros((len(query_indices), len(place_indices)), dtype=np.bool_)
    named = [(row, places_of[int(q)]) for row, q in enumerate(query_indices) if int(q) in places_of]
    if not named:
        raise InputError(f"{shown(path)}: names no query of this run ({_span(query_indices)}); use absolute indices")
    for row, places in named:
        ends = np.array([-math.inf, *sorted(places), math.inf])
        after = np.searchsorted(ends, place_indices)
        truth[row] = np.minimum(place_indices - ends[after - 1], ends[after] - place_indices) <= tolerance
    if not truth.any() and any(places for _, places in named):
        raise InputError(f"{shown(path)}: names no place of this run ({_span(place_indices)}); use absolute indices")
    return truth


def _span(indices: NDArray[np.int64]) -> str:
    return f"{indices.min()}..{indices.max()}" if len(indices) else "it is empty"


def _text_entries(path: Path) -> Entries:
    """Queries and their places, from a text file."""
    lines = [(number, line.split("#")[0]) for number, line in enumerate(text_lines(path), start=1)]
    lines = [(number, line) for number, line in lines if line.strip()]
    if lines and not any(c.isdigit() for c in lines[0][1]):
        lines = lines[1:]  # a header
    if not lines:
        raise InputError(f"{shown(path)}: holds no ground truth; write lines such as 7: 6 7 8")
    for number, line in lines:
        words = line.replace(",", " ").replace(";", " ").replace(":", " ").split()
        wrong = [word for word in words if not _is_index(word)]
        if wrong or not words:
            what = brief(wrong[0] if wrong else line)
            raise InputError(f"{shown(path)} line {number}: {what} is no index; write lines such as 7: 6 7 8")
        yield int(words[0]), map(int, words[1:])


def _is_index(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= 18


def _json_entries(path: Path, query_indices: NDArray[np.int64]) -> Entries:
    """Queries and their places, from a JSON file."""
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
    for key, value in entries:
        places = value if isinstance(value, list) else [value]
        if not _is_index(key):
            raise InputError(f"{shown(path)}: key {brief(key)} is no index of a query; use whole numbers from 0")
        if not all(type(place) is int and place >= 0 for place in places):
            raise InputError(
                f"{shown(path)}: query {brief(int(key))} has a place that is no index; use whole numbers from 0"
            )
        yield int(key), places


def _fits(rows: int, indices: NDArray[np.int64]) -> bool:
    """Whether there are as many rows as ``indices`` of the run, or as many as the whole sequence has at least."""
    return rows == len(indices) or (len(indices) > 0 and rows > int(indices.max()))


def _row_queries(path: Path, rows: int, indices: NDArray[np.int64], what: str = "queries") -> NDArray[np.int64]:
    """The absolute index of each row: those of the run if it has as many, else of the whole sequence."""
    if not _fits(rows, indices):
        raise InputError(
            f"{shown(path)}: has {rows} entries for {len(indices)} {what} ({_span(indices)}); "
            "give one for each of this run, or of the whole sequence"
        )
    return indices if rows == len(indices) else np.arange(rows, dtype=np.int64)


def _array_entries(path: Path, query_indices: NDArray[np.int64], place_indices: NDArray[np.int64]) -> Entries:
    """Queries and their places, from a NumPy file of any of the three shapes."""
    wants = "integers (n,), rows of query and place (n, 2), or booleans (queries, places)"
    array = read_array(path, f"save {wants}")
    whole = array.dtype.kind in "iu"
    if whole and (array.ndim == 1 or array.shape[1:] == (2,)):  # the last rows of a matrix may well have no place
        note_zeros(array, shown(path))
    if array.ndim == 1 and whole:
        queries = _row_queries(path, len(array), query_indices).tolist()
        return zip(queries, ([place] if place >= 0 else [] for place in array.tolist()), strict=True)
    if array.ndim == 2 and array.shape[1] == 2 and whole:
        return ((int(query), [int(place)]) for query, place in array)
    if array.ndim != 2 or not np.isin(array, (0, 1)).all():
        raise InputError(f"{shown(path)}: holds {array.dtype} {array.shape}; save {wants}")
    ways = ((query_indices, place_indices), (place_indices, query_indices))
    straight, turned = (all(map(_fits, array.shape, way)) for way in ways)
    if turned and not straight:
        _NOTES.warning(f"{shown(path)}: has a row for each place and a column for each query, and is read so")
        array = array.T
    queries = _row_queries(path, array.shape[0], query_indices).tolist()
    columns = _row_queries(path, array.shape[1], place_indices, "places")
    return zip(queries, (columns[row].tolist() for row in array.astype(np.bool_)), strict=True)
