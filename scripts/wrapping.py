"""Prose of Markdown pages in lines of at most `WIDTH` characters; code, tables, headings and pictures stay."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator

WIDTH = 120
_ITEM = re.compile(r"\s*(?:[-*+]|\d+\.) +")
_ALONE = re.compile(r"\s*(?:\||#|<|!\[|!!!|\[[^\]]+\]: |---$|:::)")
"""How lines begin that are no prose."""
_MARK = re.compile(r" (?=>|(?:[-+*#=|]+|\d+[.)])(?: |$))")
"""The space before a word that would be a mark at the beginning of a line."""


def wrapped(page: str) -> str:
    """The text ``page`` with every paragraph wrapped again if it has too long a line."""
    blocks = _blocks(page.split("\n"))
    return "\n".join(line for prose, block in blocks for line in (_lines(block) if prose else block))


def _blocks(lines: list[str]) -> Iterator[tuple[bool, list[str]]]:
    """Paragraphs and items of lists, True; every line that is no prose by itself, False."""
    block: list[str] = []
    fence = front = False
    for number, line in enumerate(lines):
        front = line == "---" if number == 0 else front and line != "---"
        mark = line.lstrip().startswith("```")
        prose = bool(line.strip()) and not (front or fence or mark or _ALONE.match(line))
        if block and (not prose or _ITEM.match(line)):
            yield True, block
            block = []
        if prose:
            block.append(line)
        else:
            yield False, [line]
        fence ^= mark
    if block:
        yield True, block


def _lines(block: list[str]) -> list[str]:
    """A block in lines that are not too long."""
    first = block[0]
    item = _ITEM.match(first)
    code = item is None and first.startswith("    ")
    if code or all(len(line) <= WIDTH for line in block) or any(line.endswith(("  ", "\\")) for line in block):
        return block
    begin = item[0] if item else first[: len(first) - len(first.lstrip())]
    text = " ".join(line.strip() for line in block)[len(begin.lstrip()) :]
    return [
        line.replace("\0", " ")
        for line in textwrap.wrap(
            _MARK.sub("\0", text),
            WIDTH,
            initial_indent=begin,
            subsequent_indent=" " * len(begin),
            break_long_words=False,
            break_on_hyphens=False,
        )
    ]
