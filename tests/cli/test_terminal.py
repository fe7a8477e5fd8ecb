"""Whatever a file is called, and whatever stands in it, the terminal is sent text and nothing else."""

from __future__ import annotations

import io
import re
import shutil
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from rich.text import Text
from support.common.commands import opened, run
from support.common.imagefiles import write_images

from lava_vpr.cli import common, main
from lava_vpr.show.table import Table

NASTY = "\x1b]0;taken\x07[red]x[b]\r\u202e:smile:\x9b2J\n"
"""A new title of the window, markup, a return to the line's beginning, text from right to left, an emoji's name, a
screen cleared, and a line's end."""
ESCAPED = r"\x1b]0;taken\x07[red]x[b]\r\u202e:smile:\x9b2J"


def is_plain(text: str) -> bool:
    """Whether a terminal does nothing with ``text`` but show it, line by line."""
    return all(character.isprintable() for character in text.replace("\n", ""))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a nasty name with images of such names, and their model."""
    root = tmp_path_factory.mktemp("place") / NASTY
    write_images(root / "ref", 4)
    for k, file in enumerate(sorted((root / "ref").iterdir())):
        file.rename(file.with_name(f"{k}{NASTY}.png"))
    shutil.copytree(root / "ref", root / "query")
    (root / "quick.toml").write_text("[network]\nsteps = 32\n[learning]\nsteps = 40\nepochs = 2\n")
    run("train", root / "ref", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    return root


COMMANDS = [
    "train {}/ref -o {}/n.lvpr --config {}/quick.toml",
    "query {}/m.lvpr {}/query -o {}/q.csv",
    "fit {}/m.lvpr --target loihi2 --picture {}/p.svg",
    "synth {}/s --places 2",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_says_of_files_is_plain_text(command: str, place: Path) -> None:
    result = run(*(word.replace("{}", str(place)) for word in command.split()))
    assert ESCAPED in result.stdout
    assert is_plain(result.output)


DAMAGE = [
    ("eval {}/m.lvpr {}/query", "query"),
    ("train {}/ref -o {}/n.lvpr", "ref"),
    ("query {}/m.lvpr {}/query -o {}/q.csv", "query"),
]


@pytest.mark.parametrize(("command", "folder"), DAMAGE)
def test_a_refusal_names_a_file_in_plain_text(command: str, folder: str, place: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "w"
    shutil.copytree(place, damaged)
    (damaged / folder / f"2{NASTY}.png").write_bytes(b"no image")
    result = CliRunner().invoke(main, [word.replace("{}", str(damaged)) for word in command.split()])
    assert result.exit_code == 1
    assert ESCAPED in result.stderr
    assert is_plain(result.stderr)
    assert len(result.stderr.splitlines()) == 1


def test_a_progress_bar_shows_names_as_text(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = opened(monkeypatch, 400)
    with common.progress_bar(NASTY, 2) as advance:
        advance(1, NASTY)
    assert terminal.said.count(ESCAPED) >= 2
    assert is_plain(terminal.said.replace("\r", ""))


def test_tables_show_names_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stdout", shown)
    word = NASTY.strip()
    common.print_whole(Table([word], [[word], ["-" * 60]], [word], word))
    common.console.print(Text(word))
    assert shown.getvalue().count(ESCAPED) == 4
    assert is_plain(shown.getvalue())
    assert len({len(line) for line in shown.getvalue().splitlines() if "│" in line}) == 1


def test_a_page_shows_names_as_text(place: Path, tmp_path: Path) -> None:
    """No file can be named ``</script>``, but these words need no slash."""
    queries, folder = tmp_path / "query", tmp_path / NASTY
    shutil.copytree(place / "query", queries)
    for k, file in enumerate(sorted(queries.iterdir())):
        file.rename(file.with_name(f"{k}\"'><img src=x onerror=alert(1)><script>alert(2)<!--&.png"))
    result = run("eval", place / "m.lvpr", queries, "--report", folder)
    assert ESCAPED in result.stdout
    assert is_plain(result.output)
    page = (folder / "report.html").read_text()
    assert "onerror=alert(1)&gt;" in page
    assert "<img src=x" not in page
    assert len(re.findall("<script", page)) == 2
    assert "<!--&" not in page
