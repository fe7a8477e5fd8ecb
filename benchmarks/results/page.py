"""The tables of docs/results.md and the six figures of README, written from docs/results.json between comments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from benchmarks.results import adapted, long, sections, six, views
from benchmarks.results.record import ROOT, Record
from lava_vpr.errors import InputError

RESULTS, README = ROOT / "docs" / "results.md", ROOT / "README.md"
KINDS = {"sections": sections, "long": long, "adapted": adapted, "views": views}
"""The kinds of rows, by the names of their tables."""
ROWS = tuple(row for kind in KINDS.values() for row in kind.ROWS)
END = "<!-- end of results -->"


def origin(record: Record) -> list[str]:
    """Where the tables come from."""
    settings, sources = record.origin
    return [
        f"`make results` wrote these tables from [results.json](results.json): settings `{settings}`, "
        f"sources `{sources}`."
    ]


Parts = Mapping[str, Callable[[Record], list[str]]]
PAGES: dict[Path, Parts] = {
    RESULTS: {**{name: kind.lines for name, kind in KINDS.items()}, "origin": origin},
    README: {"six figures": six.lines},
}
"""The pages, and the lines of each of their parts."""


def begin(name: str) -> str:
    """The mark before a part."""
    return f"<!-- results: {name}, written by make results -->"


def check(page: str, path: Path) -> None:
    """Refuse the text ``page`` of the file ``path`` if it lacks the marks of a part.

    Raises:
        InputError: it lacks them.
    """
    for name in PAGES[path]:
        _, found, rest = page.partition(begin(name))
        if not found or END not in rest:
            raise InputError(f"{path}: lacks the marks of {name}; put back {begin(name)} and {END}")


def filled(page: str, path: Path, record: Record) -> str:
    """The text ``page`` of the file ``path`` with every part as the record has it.

    Raises:
        InputError: the page lacks the marks of a part.
    """
    check(page, path)
    for name, lines in PAGES[path].items():
        head, found, rest = page.partition(begin(name))
        tail = rest.partition(END)[2]
        page = "\n".join([head + found, "", *lines(record), "", END + tail])
    return page
