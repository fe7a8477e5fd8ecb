"""Text lists and CSV tables, in and out: every line and cell is read as its writer meant it, or refused."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from lava_vpr.errors import InputError, shown
from lava_vpr.storage.limits import within
from lava_vpr.storage.reading import read_bytes

_LINE_END = re.compile("\r\n|\n|\r")  # str.splitlines ends lines at ten more characters, which a file name may hold
_QUOTED = re.compile('"[^"]*"')


def file_text(path: Path) -> str:
    """The text of a list or table.

    Raises:
        InputError: it cannot be read, is too long, or is no UTF-8.
    """
    try:
        text = read_bytes(path, "text_bytes").decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check path and permissions") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{shown(path)} line {line}: is not UTF-8 text; save the file as UTF-8") from None
    within("rows", text.count("\n") + text.count("\r"), f"{shown(path)}: has")
    return text


def text_lines(path: Path) -> list[str]:
    """The lines of a text file without their ends, which are a line feed, a carriage return, or both.

    Raises:
        InputError: as `file_text`.
    """
    return _LINE_END.split(file_text(path))


def csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Line number and stripped cells of a CSV file's rows, all equally wide. Separator: , or ; or tab.

    Blank lines, lines that begin with #, and rows of empty cells at the end are left out.

    Raises:
        InputError: as `file_text`; a quote that is not closed or stands within a cell; a row of another width than the
            first. The message names the line.
    """
    text = file_text(path)
    first = next((line for line in io.StringIO(text, newline="") if line.strip() and not line.startswith("#")), "")
    separator = next((d for d in ";\t" if d in _QUOTED.sub("", first)), ",")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    rows: list[tuple[int, list[str]]] = []
    line = 1
    try:
        for row in reader:
            cells = [cell.strip(" \t") for cell in row]
            if len(cells) > 1 or any(cells):  # else a blank line
                if not cells[0].startswith("#"):
                    rows.append((line, cells))
            line = reader.line_num + 1
    except csv.Error as error:
        why = "the quote that it opens is not closed" if reader.line_num > line else str(error)
        raise InputError(f"{shown(path)} line {line}: is not CSV ({why}); correct the line") from None
    while rows and not any(rows[-1][1]):
        rows.pop()
    for line, cells in rows:
        if len(cells) != len(rows[0][1]):
            raise InputError(
                f"{shown(path)} line {line}: has {len(cells)} cells, but line {rows[0][0]} has {len(rows[0][1])}; "
                f'write a cell that holds {separator!r} in "quotes", and complete short lines'
            )
    return rows


def csv_line(cells: Iterable[object]) -> str:
    """One row of a CSV file, ended by a line feed; every CSV reader finds the same cells in it again."""
    line = io.StringIO()
    # The csv module quotes no carriage return unless lines end with one, yet readers take it for the end of the row.
    csv.writer(line, lineterminator="\r\n").writerow(cells)
    return line.getvalue().removesuffix("\r\n") + "\n"


def json_line(values: Mapping[str, object]) -> str:
    """One line of a JSON Lines file, ended by a line feed; what is NaN or infinite must be None beforehand."""
    return json.dumps(values, ensure_ascii=False, allow_nan=False) + "\n"
