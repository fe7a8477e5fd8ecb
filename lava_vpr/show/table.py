"""One table for every output: terminal, Markdown, HTML, CSV, LaTeX and JSON.

A table holds plain text cells, which each output only escapes and aligns.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lava_vpr.show.templates import render, safe

if TYPE_CHECKING:
    from rich.table import Table as RichTable

_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{mark: f"\\{mark}" for mark in "&%$#_{}"},
}

_NARROWEST = 18
"""Characters that a long column keeps on a narrow terminal."""


@dataclass(frozen=True)
class Table:
    """A table of plain text.

    Attributes:
        columns: Headings.
        rows: Cells; a row may have fewer than there are headings.
        notes: The text below the table, a line for each.
        title: The line above it.
        words: Number of leading columns with words, aligned left; the others are figures, aligned right.
        long: Columns of long text, by index: aligned left; on a terminal they wrap.
        widest: Characters of a long column before it wraps; None: as many as the terminal has.
        strong: Rows that matter most, by index.
        rules: Rows with a line above them, by index.
        aside: Rows that only a terminal leaves out, by index: details.
        aside_columns: Columns that only a terminal leaves out, by index.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()
    title: str = ""
    words: int = 1
    long: frozenset[int] = frozenset()
    widest: int | None = 60
    strong: frozenset[int] = frozenset()
    rules: frozenset[int] = frozenset()
    aside: frozenset[int] = frozenset()
    aside_columns: frozenset[int] = frozenset()

    def is_text(self, column: int) -> bool:
        """Whether a column, by its index, holds words rather than figures."""
        return column < self.words or column in self.long

    def terminal(
        self,
        columns: Iterable[int] | None = None,
        *,
        first: bool = True,
        last: bool = True,
        widest: int | None = None,
    ) -> RichTable:
        """The table as rich prints it, without what is ``aside``.

        Args:
            columns: Columns of this part (`parts`), by index; None: all that a terminal shows.
            first: Whether the part has the title.
            last: Whether it has the notes.
            widest: Characters of a long column before it wraps; None: the table's own.
        """
        from rich.table import Table as RichTable  # 60 ms: only the terminal needs it

        shown = [k for k in range(len(self.columns)) if k not in self.aside_columns] if columns is None else [*columns]
        title, notes = self.title if first else None, "\n".join(self.notes) if last else None
        made = RichTable(title=title or None, title_justify="left", caption=notes, caption_justify="left")
        for k in shown:
            made.add_column(
                self.columns[k],
                justify="left" if self.is_text(k) else "right",
                no_wrap=k not in self.long,
                max_width=(widest or self.widest) if k in self.long else None,
                overflow="fold",
            )
        for k, row in enumerate(self._filled()):
            if k in self.rules:
                made.add_section()
            if k not in self.aside:
                made.add_row(*(row[c] for c in shown), style="bold" if k in self.strong else None)
        return made

    def parts(self, width: int) -> list[RichTable]:
        """The table as rich prints it at ``width`` characters.

        Where it is wider, its long columns become narrower, down to `_NARROWEST` characters, and it comes in parts
        below each other, each with the columns of words.
        """
        from rich.cells import cell_len  # see `terminal`

        rows = [row for k, row in enumerate(self._filled()) if k not in self.aside]
        shown = [k for k in range(len(self.columns)) if k not in self.aside_columns]
        lines = {k: [line for row in (self.columns, *rows) for line in row[k].split("\n")] for k in shown}
        wide = {k: 3 + max(map(cell_len, lines[k])) for k in shown}
        wide |= {k: min(wide[k], 3 + self.widest) for k in self.long & wide.keys() if self.widest is not None}
        words = [k for k in shown if k < max(1, self.words)]
        room = width - 1 - sum(min(wide[k], 3 + _NARROWEST) if k in self.long else wide[k] for k in words)
        groups: list[list[int]] = [[]]
        for k in shown[len(words) :]:
            if groups[-1] and sum(wide[c] for c in (*groups[-1], k)) > room:
                groups.append([])
            groups[-1].append(k)
        return [
            self.terminal(part, first=number == 0, last=number == len(groups) - 1, widest=self._room(part, wide, width))
            for number, part in enumerate([*words, *group] for group in groups)
        ]

    def _room(self, columns: Sequence[int], wide: Mapping[int, int], width: int) -> int | None:
        """Characters that each long one of ``columns`` may have in ``width``; None if none of them is too wide.

        Args:
            columns: Columns of a part, by index.
            wide: Characters of every column with its margins.
            width: Of the terminal.
        """
        long = [k for k in columns if k in self.long]
        if not long or sum(wide[k] for k in columns) < width:
            return None
        return max(_NARROWEST, (width - 1 - sum(wide[k] for k in columns if k not in long)) // len(long) - 3)

    def markdown(self) -> str:
        """The table in Markdown, without title and notes."""
        marks = ("---" if self.is_text(k) else "---:" for k in range(len(self.columns)))
        head = [_joined(self.columns, _in_markdown, "| ", " | ", " |"), f"|{'|'.join(marks)}|"]
        return "\n".join([*head, *(_joined(row, _in_markdown, "| ", " | ", " |") for row in self._filled())])

    def html(self) -> str:
        """The table as a panel of a page, which scrolls by itself."""
        rows = []
        for k, row in enumerate(self._filled()):
            first = "deep" if row[0].startswith(" ") else "long" if 0 in self.long else "text"
            cells = "".join(f"<td{self._kind(c)}>{in_html(cell)}</td>" for c, cell in enumerate(row) if c > 0)
            strong = ' class="strong"' if k in self.strong else ""
            rows.append(f'<tr{strong}><th scope="row" class="{first}">{in_html(row[0].strip())}</th>{cells}</tr>')
        note = "\n".join(self.notes)
        return render(
            "table.html",
            title=in_html(self.title),
            heads="".join(
                f'<th scope="col"{self._kind(k)}>{in_html(name)}</th>' for k, name in enumerate(self.columns)
            ),
            rows="".join(rows),
            note=f'<p class="note" style="margin:10px 0 0">{in_html(note)}</p>' if note else "",
        )

    def csv(self) -> str:
        """Headings and rows as CSV, without title and notes."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.columns, *self._filled()])
        return text.getvalue()

    def latex(self) -> str:
        """A ``tabular`` environment, without title and notes."""
        places = "".join("l" if self.is_text(k) else "r" for k in range(len(self.columns)))
        lines = [_joined(self.columns, _in_latex, "", " & ", r" \\"), r"\hline"]
        for k, row in enumerate(self._filled()):
            lines += [r"\hline"] if k in self.rules else []
            lines.append(_joined(row, _in_latex, "", " & ", r" \\"))
        return "\n".join([f"\\begin{{tabular}}{{{places}}}", r"\hline", *lines, r"\hline", r"\end{tabular}"])

    def json(self) -> list[dict[str, str]]:
        """The rows as JSON values, each cell under its heading."""
        return [dict(zip(self.columns, row, strict=True)) for row in self._filled()]

    def _filled(self) -> Iterable[Sequence[str]]:
        """The rows, each with as many cells as there are headings."""
        return ((*row, *[""] * (len(self.columns) - len(row))) for row in self.rows)

    def _kind(self, column: int) -> str:
        """The class of a column's cells in HTML."""
        return ' class="long"' if column in self.long else ' class="text"' if column < self.words else ""


FORMS: dict[str, Callable[[Table], str]] = {".csv": Table.csv, ".md": Table.markdown, ".tex": Table.latex}
"""A table as text, by how the name of its file ends."""


def in_html(text: str) -> str:
    """``text`` for a page, ``uJ`` and ``us`` as they are printed."""
    return safe(re.sub(r"\bu([Js])\b", r"µ\1", text))


def _joined(cells: Iterable[str], escape: Callable[[str], str], begin: str, between: str, end: str) -> str:
    """A line of a table."""
    return begin + between.join(map(escape, cells)) + end


def _in_markdown(text: str) -> str:
    """Text for one cell of Markdown: on one line, its bars no separators."""
    return " ".join(text.split()).replace("|", r"\|")


def _in_latex(text: str) -> str:
    """Text for one cell of LaTeX: on one line, no character a command."""
    return "".join(_LATEX.get(mark, mark) for mark in " ".join(text.split()))
