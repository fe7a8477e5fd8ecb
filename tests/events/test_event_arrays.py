"""Events in .npz files: tables and arrays of every type of number are read, and what is none is told in one line."""

from __future__ import annotations

import struct
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.eventfiles import made, read, refused
from support.fuzz.changes import zipped

from lava_vpr.events.files import is_events

EVENTS = made()


def test_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    for name, value, words in (
        ("t", np.nan, "time nan"),
        ("t", np.inf, "time inf"),
        ("x", 1.5, "column 1.5"),
        ("y", np.nan, "row nan"),
    ):
        parts = {"t": EVENTS.t / 1e6, "x": EVENTS.x / 1.0, "y": EVENTS.y / 1.0}
        parts[name][7] = value
        np.savez(path, **parts)
        refused(path, f"event 7 has the {words}")
    np.savez(path, t=EVENTS.t, x=EVENTS.x[:-1], y=EVENTS.y)
    refused(path, "3000 times, 2999 columns, 3000 rows; give as many of each")


def test_pickled_objects_are_never_made(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, t=np.array([Trap()], object), x=np.array([1]), y=np.array([1]))
    assert not is_events(path)
    refused(path, "holds no events")


class Trap:
    """What would tell that it was made."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (pytest.fail, ("a pickle was loaded",))


def test_times_that_overflow_are_refused_without_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    signalling = np.array([0, 0x7FF0000000000001]).view(np.float64)
    for times, said in (([0.0, 1e306], "1e+306"), (signalling, "nan")):
        np.savez(path, t=times, x=[0, 1], y=[0, 1])
        refused(path, f"event 1 has the time {said}")


def test_an_archive_within_an_archive_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for k in range(1001):
            archive.writestr(f"a{k}.npy", b"")
    refused(path, "1,001 entries, more than 1,000")


@pytest.mark.parametrize(
    "header",
    [
        *("{'descr': '<i8', 'shape': (3,", "(" * 4000, "[" * 4000, "-" * 9000 + "1", "{'descr': '<q9'}", "\0\n", "1L"),
        "{'descr': '<04', 'fortran_order': False, 'shape': (3,)}",
        "{'descr': '<i8', b'fortran_order': False, 'shape': (3,)}",
    ],
)
def test_a_header_that_is_cut_or_nested_is_refused(header: str, tmp_path: Path) -> None:
    """The checksum would come after it."""
    text = f"{header}\n".encode()
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("t.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
    refused(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("descr", "shape"),
    [("'<i8'", "(2, )"), ("'<i8'", "(4, )"), ("[('t', '<i8'), ('x', '<i8'), ('y', '<i8')]", "(2, )")],
)
def test_an_array_shorter_or_longer_than_its_header_says_is_refused(descr: str, shape: str, tmp_path: Path) -> None:
    """The checksum of what is left over would never be asked for."""
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(24 * descr.count("i8"))
    (tmp_path / "a.npz").write_bytes(zipped([(f"{name}.npy", member) for name in ("events", "t", "x", "y")]))
    refused(tmp_path / "a.npz", "events is not as long as its header says")


@pytest.mark.parametrize(
    "kind", [[("x", ">i4"), ("y", "<u2"), ("t", "<f8"), ("p", "|b1"), ("more", "<i2", (3,))], None]
)
def test_tables_of_every_type_of_number_are_read(kind: Any, tmp_path: Path) -> None:
    """With the gaps of a C compiler, too; arrays of their own may be of the other order of bytes."""
    padded = np.dtype([("x", "<i2"), ("y", "<i2"), ("t", "<i8")], align=True)
    table = np.zeros(len(EVENTS.t), np.dtype(kind or padded))
    table["x"], table["y"], table["t"] = EVENTS.x, EVENTS.y, EVENTS.t / (1e6 if kind else 1)
    np.savez(tmp_path / "a.npz", events=table)
    beside = {"when": np.zeros(2, [("t", "<M8[us]")]), "grid": np.zeros(2, [("g", "<i2", (2, 3))])}  # of no use here
    np.savez(tmp_path / "b.npz", t=EVENTS.t.astype(">i8"), x=EVENTS.x, y=EVENTS.y, **beside)
    for name in ("a.npz", "b.npz"):
        found = read(tmp_path / name)
        for part in ("t", "x", "y"):
            np.testing.assert_array_equal(getattr(found, part), getattr(EVENTS, part))


def test_a_header_of_gigabytes_is_not_read(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", 1 << 26) + bytes(1 << 26))
    tracemalloc.start()
    try:
        refused(tmp_path / "a.npz", "it does not begin as numpy.save would")
        assert tracemalloc.get_traced_memory()[1] < 10 << 20
    finally:
        tracemalloc.stop()
