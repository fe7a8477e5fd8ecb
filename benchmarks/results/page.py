"""The tables of README's results, written from docs/results.json between comments."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.results import adapted, long, sections, views
from benchmarks.results.record import ROOT, Record
from lava_vpr.errors import InputError

PAGE = ROOT / "README.md"
KINDS = {"sections": sections, "long": long, "adapted": adapted, "views": views}
"""The kinds of rows, by the names of their tables."""
ROWS = tuple(row for kind in KINDS.values() for row in kind.ROWS)
END = "<!-- end of results -->"


def origin(record: Record) -> list[str]:
    """Where the tables come from."""
    settings, sources = record.origin
    return [
        f"`make results` wrote these tables from [docs/results.json](docs/results.json): settings `{settings}`, "
        f"sources `{sources}`."
    ]


PARTS: dict[str, Callable[[Record], list[str]]] = {name: kind.lines for name, kind in KINDS.items()}
PARTS["origin"] = origin


def begin(name: str) -> str:
    """The mark before a part."""
    return f"<!-- results: {name}, written by make results -->"


def check(page: str) -> None:
    """Refuse a page that lacks the marks of a part.

    Raises:
        InputError: it lacks them.
    """
    for name in PARTS:
        _, found, rest = page.partition(begin(name))
        if not found or END not in rest:
            raise InputError(f"{PAGE}: lacks the marks of {name}; put back {begin(name)} and {END}")


def filled(page: str, record: Record) -> str:
    """The page with every part as the record has it.

    Raises:
        InputError: the page lacks the marks of a part.
    """
    check(page)
    for name, lines in PARTS.items():
        head, found, rest = page.partition(begin(name))
        tail = rest.partition(END)[2]
        page = "\n".join([head + found, "", *lines(record), "", END + tail])
    return page
