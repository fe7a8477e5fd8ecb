"""Lists of images, ground truths and positions: read a second time, by the plain words of the manual.

Used by storage and support.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from support.fuzz.soundness.parsing import array_of
from support.fuzz.soundness.rules import Findings

COLUMNS = ("image", "file", "filename", "path", "name")
Rows = list[list[str]]


def check_list(path: Path, taken: list[str], findings: Findings) -> Findings:
    """L1 and L2 of a list, whose reader returned the paths ``taken``."""
    text = _text(path, findings)
    if path.suffix == ".csv":
        rows = _rows(text, findings)
        header = [cell.lower() for cell in rows[0]] if rows else []
        named = next((name for name in COLUMNS if name in header), None)
        findings.need(named is None or header.count(named) == 1, "L2", f"column {named} twice")
        column = 0 if named is None else header.index(named)
        entries = [row[column] for row in rows[0 if named is None else 1 :]]
    else:
        lines = [line.strip(" \t") for line in _lines(text)]
        entries = [line for line in lines if line and not line.startswith("#")]
    findings.need(not any("\0" in entry or not entry for entry in entries), "L1", "a name that is none")
    findings.need(taken == [str(path.parent / entry) for entry in entries], "L1", "other files")
    findings.need(taken and all(os.path.isfile(file) for file in taken), "L1", "names that are no files")
    return findings


def _text(path: Path, findings: Findings) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        findings.need(False, "L1", "no UTF-8")
        return ""


def _lines(text: str) -> list[str]:
    """The lines of ``text``, which end with a line feed, a carriage return, or both."""
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _rows(text: str, findings: Findings) -> Rows:
    """Rows of stripped cells, without blank and commented ones, equally wide (L2)."""
    first = next((line for line in _lines(text) if line.strip() and not line.startswith("#")), "")
    unquoted = re.sub('"[^"]*"', "", first)
    separator = next((s for s in ";\t" if s in unquoted), ",")
    try:
        read = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True))
    except csv.Error as error:
        findings.need(False, "L2", f"no CSV ({error})")
        return []
    found = [[cell.strip(" \t") for cell in row] for row in read]
    rows = [row for row in found if (len(row) > 1 or any(row)) and not row[0].startswith("#")]
    while rows and not any(rows[-1]):
        rows.pop()
    findings.need(len({len(row) for row in rows}) <= 1, "L2", f"rows of {sorted({len(row) for row in rows})[:5]} cells")
    return [] if findings else rows


def check_positions(path: Path, taken: NDArray[np.float64], findings: Findings) -> Findings:
    """L2 and L4 of positions, of which the reader returned ``taken``."""
    rows = _rows(_text(path, findings), findings)
    if findings:
        return findings
    header = [cell.lower() for cell in rows[0]] if rows else []
    plain = all(_number(cell) for cell in header)
    pairs = [("x", "y"), ("easting", "northing"), ("lat", "lon"), ("latitude", "longitude"), ("lat", "lng")]
    columns, degrees = (0, 1), False
    if not plain:
        pair = next((pair for pair in pairs if set(pair) <= set(header)), None)
        if not findings.need(pair is not None, "L4", "no columns") or pair is None:
            return findings
        columns, degrees = (header.index(pair[0]), header.index(pair[1])), pair in pairs[2:]
        findings.need(all(header.count(name) == 1 for name in pair), "L2", f"{pair} twice")
        rows = rows[1:]
    cells = [[row[column] for column in columns] for row in rows]
    good = all(_number(cell) and math.isfinite(float(cell)) for pair in cells for cell in pair)
    if not findings.need(good and taken.shape == (len(rows), 2), "L4", "other rows, or numbers that are none"):
        return findings
    findings.need(bool(np.isfinite(taken).all()), "L4", "positions that are not finite")
    said = np.array(cells, np.float64).reshape(-1, 2)
    findings.need(np.array_equal(said, taken), "L4", "other numbers")
    most = (90, 360) if degrees else (2**53, 2**53)
    findings.need(bool((np.abs(said) <= most).all()), "L4", "coordinates beyond the earth")
    return findings


def check_gpx(path: Path, taken: NDArray[np.float64], findings: Findings) -> Findings:
    """L4 of a GPX file, of which the reader returned ``taken``: its points in their order, all of one kind."""
    try:
        points = [node for node in ElementTree.fromstring(_text(path, findings)).iter() if "lat" in node.attrib]
    except ElementTree.ParseError:
        findings.need(False, "L4", "no XML")
        return findings
    said = [(node.tag, float(node.attrib["lat"]), float(node.attrib["lon"])) for node in points]
    found = [[pair[1:] for pair in said if pair[0] == tag] for tag in ("trkpt", "rtept", "wpt")]
    findings.need([tuple(row) for row in taken.tolist()] in found, "L4", "other points")
    findings.need(bool((np.abs(taken) <= (90, 360)).all()), "L4", "degrees beyond the earth")
    return findings


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def check_truth(path: Path, taken: NDArray[np.bool_], findings: Findings) -> Findings:
    """L3 of a ground truth of equally many queries and places, from 0, of which the reader returned ``taken``."""
    queries, places = taken.shape
    named = _truth_sets(path, queries, findings)
    expected = np.zeros(taken.shape, bool)
    for query, near in named:
        if 0 <= query < queries:
            for place in near:
                if 0 <= place < places:
                    expected[query, place] = True
    findings.need(taken.dtype == np.bool_ and np.array_equal(expected, taken), "L3", "other places than the file names")
    findings.need(any(0 <= query < queries for query, _ in named), "L3", "no query of this run")
    return findings


def _truth_sets(path: Path, queries: int, findings: Findings) -> list[tuple[int, list[int]]]:
    """Every query that a truth names, with its places."""
    if path.suffix == ".npy":
        array = array_of(path.read_bytes(), findings, path.name)
        if array is None:
            return []
        if array.ndim == 1:
            return [(k, [int(place)]) for k, place in enumerate(array)]
        if array.shape[1] == 2 and array.dtype.kind in "iu":
            return [(int(query), [int(place)]) for query, place in array]
        return [(k, np.flatnonzero(row).tolist()) for k, row in enumerate(array)]
    text = _text(path, findings)
    if path.suffix == ".json":
        pairs: Any = json.loads(text, object_pairs_hook=list)
        if not isinstance(pairs, list):
            return []
        if text.lstrip()[:1] == "[":
            pairs = enumerate(pairs)
        return [(int(key), value if isinstance(value, list) else [value]) for key, value in pairs]
    lines = [line.split("#")[0] for line in _lines(text)]
    lines = [line for line in lines if line.strip()]
    if lines and not any(c.isdigit() for c in lines[0]):
        lines = lines[1:]
    words = [line.replace(",", " ").replace(";", " ").replace(":", " ").split() for line in lines]
    try:
        return [(int(first), [int(word) for word in rest]) for first, *rest in words]
    except ValueError:
        findings.need(False, "L3", "words that are no indices")
        return []
