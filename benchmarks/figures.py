"""Tables of figures as docs/results/NAME.json keeps them: what a command computed, under which conditions.

Benchmarks write theirs with ``--record``; `make pages` then writes the pages again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import write_atomically

WITHOUT_CAPTION = ("season-short",)
"""Records of README, whose own words give their conditions."""
FOLDER = Path(__file__).resolve().parents[1] / "docs" / "results"


@dataclass(frozen=True)
class PageTable:
    """A table that a page shows.

    Attributes:
        command: The command that computes it again.
        conditions: What the figures depend on.
        columns: Headings, in Markdown.
        rows: Cells, in Markdown.
        table: Which of the tables that a command of lava-vpr prints it is, from 0.
    """

    command: str
    conditions: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    table: int = 0

    def text(self) -> str:
        """The file's text, a line for each row."""
        head = {"command": self.command, "conditions": self.conditions, "table": self.table, "columns": self.columns}
        lines = [
            f" {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}," for key, value in head.items() if value != 0
        ]
        rows = ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in self.rows)
        return "\n".join(["{", *lines, ' "rows": [', rows, " ]", "}", ""])


def names() -> list[str]:
    """All records."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def read(name: str) -> PageTable:
    """A record.

    Raises:
        InputError: there is none of that name.
    """
    path = FOLDER / f"{name}.json"
    if not path.exists():
        raise InputError(f"{path}: there is no such record; there are {', '.join(names())}")
    return PageTable(**json.loads(path.read_text(encoding="utf-8")))


def write(name: str, figures: PageTable) -> None:
    """Write a record."""
    text = figures.text().encode()
    write_atomically(FOLDER / f"{name}.json", lambda out: out.write(text))


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown cells as a page has it."""
    return Table(columns, rows, words=len(columns)).markdown()


def section(name: str) -> str:
    """The table of a record, for a page, with its command and conditions below.

    Raises:
        InputError: as `read`, or a row has not as many cells as there are columns.
    """
    figures = read(name)
    if any(len(row) != len(figures.columns) for row in figures.rows):
        raise InputError(
            f"{name}.json: a row has not {len(figures.columns)} cells, as there are columns; give it as many"
        )
    table = markdown(figures.columns, figures.rows)
    return table if name in WITHOUT_CAPTION else f"{table}\n\n*`{figures.command}`: {figures.conditions}.*"


PARTS = {name: partial(section, name) for name in names()}
