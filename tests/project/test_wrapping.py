"""Prose of pages is wrapped at 120 characters, and says what it said."""

from __future__ import annotations

import re

import pytest

from scripts import pages
from scripts.wrapping import WIDTH, wrapped

WORDS = "a robot has driven a route and later sees one image " * 4


@pytest.mark.parametrize(
    "block",
    [
        f"| {WORDS} |",
        f"# {WORDS}",
        f"```sh\n{WORDS}\n```",
        f"    {WORDS}",
        f"![{WORDS}](a.png)",
        f"<!-- {WORDS} -->",
        f"---\ntitle: {WORDS}\n---",
        "short lines\nthat somebody broke",
        f"a line that ends with a break  \n{WORDS}",
    ],
)
def test_what_is_no_long_prose_stays(block: str) -> None:
    assert wrapped(block) == block


@pytest.mark.parametrize(("begin", "indent"), [("", ""), ("- ", "  "), ("12. ", "    "), ("  - ", "    ")])
def test_prose_is_wrapped_with_its_indent(begin: str, indent: str) -> None:
    made = wrapped(f"before\n\n{begin}{WORDS}\n- next").split("\n")
    assert made[:2] == ["before", ""]
    assert made[-1] == "- next"
    assert made[2].startswith(begin)
    assert all(line.startswith(indent) and len(line) <= WIDTH for line in made[3:-1])
    assert " ".join(line.strip() for line in made[2:-1]) == (begin + WORDS).strip()


@pytest.mark.parametrize("mark", ["-", "+", ">=", "#", "2.", "|"])
def test_no_line_begins_with_what_would_be_a_mark(mark: str) -> None:
    for before in range(90, 130):
        made = wrapped(f"{'x' * before} {mark} {WORDS}")
        assert not any(line.startswith(mark) for line in made.split("\n"))


def test_no_page_has_long_lines_of_prose() -> None:
    """But a word, a link or a picture that is longer, and what is indented as code."""
    for path in pages.pages():
        text = re.sub(r"(?s)```.*?```", "", path.read_text(encoding="utf-8"))
        long = [line for line in text.split("\n") if len(line) > WIDTH and not re.match(r"\||#|!\[|<|    ", line)]
        assert [line for line in long if " " in line[3:].strip()] == [], path
