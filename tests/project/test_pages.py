"""Pages are what records and code say: every generated part is up to date, and none is lost. Nothing is timed. Their
prose is wrapped at 120 characters, and says what it said."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import click
import pytest
from support.common.bench_results import bench

from benchmarks import __main__ as benchmarks, figures
from benchmarks.commands.proofs import PROOFS
from benchmarks.figures import PageTable
from lava_vpr.bench.show import tables as tables_of_bench
from lava_vpr.cli import main
from lava_vpr.config import LifNetwork, preset
from lava_vpr.errors import InputError
from scripts import pages, parts
from scripts.wrapping import WIDTH, wrapped

PAGE = Path("page.md")
TEXTS = {path: path.read_text(encoding="utf-8") for path in pages.pages()}
PART = "<!-- figures/lens: written by make pages -->\n\n{}\n\n<!-- end of figures/lens -->"


def test_every_part_of_every_page_is_up_to_date() -> None:
    assert pages.bring_up_to_date(check=True) == [], "run make pages"


def test_what_stands_around_the_parts_stays() -> None:
    made = pages.filled(f"before\n{PART.format('nonsense')}\nafter 9 %", PAGE)
    assert made == f"before\n{PART.format(figures.section('lens'))}\nafter 9 %"


def test_a_lost_mark_is_named() -> None:
    lost = {path: text.replace("<!-- figures/lens:", "<!--") for path, text in TEXTS.items()}
    assert pages.absent(TEXTS) == []
    assert pages.absent(lost) == ["figures/lens"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("end of figures/lens", "end of figures/energy", r"page.md: .*ends with the mark of figures/energy; put back"),
        ("figures/lens", "pictures/lens", "there is no part pictures/lens; there are cli/usage, "),
        ("figures/lens", "figures/nothing", "there is no part figures/nothing; there are cli/usage, "),
    ],
)
def test_a_wrong_mark_is_refused(old: str, new: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        pages.filled(PART.format("").replace(old, new), PAGE)


def test_no_page_has_a_table_of_figures_that_no_record_holds() -> None:
    """Two cells side by side that begin with figures; what others published, and what is on paper, is words."""
    ours = re.compile(r"\|( *[*.]*\d[\d.,]*( [^|A-Za-z]*)?\|){2}")
    for path, text in TEXTS.items():
        rest = pages.PART.sub("", text)
        assert [line for line in rest.splitlines() if line.startswith("|") and ours.search(line)] == [], path


def energies(columns: Iterable[str]) -> list[str]:
    """The headings of energies among those of a table that has recall, too; without it none."""
    columns = list(columns)
    if not any(re.search(r"R@1|recognised|as learned|^0:500$", name) for name in columns):
        return []
    known = r"\b[µum]J\b|joule|energy|whole query|all but the encoding|dynamic|static"
    return [name for name in columns if re.search(known, name) and name != "energy, uJ"]


def led_by_the_whole(columns: Iterable[str]) -> bool:
    """Whether energies beside recall begin with a whole query and all but its encoding, or are all a board takes."""
    found = energies(columns)
    board = all(name.startswith("board uJ") for name in found)
    return board or [bool(re.search(words, name)) for words, name in zip(LEAD, found, strict=False)] == [True, True]


LEAD = (r"\ba whole query\b", r"\ball but the encoding\b")


def test_no_table_of_recall_shows_the_chips_dynamic_energy_without_the_whole() -> None:
    lines = [line for text in TEXTS.values() for line in re.findall(r"^\|.*\|$", text, re.MULTILINE)]
    headings = {line: [cell.strip() for cell in line.strip("|").split("|")] for line in lines}
    assert sum(len(energies(columns)) > 2 for columns in headings.values()) >= 4
    run = bench()
    headings |= {"energy": [row[0] for row in tables_of_bench.energy(run.energy).rows]}
    headings |= {"sweep": list(tables_of_bench.sweep(run.sweep, run.energy).columns)}
    assert [name for name, columns in headings.items() if not led_by_the_whole(columns)] == []
    for columns in (["R@1", "µJ"], ["as learned", "modelled uJ"], ["recognised (R@1)", "energy, modelled"]):
        assert not led_by_the_whole(columns)
    assert not led_by_the_whole(["R@1", "board, dynamic, modelled", "a whole query", "all but the encoding"])


def test_a_record_is_read_as_it_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "FOLDER", tmp_path)
    made = PageTable("make it", "on a µ", ["", "R@1"], [["one", "95.7"], ["two", ""]])
    figures.write("some", made)
    assert figures.names() == ["some"]
    assert figures.read("some") == made
    assert figures.section("some") == "|  | R@1 |\n|---|---|\n| one | 95.7 |\n| two |  |\n\n*`make it`: on a µ.*"
    figures.write("short", PageTable("", "", ["", "R@1"], [["one"]]))
    with pytest.raises(InputError, match=r"short.json: a row has not 2 cells"):
        figures.section("short")


def test_every_record_is_written_by_the_command_that_it_names() -> None:
    """A command of lava-vpr that hands on its tables, or a program that names the record."""
    for name in figures.names():
        record = figures.read(name)
        assert record.conditions, name
        if record.command.startswith("lava-vpr "):
            command = main.get_command(click.Context(main), record.command.split()[1])
            assert command.callback.__annotations__["return"] == "list[Table]", name
        else:
            words = re.search(r"-m (benchmarks|support)[ .]([\w.]+)", record.command)
            assert words is not None, name
            folder = {"benchmarks": "benchmarks", "support": "tests/support"}[words[1]]
            source = pages.ROOT / folder / f"{words[2].replace('.', '/')}.py"
            assert f'"{name}"' in source.read_text(encoding="utf-8"), name


@pytest.mark.parametrize("name", list(PROOFS))
def test_rows_of_proofs_are_commands_that_exist(name: str) -> None:
    """A row of a record is a proof, with what its command printed; a test or a program that it names is there."""
    record = figures.read(name)
    assert [[what, command] for what, _, command in record.rows] == [[p.what, f"`{p.command}`"] for p in PROOFS[name]]
    for proof, (_, much, _) in zip(PROOFS[name], record.rows, strict=True):
        words = proof.command.split()
        assert re.search(r"\d", much), proof.what
        assert re.compile(proof.printed).groups
        if words[0] == "lava-vpr":
            assert words[1] in main.list_commands(click.Context(main))
        elif words[0] == "pytest":
            (tests,) = (word for word in words if word.startswith("tests/"))
            assert "print(" in (pages.ROOT / tests).read_text(encoding="utf-8"), tests
        else:
            assert words[-1] in benchmarks.names()


def test_presets_are_alike_in_what_the_page_does_not_name() -> None:
    told = {name.rpartition(".")[2] for row in parts.ROWS for name in re.findall(r"`([a-z_.]+)`", row)}
    default = preset("loihi")
    for own in map(preset, parts.INTEGER):
        for key in LifNetwork.__dataclass_fields__.keys() - told:
            assert getattr(own.network, key) == getattr(default.network, key), key
        assert own.learning == default.learning


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
