"""Running commands in tests, on a small synthetic route.

Used by backends, bench, benchmarks, cli, conftest, core, deploy, events, examples, exchange, learning, paper_table,
studies, training and vectors.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from lava_vpr.cli import common, main
from lava_vpr.synthetic.world import write_traverses

CONFIG = "[network]\nsteps = 256\n[learning]\nsteps = 300\nepochs = 6\n"
SHORT = "[network]\nsteps = 32\n[learning]\nsteps = 40\nepochs = 2\n"
PLACES = 8


def run(*words: object) -> Result:
    """A command that must succeed with nothing but notes and warnings on stderr."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    assert all(line.startswith(("note: ", "warning: ")) for line in result.stderr.splitlines()), result.stderr
    return result


def fails(*words: object, code: int = 1) -> str:
    """What a command says that must fail, in the one line after its notes; all of it if it is used wrongly (2)."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert (result.exit_code, result.stdout) == (code, ""), result.output
    if code == 2:
        return result.stderr
    *notes, line = result.stderr.splitlines()
    assert line.startswith("lava-vpr: error: "), result.stderr
    assert all(note.startswith("note: ") for note in notes), result.stderr
    return line.removeprefix("lava-vpr: error: ")


def content(folder: Path) -> dict[Path, tuple[int, bytes]]:
    """Mode and bytes of every file below ``folder``, hidden ones too, and the modes of folders."""
    return {path: (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"") for path in folder.rglob("*")}


def make_route(root: Path) -> Path:
    """A synthetic route of eight places in ``root``, the settings ``quick.toml``, and a model ``m.lvpr``."""
    write_traverses(root, PLACES, 0)
    (root / "quick.toml").write_text(CONFIG)
    run("train", root / "reference", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    return root


@contextmanager
def linked_route(made: Path, folder: Path) -> Iterator[Path]:
    """A folder to work in that sees what was made; whatever is written through the links is an error at the end."""
    before = _files(made)
    for entry in made.iterdir():
        os.symlink(entry, folder / entry.name)
    yield folder
    assert _files(made) == before, "written through a link, where the tests that follow see it"


def _files(folder: Path) -> dict[Path, tuple[int, int, int]]:
    """What changes when a file below ``folder`` is written."""
    found = ((path, path.stat()) for path in folder.rglob("*") if path.is_file())
    return {path: (stat.st_ino, stat.st_size, stat.st_mtime_ns) for path, stat in found}


def figures(*words: object) -> dict[str, Any]:
    """What ``eval m.lvpr words --json`` writes."""
    run("eval", "m.lvpr", *words, "--json", "f.json")
    return dict(json.loads(Path("f.json").read_text()))


def recall(values: dict[str, Any], name: str = "contrast") -> float:
    """R@1 of one matcher."""
    return float({**values["decoders"], **values["baselines"]}[name]["recall_at_1"])


def matches(*words: object) -> list[dict[str, str]]:
    """What ``query m.lvpr words`` writes."""
    run("query", "m.lvpr", *words, "-o", "q.csv")
    with Path("q.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def images(folder: str) -> list[Path]:
    """The images of a folder, in order."""
    return sorted(Path(folder).iterdir())


def listed(name: str, paths: list[Path]) -> str:
    """A list file of images."""
    Path(name).write_text("".join(f"{path}\n" for path in paths))
    return name


class Terminal(io.StringIO):
    """What a terminal was sent."""

    def isatty(self) -> bool:
        return True

    @property
    def said(self) -> str:
        """The text, without colours and moves."""
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", self.getvalue())


def opened(monkeypatch: pytest.MonkeyPatch, width: int = 200) -> Terminal:
    """A terminal of so many columns until the end of the test; not from a fixture: pytest puts its own streams back.

    The console of the commands stays the same object, in another state: a module that is loaded meanwhile keeps it.
    """
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    other = common.PlainConsole(file=shown, width=width, force_terminal=True)
    monkeypatch.setattr(common.stderr, "__dict__", vars(other))
    return shown
