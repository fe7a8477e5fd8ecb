"""One table in every output: its cells are the same text, escaped and aligned as each output needs."""

from __future__ import annotations

import csv
import io
import re

import pytest
from rich.console import Console

from lava_vpr.show.table import Table

TABLE = Table(
    ("matcher", "uJ", "what"),
    [("a|b & <c>", "1.5", "50 % of\nit_"), ("  part", "-")],
    ("first", "second"),
    "costs, uJ",
    strong=frozenset({0}),
    rules=frozenset({1}),
    long=frozenset({2}),
)


def printed(table: Table) -> list[str]:
    console = Console(width=100, record=True)
    with console.capture() as captured:
        console.print(table.terminal())
    return captured.get().splitlines()


def test_the_terminal_has_title_notes_and_a_rule() -> None:
    lines = printed(TABLE)
    assert lines[0].strip() == "costs, uJ"
    assert [line.strip() for line in lines[-2:]] == ["first", "second"]
    cells = [[cell for cell in re.split("[│┃]", line)[1:-1]] for line in lines if line[0] in "│┃"]
    assert [[cell.strip() for cell in row] for row in cells] == [
        ["matcher", "uJ", "what"],
        ["a|b & <c>", "1.5", "50 % of"],
        ["", "", "it_"],
        ["part", "-", ""],
    ]
    assert cells[-1][1].endswith("- ")  # figures stand on the right
    assert sum(line.startswith("├") for line in lines) == 1


def test_long_text_wraps_and_nothing_is_cut() -> None:
    word = "x" * 70
    lines = printed(Table(("a", "b"), [("1", word)], long=frozenset({1})))
    assert sum(line.count("x") for line in lines) == len(word)
    assert max(line.count("x") for line in lines) == Table.widest


def test_details_are_left_out_on_the_terminal_alone() -> None:
    table = Table(
        ("a", "b", "c"), [("1", "2", "3"), ("4", "5", "6")], aside=frozenset({0}), aside_columns=frozenset({1})
    )
    cells = [re.findall(r"\w", line) for line in printed(table) if line[0] in "│┃"]
    assert cells == [["a", "c"], ["4", "6"]]
    assert table.csv() == "a,b,c\n1,2,3\n4,5,6\n"


def test_a_table_wider_than_the_terminal_comes_in_parts_with_its_words_in_each() -> None:
    rows = [("row", "1" * 20, "2" * 20, "3" * 20), ("other", "4" * 20, "5" * 20, "6" * 20)]
    table = Table(("name", "x", "y", "z"), rows, ("note",), "title", rules=frozenset({1}))
    console = Console(width=60, record=True)
    with console.capture() as captured:
        for part in table.parts(60):
            console.print(part)
    lines = captured.get().splitlines()
    cells = [re.split("[│┃]", line)[1:-1] for line in lines if line[0] in "│┃"]
    assert [[cell.strip()[:5] for cell in row] for row in cells] == [
        *(["name", "x", "y"], ["row", "1" * 5, "2" * 5], ["other", "4" * 5, "5" * 5]),
        *(["name", "z"], ["row", "3" * 5], ["other", "6" * 5]),
    ]
    assert max(map(len, lines)) <= 60
    assert (lines[0].strip(), lines[-1].strip()) == ("title", "note")
    assert captured.get().count("title") == captured.get().count("note") == 1
    assert len(table.parts(200)) == 1
    assert len(table.parts(1)) == 3  # a column of figures each


@pytest.mark.parametrize(
    ("width", "parts"),
    [(120, 1), (60, 1), (45, 2)],
    ids=["as wide as its text", "long text wraps more", "figures in parts, too"],
)
def test_long_text_gives_way_on_a_narrow_terminal(width: int, parts: int) -> None:
    told = "spring and fall learned, summer recognised"
    table = Table(("name", "task", "x", "y"), [("a", told, "1" * 8, "2" * 8)], words=2, long=frozenset({1}))
    console = Console(width=width, record=True)
    with console.capture() as captured:
        made = table.parts(width)
        for part in made:
            console.print(part)
    lines = captured.get().splitlines()
    assert len(made) == parts
    assert max(map(len, lines)) <= width
    words = [re.split("[│┃]", line)[2].strip() for line in lines if line[0] == "│"]
    assert " ".join(words) == " ".join([told] * parts)  # whole words, and none is lost


def test_markdown() -> None:
    assert TABLE.markdown().splitlines() == [
        "| matcher | uJ | what |",
        "|---|---:|---|",
        r"| a\|b & <c> | 1.5 | 50 % of it_ |",
        "| part | - |  |",
    ]


def test_html_escapes_and_prints_units() -> None:
    page = TABLE.html()
    assert '<th scope="row" class="text">a|b &amp; &lt;c&gt;</th><td>1.5</td><td class="long">50 % of' in page
    assert '<tr class="strong">' in page
    assert '<th scope="row" class="deep">part</th>' in page
    assert "<h3>costs, µJ</h3>" in page
    assert "first\nsecond</p>" in page


def test_csv_reads_as_the_cells() -> None:
    assert list(csv.reader(io.StringIO(TABLE.csv()))) == [
        ["matcher", "uJ", "what"],
        ["a|b & <c>", "1.5", "50 % of\nit_"],
        ["  part", "-", ""],
    ]


def test_latex_has_no_text_that_is_a_command() -> None:
    assert TABLE.latex().splitlines() == [
        r"\begin{tabular}{lrl}",
        r"\hline",
        r"matcher & uJ & what \\",
        r"\hline",
        r"a|b \& <c> & 1.5 & 50 \% of it\_ \\",
        r"\hline",
        r"part & - &  \\",
        r"\hline",
        r"\end{tabular}",
    ]
    strange = Table(("a",), [("\\~^#{}$",)]).latex().splitlines()[4]
    assert strange == r"\textbackslash{}\textasciitilde{}\textasciicircum{}\#\{\}\$ \\"


def test_json_has_each_cell_under_its_heading() -> None:
    assert TABLE.json()[1] == {"matcher": "  part", "uJ": "-", "what": ""}
