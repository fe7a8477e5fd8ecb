"""README and docs speak of what is there."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import click
import pytest

from benchmarks import __main__ as benchmarks, figures
from benchmarks.recall import TABLES
from lava_vpr.cli import main

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
TYPED = [
    ROOT / "README.md",
    *(ROOT / "docs" / f"{name}.md" for name in ("index", "quickstart", "own_data", "own_board")),
]
"""Pages whose commands a newcomer types."""


def commands() -> list[str]:
    """Every `lava-vpr ...` line of code blocks of `TYPED`, each once."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in TYPED)
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = [line.partition("#")[0].strip() for block in blocks for line in block.splitlines()]
    return list(dict.fromkeys(line for line in lines if line.startswith("lava-vpr ")))


@pytest.mark.parametrize("line", commands())
def test_commands_of_the_pages_parse(line: str) -> None:
    _, name, *words = shlex.split(line)
    command = main.get_command(click.Context(main), name)
    # Parsing refuses unknown options, missing arguments and values of a wrong kind.
    context = command.make_context(name, words, resilient_parsing=False)
    assert context.command is command


def test_there_are_commands_to_check() -> None:
    assert len(commands()) >= 40


@pytest.mark.parametrize("page", [*PAGES, *(ROOT / "docs" / "notebooks").glob("*.ipynb")], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_benchmarks_that_the_pages_name_exist() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    text += "".join(f"\n{figures.read(name).command}" for name in figures.names())
    modules = {name.rstrip(".") for name in re.findall(r"python -m (benchmarks\.[a-z_.]+)", text)}
    named = set(re.findall(r"python -m benchmarks ([a-z_.]+)", text))
    assert len(named) > 12
    assert named <= set(benchmarks.names())
    assert set(re.findall(r"python -m benchmarks recall ([a-z-]+)", text)) <= set(TABLES)
    for module in modules:
        place = ROOT / module.replace(".", "/")
        assert place.with_suffix(".py").exists() or (place / "__main__.py").exists(), module


def test_the_comparison_quotes_the_pages_that_it_links_to() -> None:
    """Every figure of a paragraph, a fraction or a range, stands in one of them."""
    text = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
    quoted = []
    for paragraph in re.split(r"\n- ", text.partition("## What each is better at")[2]):
        pages = re.findall(r"\]\((\w+\.md)[#)]", paragraph)
        linked = "\n".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in pages)
        figures = re.findall(r"\b\d+ to \d+ times|(?<![\w.])\d*\.\d+", paragraph) if pages else []
        assert [figure for figure in figures if figure not in linked] == [], paragraph
        quoted += figures
    assert {".927", ".63", "39.6", "95.8", "22 to 43 times"} <= set(quoted)


def test_listed_help_is_the_commands_own() -> None:
    for name, (_, _, text) in main.table.items():
        command = main.get_command(click.Context(main), name)
        assert command.name == name
        assert text.endswith(".")
        assert command.help


def of_untouched_images(text: str) -> list[str]:
    """Claims that images played no part in finding the settings: all that is known is what the search did not see."""
    words = re.sub(r"[\s>|*\"'#]+", " ", text.lower()) if "chosen" in text.lower() else ""
    return re.findall(r"\b(?:nothing|no settings?|no numbers?) (?:was|were|has been) (?:ever )?chosen.{0,60}", words)


def test_no_page_claims_images_on_which_nothing_was_chosen() -> None:
    """Longer maps were looked at while the network was built (docs/network.md); some pages are written by programs."""
    assert of_untouched_images('"ten further sections, on\n    which nothing was "\n "chosen"')
    folders = (ROOT / name for name in ("docs", "benchmarks", "scripts", "examples", "lava_vpr", "deploy", "processes"))
    files = [
        *PAGES,
        *(path for folder in folders for path in folder.rglob("*") if path.suffix in (".md", ".py", ".ipynb")),
    ]
    assert len(files) > 400
    found = {str(path.relative_to(ROOT)): of_untouched_images(path.read_text(encoding="utf-8")) for path in files}
    assert {name: claims for name, claims in found.items() if claims} == {}
    assert "were looked at" in (ROOT / "docs" / "results.md").read_text(encoding="utf-8")


def test_security_is_found_from_the_readme() -> None:
    assert "docs/security.md" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_says_before_the_first_command_where_it_runs() -> None:
    before, command, _ = (ROOT / "README.md").read_text(encoding="utf-8").partition("```sh\nmake demo ")
    assert command
    assert before.endswith("In a clone of this repository:\n\n")


def test_the_readme_is_read_in_minutes() -> None:
    """At most 900 words, code and tables among them."""
    text = re.sub(r"<!--.*?-->|\|", " ", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert 500 < len(text.split()) <= 900


TRANSLATED = (
    *("carried off", "is told on", "told apart", "what speaks against", "the house", "say for each"),
    *("so probable that", "lacks or garbles", " anew", "held against", "the wanted least", "is minded"),
    *("takes from every", "takes from all", "in the place of", "another thing", "mends that", "goes on where it"),
    *("take the place of", "takes the place of", "is told of", "nobody asked", "hands on its", "by what for"),
    *("what helps", "as people read", "as people say", "what it brings", "held at once", "nobody has shown"),
    *("to be read with", "that speak of", "cannot be said in", "takes nothing of"),
    *("becomes spikes becomes", "when not to know", "it by that", "places off that still", "never back"),
    *("the very same", "stands beside", "stand beside", "answered rightly", "goes wherever", "in two goes"),
    *("asks for news", "what stands here", "counts besides", "takes besides"),
)
"""Turns that are no English of the field, which says kidnapped, reported, architecture, report, above, has no, again,
compared with, threshold, ignored, inhibits, instead of, something else, repairs, continues, replaces, unless requested,
keeps, by purpose, remedies, in words, recall or gain, in memory at once, no public source shows, name, is free, from an
image to spikes, off the map, then knows it, number of places off, only forward, identical, is compared with, is right,
is accepted by, in two runs, requests an update, this text, counts in addition, takes in addition."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_and_help_speak_the_fields_english(page: Path) -> None:
    text = " ".join(page.read_text(encoding="utf-8").lower().split())
    assert [turn for turn in TRANSLATED if turn in text] == []


def texts(node: ast.AST) -> list[str]:
    """All strings of a module: docstrings, messages, and what tables hold; a formatted one without its values."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [" ".join(node.value.lower().split())]
    found = [text for child in ast.iter_child_nodes(node) for text in texts(child)]
    return ["".join(found)] if isinstance(node, ast.JoinedStr) else found


@pytest.mark.parametrize("room", ["lava_vpr", "processes", "deploy", "benchmarks", "scripts"])
def test_docstrings_and_messages_speak_the_fields_english(room: str) -> None:
    said = [
        (path.name, text)
        for path in sorted((ROOT / room).rglob("*.py"))
        for text in texts(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert len(said) > 500
    assert [(name, turn) for name, text in said for turn in TRANSLATED if turn.strip() in text] == []
