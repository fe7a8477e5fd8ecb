"""The parts of docs/results.md and README that docs/results.json decides; `make pages` writes them."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.results import adapted, long, sections, six, views
from benchmarks.results.record import Record

KINDS = {"sections": sections, "long": long, "adapted": adapted, "views": views}
"""The kinds of rows, by the names of their tables."""
ROWS = tuple(row for kind in KINDS.values() for row in kind.ROWS)


def origin(record: Record) -> str:
    """Where the tables come from."""
    settings, sources = record.origin
    return (
        f"`make results` wrote these tables from [results.json](results.json): settings `{settings}`, "
        f"sources `{sources}`."
    )


PARTS: dict[str, Callable[[Record], str]] = {
    **{name: kind.lines for name, kind in KINDS.items()},
    "six": six.lines,
    "origin": origin,
}


def names() -> list[str]:
    """All parts of pages that this module writes."""
    return list(PARTS)


def section(name: str) -> str:
    """A part of a page."""
    return PARTS[name](Record.read())
