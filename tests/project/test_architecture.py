"""docs/architecture.md is a true map: its rooms, walks and recipes are held against the tree."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
TOP = ("lava_vpr", "processes", "deploy", "benchmarks")
STAND_ALONE = Path("deploy/programs")
"""Programs that no module imports: each of their folders is named as a whole."""


def part(title: str) -> str:
    """The text below a heading of the second level."""
    (found,) = re.findall(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    return str(found)


def rooms() -> dict[str, list[str]]:
    """The folders that the page's table of rooms names, with the modules that it names in each."""
    rows = re.findall(r"^\| `([a-z_/]+)/` \| (.*) \|$", part("Rooms"), re.MULTILINE)
    assert len({name for name, _ in rows}) == len(rows), "a room stands twice"
    return {name: re.findall(r"`([a-z_0-9]+)`", text.rpartition("|")[2]) for name, text in rows}


def is_process(folder: Path) -> bool:
    """Whether a folder holds one Process: these are listed in docs/lava.md."""
    return (folder / "process.py").is_file()


def folders_here() -> dict[str, set[str]]:
    """Every folder with modules, and their names; of a Process's folder, and of dunder files, only that they are."""
    found: dict[str, set[str]] = {}
    for top in TOP:
        for path in sorted((ROOT / top).rglob("*.py")):
            folder = path.parent
            if is_process(folder) or folder.relative_to(ROOT).is_relative_to(STAND_ALONE):
                continue
            names = found.setdefault(str(folder.relative_to(ROOT)), set())
            if not path.stem.startswith("__"):
                names.add(path.stem)
    return found


def test_every_room_is_on_the_map_and_no_other() -> None:
    assert set(rooms()) == set(folders_here())


@pytest.mark.parametrize("room", sorted(folders_here()))
def test_a_room_holds_what_the_map_says(room: str) -> None:
    assert sorted(rooms()[room]) == sorted(folders_here()[room])


def defined(path: Path, name: str) -> bool:
    """Whether a module defines a function, class or method of this name at its top or in a class."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    owner, _, method = name.rpartition(".")
    bodies = (
        [tree.body] if not owner else [n.body for n in tree.body if isinstance(n, ast.ClassDef) and n.name == owner]
    )
    kinds = (ast.FunctionDef, ast.ClassDef)
    return any(isinstance(node, kinds) and node.name == method for body in bodies for node in body)


STEPS = re.findall(r"^\d+\. `([\w.]+)` in `([\w/]+\.py)`", part("Three walks"), re.MULTILINE)


@pytest.mark.parametrize(("name", "path"), STEPS, ids=[name for name, _ in STEPS])
def test_a_walk_passes_functions_that_exist(name: str, path: str) -> None:
    assert defined(ROOT / path, name)


def recipes() -> dict[str, str]:
    """The text of each recipe by its title."""
    found = re.findall(r"^### (.+?)\n(.*?)(?=^### |\Z)", part("Recipes"), re.MULTILINE | re.DOTALL)
    return {title: text for title, text in found}


def test_there_are_walks_recipes_and_an_hour_to_check() -> None:
    assert len(STEPS) >= 20
    assert {"A decoder", "An input", "A Process", "A backend", "A board", "A dataset"} <= set(recipes())
    assert len(re.findall(r"^\d+\. `([\w/]+\.py)`", part("Read this code in an hour"), re.MULTILINE)) == 8


@pytest.mark.parametrize("title", sorted(recipes()))
def test_a_recipe_names_files_and_symbols_that_exist(title: str) -> None:
    """A file of the recipe exists unless it is marked as new; so does what the recipe says it defines."""
    lines = re.findall(r"^- `([\w/.-]+)`(.*)$", recipes()[title], re.MULTILINE)
    assert lines
    for path, rest in lines:
        if rest.startswith(" (new)"):
            assert not (ROOT / path).exists()
            assert (ROOT / path).parent.exists() or "NAME" in path
            continue
        assert (ROOT / path).exists(), path
        for name in re.findall(r"`([A-Za-z_][A-Za-z_0-9]*)`", rest):
            assert re.search(rf"\b{name}\b", (ROOT / path).read_text(encoding="utf-8")), f"{path}: {name}"


def test_every_file_that_the_page_names_exists() -> None:
    for path in re.findall(r"`((?:lava_vpr|processes|deploy|benchmarks|tests|docs|scripts)/[\w/]+\.\w+)`", PAGE):
        assert (ROOT / path).exists() or "NAME" in path, path
