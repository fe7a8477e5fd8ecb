"""Ground truth files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.common.imagefiles import QUICK, refused, written

from lava_vpr.truth.groundtruth import read_ground_truth

# ---------------------------------------------------------------- ground truth

QUERIES, PLACES = np.array([10, 11, 12], dtype=np.int64), np.array([20, 21, 22, 23], dtype=np.int64)
#: Query 10 is at 20 and 21, query 11 nowhere, query 12 at 23.
TRUTH = np.array([[1, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("t.txt", "# truth\n10: 20 21\n11:\n12: 23 99\n"),
        ("t.txt", "12 23\n10 21 # not 22\n10 20\n5 1\n"),
        ("t.csv", "query,places\n10,20;21\n12,23\n"),
        ("t.csv", "10,20,21\r\n11\r\n12,23\r\n"),
        ("t.json", '{"10": [20, 21], "11": [], "12": 23, "77": [1]}'),
        ("t.json", '{"10": [20], "10": 21, "12": [23]}'),
        ("t.json", "[[20, 21], [], [23, 5]]"),
        ("t.json", json.dumps([[]] * 10 + [[20, 21], [], 23])),
    ],
)
def test_ground_truth_as_text(tmp_path: Path, name: str, text: str) -> None:
    got = read_ground_truth(written(tmp_path / name, text.encode()), QUERIES, PLACES)
    assert got.dtype == np.bool_
    np.testing.assert_array_equal(got, TRUTH)


def _wide() -> NDArray[np.bool_]:
    wide = np.zeros((13, 24), dtype=bool)
    wide[10:13, 20:24] = TRUTH
    wide[3, 3] = True
    return wide


@pytest.mark.parametrize(
    "array",
    [
        np.array([[10, 20], [12, 23], [10, 21], [3, 4]]),
        np.array([[12, 23], [10, 20], [10, 21]], dtype=np.uint16),
        TRUTH,
        TRUTH.astype(np.uint8),
        TRUTH.astype(np.float64),
        _wide(),
        _wide()[:, :24].astype(np.int64),
    ],
)
def test_ground_truth_as_array(tmp_path: Path, array: NDArray[np.generic]) -> None:
    np.save(tmp_path / "t.npy", array)
    np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), TRUTH)


def test_ground_truth_as_one_place_a_query(tmp_path: Path) -> None:
    expected = np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)
    for array in ([21, -1, 23], [0] * 10 + [21, -1, 23, 7]):
        np.save(tmp_path / "t.npy", np.array(array))
        np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), expected)


@QUICK
@given(st.lists(st.lists(st.integers(0, 30), max_size=4), min_size=1, max_size=8), st.integers(0, 20))
def test_all_formats_say_the_same(tmp_path_factory: pytest.TempPathFactory, sets: list[list[int]], offset: int) -> None:
    base = tmp_path_factory.mktemp("t")
    queries = np.arange(offset, offset + len(sets), dtype=np.int64)
    places = np.arange(31, dtype=np.int64)
    literal = np.array([[int(p) in places_of for p in places] for places_of in sets])
    text = "".join(f"{q}: {' '.join(map(str, s))}\n" for q, s in zip(queries, sets, strict=True))
    mapping = {str(q): s for q, s in zip(queries, sets, strict=True)}
    written(base / "a.txt", text.encode())
    written(base / "a.csv", text.replace(": ", ",").replace(" ", ";").encode())
    written(base / "a.json", json.dumps(mapping).encode())
    written(base / "b.json", json.dumps(sets).encode())
    np.save(base / "a.npy", literal)
    for name in ("a.txt", "a.csv", "a.json", "b.json", "a.npy"):
        np.testing.assert_array_equal(read_ground_truth(base / name, queries, places), literal)


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("t.txt", "", ["t.txt: holds no ground truth; write lines such as 7: 6 7 8"]),
        ("t.txt", "10: 20\n11: x\n", ["t.txt line 2: 'x' is no index"]),
        ("t.txt", "10: 20\n\n11: -4\n", ["t.txt line 3: '-4' is no index"]),
        ("t.txt", "10: 20.5\n", ["t.txt line 1: '20.5' is no index"]),
        ("t.csv", "q,p\nq,p\n10,20\n", ["t.csv line 2: 'q' is no index"]),
        ("t.txt", "10: 20\n,;\n", ["t.txt line 2: ',;' is no index"]),
        ("t.txt", "10: " + "9" * 5000, ["t.txt line 1"]),
        ("t.txt", "0: 20\n1: 21\n", ["t.txt: names no query of this run (10..12); use absolute indices"]),
        ("t.txt", "10: 1\n11: 2\n", ["t.txt: names no place of this run (20..23); use absolute indices"]),
        ("t.json", '{"10": [20],\n "11": ]}', ["t.json line 2: is not JSON"]),
        ("t.json", "3", ["t.json: holds a single value; write"]),
        ("t.json", '{"ten": [20]}', ["t.json: key 'ten' is no index of a query"]),
        ("t.json", '{"10": [20.0]}', ["t.json: query 10 has a place that is no index"]),
        ("t.json", '{"10": [true]}', ["t.json: query 10 has a place that is no index"]),
        ("t.json", '{"10": {"20": 1}}', ["t.json: query 10 has a place"]),
        ("t.json", "[[20], [21]]", ["t.json: has 2 entries for 3 queries (10..12); give one for each of this run"]),
        ("t.json", "[" * 100_000, ["t.json: is not JSON"]),
        ("t.npy", "not numpy", ["t.npy: is no array of numbers", "; save integers (n,)"]),
        ("t.mat", "", ["t.mat: is no known type of ground truth; give a .txt, .csv, .json or .npy file"]),
    ],
)
def test_ground_truth_that_cannot_be_used(tmp_path: Path, name: str, text: str, parts: list[str]) -> None:
    path = written(tmp_path / name, text.encode())
    refused(lambda: read_ground_truth(path, QUERIES, PLACES), *parts)


@pytest.mark.parametrize(
    ("array", "part"),
    [
        (np.array([{"a": 1}], dtype=object), "is no array of numbers"),
        (np.array(["a"]), "is no array of numbers"),
        (np.zeros((2, 2, 2)), "holds float64 (2, 2, 2)"),
        (np.arange(3.0), "holds float64 (3,)"),
        (np.full((3, 4), 2), "holds int64 (3, 4)"),
        (np.zeros((4, 3), dtype=bool), "has 4 entries for 3 queries"),
        (np.zeros((3, 5), dtype=bool), "has 5 entries for 4 places (20..23)"),
        (np.array([1, 2]), "has 2 entries for 3 queries"),
    ],
)
def test_arrays_that_are_no_ground_truth(tmp_path: Path, array: NDArray[np.generic], part: str) -> None:
    np.save(tmp_path / "t.npy", array, allow_pickle=True)
    refused(lambda: read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), "t.npy: ", part)


@pytest.mark.parametrize("spoilt", ["{", "(", ",)", "'<i8'"])
def test_a_damaged_array_header_is_refused(tmp_path: Path, spoilt: str) -> None:
    np.save(tmp_path / "t.npy", QUERIES)
    data = (tmp_path / "t.npy").read_bytes()
    assert spoilt.encode() in data
    path = written(tmp_path / "t.npy", data.replace(spoilt.encode(), b" " * len(spoilt), 1))
    refused(lambda: read_ground_truth(path, QUERIES, PLACES), "t.npy: is no array of numbers")


def test_queries_without_any_place_are_allowed(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", b"10:\n11:\n")
    assert not read_ground_truth(path, QUERIES, PLACES).any()
    np.save(tmp_path / "t.npy", np.array([-1, -1, -1]))
    assert not read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES).any()
    refused(lambda: read_ground_truth(tmp_path / "no.npy", QUERIES, PLACES), "no.npy: cannot be read (No such file")
    refused(lambda: read_ground_truth(tmp_path / "no.txt", QUERIES, PLACES), "no.txt: cannot be read (No such file")
