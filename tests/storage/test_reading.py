"""Reading waits for no pipe and takes no more than a limit allows; JSON breaks no reader.

CSV rows come back as they were written; arrays are read as NumPy reads them.
"""

from __future__ import annotations

import csv
import io
import os
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from support.fuzz.changes import stored as npy

from lava_vpr.errors import ConfigError, InputError, harmless, said, shown
from lava_vpr.storage.arrays import array_of, read_array
from lava_vpr.storage.limits import LIMITS, excess, limit, variable
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.tables import csv_line, csv_rows


def test_reading_takes_what_the_file_holds_not_what_the_limit_allows(tmp_path: Path) -> None:
    """As long as they are read, bytes stand in memory twice at most; the limit on models is a gibibyte."""
    (tmp_path / "a").write_bytes(bytes(10_000))
    tracemalloc.start()
    try:
        assert len(read_bytes(tmp_path / "a", "text_bytes")) == 10_000
        assert tracemalloc.get_traced_memory()[1] < 200_000
    finally:
        tracemalloc.stop()


def test_a_file_that_tells_no_length_is_read_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linux says 0 for its own tables."""
    assert Path("/proc/self/mountinfo").stat().st_size == 0
    assert read_bytes(Path("/proc/self/mountinfo"), "text_bytes").count(b"\n") > 1
    monkeypatch.setenv("LAVA_VPR_MAX_TEXT_BYTES", "10")
    with pytest.raises(OSError, match="has 11 bytes, more than the 10 allowed"):
        read_bytes(Path("/proc/self/mountinfo"), "text_bytes")


@pytest.mark.timeout(20)
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="named pipe"):
        read_bytes(tmp_path / "pipe", "text_bytes")


def test_devices_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="device"):
        read_bytes(Path("/dev/zero"), "text_bytes")
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path, "text_bytes")
    with pytest.raises(OSError, match="null"):
        read_bytes(tmp_path / "a\0b", "text_bytes")


def test_a_limit_is_named_and_can_be_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_bytes(b"12345678901")
    monkeypatch.setenv("LAVA_VPR_MAX_TEXT_BYTES", "10")
    with pytest.raises(OSError, match=r"has 11 bytes, more than the 10 allowed; .* set LAVA_VPR_MAX_TEXT_BYTES"):
        read_bytes(tmp_path / "a", "text_bytes")
    monkeypatch.setenv("LAVA_VPR_MAX_TEXT_BYTES", "11")
    assert read_bytes(tmp_path / "a", "text_bytes") == b"12345678901"


@pytest.mark.parametrize("text", ["", "0", "-1", "1e9", "many", "9" * 5000])
def test_a_limit_that_is_no_number_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable("image_pixels"), text)
    with pytest.raises(ConfigError, match="LAVA_VPR_MAX_IMAGE_PIXELS"):
        limit("image_pixels")


def test_what_is_within_a_limit_is_no_excess() -> None:
    for name, row in LIMITS.items():
        assert excess(name, row.default) is None
        assert variable(name) in str(excess(name, row.default + 1))


@pytest.mark.parametrize("text", ["[" * 100_000, "NaN", "[1, -Infinity]", "1" * 10_000, "{", b"\xff\xfe\xfd", ""])
def test_json_that_is_none_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_json(text)


def test_text_for_the_terminal_holds_no_control_characters() -> None:
    assert harmless("a\x1b[31mb\x07\u202e\x9bc\nd\te é") == "a\\x1b[31mb\\x07\\u202e\\x9bc\nd\te é"
    assert harmless("plain é ✓") == "plain é ✓"
    assert shown("a\nb") == "'a\\nb'"
    assert len(shown("\0" * 600)) < 400
    assert said(ValueError("a\x1b[31m\n" + "b" * 900)) == "a\\x1b[31m " + "b" * 193
    assert said(ValueError()) == "ValueError"
    middle = shown("begin/" + "x" * 9000 + "/end")
    assert middle.startswith("begin/xxx")
    assert middle.endswith("xxx/end")
    assert len(middle) < 400


ROWS = st.lists(
    st.lists(st.text(alphabet='a,;"\r\n \t\x0b\x85\u2028#é', max_size=4), min_size=2, max_size=3), max_size=4
)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(ROWS)
def test_every_reader_finds_the_rows_that_were_written(rows: list[list[str]]) -> None:
    text = "".join(map(csv_line, rows))
    assert list(csv.reader(io.StringIO(text, newline=""))) == rows
    assert list(csv.reader(io.StringIO(text, newline=""), strict=True)) == rows


def test_plain_rows_are_written_as_ever() -> None:
    assert csv_line((1, "a.png", -1, "", "0.5", "true")) == "1,a.png,-1,,0.5,true\n"
    assert csv_line(("a\rb", "a\nb", 'a"b', "a,b")) == '"a\rb","a\nb","a""b","a,b"\n'


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("a,b\r\n\r\n#c,d,e\r1,2\n  \n", [(1, ["a", "b"]), (4, ["1", "2"])]),
        ('"a;b","c\nd"\n1,2\n', [(1, ["a;b", "c\nd"]), (3, ["1", "2"])]),
        ('"a,b"\tc\n1\t2', [(1, ["a,b", "c"]), (2, ["1", "2"])]),
        ("a\x85b,c\n", [(1, ["a\x85b", "c"])]),
    ],
)
def test_rows_are_numbered_by_the_line_that_they_begin_on(
    tmp_path: Path, text: str, rows: list[tuple[int, list[str]]]
) -> None:
    (tmp_path / "t.csv").write_bytes(text.encode())
    assert csv_rows(tmp_path / "t.csv") == rows


KINDS = st.sampled_from(["?", "i1", "u1", "<i2", "<u4", "<i8", "<u8", "<f2", "<f4", "<f8"])


@given(
    array=KINDS.flatmap(lambda kind: arrays(kind, array_shapes(min_dims=0, max_dims=4, min_side=0))),
    turned=st.booleans(),
)
@settings(deadline=None, max_examples=200, derandomize=True)
def test_it_reads_what_numpy_reads(array: NDArray[Any], turned: bool) -> None:
    data = npy(array.T if turned else array)
    wanted, found = np.load(io.BytesIO(data)), array_of(data)
    assert found.dtype == wanted.dtype
    assert found.shape == wanted.shape
    assert found.tobytes() == wanted.tobytes()
    assert found.flags.f_contiguous == wanted.flags.f_contiguous


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2,3), }",  # libnpy, NPZ.jl
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)}\n",
        "{'descr':'<f4','fortran_order':False,'shape':(2,3),}",
    ],
)
def test_other_writers_are_read(header: str) -> None:
    """Their headers end where they like, so the numbers are out of step with the machine's words."""
    content = np.arange(6, dtype=np.float32)
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + content.tobytes()
    found = array_of(data)
    assert found.flags.aligned
    assert np.array_equal(found, content.reshape(2, 3))


def test_a_view_can_be_written_if_its_memory_can() -> None:
    data = bytearray(npy(np.zeros(3, np.int32)))
    array_of(memoryview(data))[1] = 7
    assert np.array_equal(array_of(bytes(data)), [0, 7, 0])
    with pytest.raises(ValueError, match="read-only"):
        array_of(bytes(data))[0] = 1


def test_what_it_may_cost_is_bounded_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "long.npy"
    path.write_bytes(npy(np.zeros(4)))
    with path.open("r+b") as file:
        file.truncate(5 << 30)  # takes no space on the disk
    with pytest.raises(
        InputError, match=r"has 5,368,709,120 bytes, more than the 4,294,967,296 allowed; .*ARRAY_BYTES"
    ):
        read_array(path, "write it again")
    path.write_bytes(npy(np.zeros(4)))
    monkeypatch.setenv("LAVA_VPR_MAX_ARRAY_BYTES", "100")
    with pytest.raises(InputError, match="has 160 bytes, more than the 100 allowed"):
        read_array(path, "write it again")
