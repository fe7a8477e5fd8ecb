"""CSV rows come back as they were written, whatever their cells hold."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lava_vpr.storage.tables import csv_line, csv_rows

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
