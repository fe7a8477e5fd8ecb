"""The rooms of the house: folders of few modules, packages that say what they hold, tests that mirror them, one name
for one thing; and docs/architecture.md is a true map: its rooms, walks and recipes are held against the tree."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
TOP = ("lava_vpr", "processes", "deploy", "benchmarks", "tests")
MOST_MODULES = 16
PROGRAMS = ROOT / "deploy" / "programs"
"""Programs that no module imports: each of their folders is named as a whole."""
STANDINS = TESTS / "support" / "standins"
NOT_ROOMS = {"core", "project", "support"}
"""Folders of tests that mirror none: of the modules on the package's top floor, of the project, and the helpers."""
MEASURED = {
    "bench/test_workload.py": {"benchmarks.neurobench"},
    "core/test_fast.py": {"benchmarks.recall", "benchmarks.results"},
    "core/test_real_images.py": {"benchmarks.recall", "benchmarks.results"},
    "project/test_docs.py": {"benchmarks.__main__", "benchmarks.figures", "benchmarks.recall"},
    "project/test_pages.py": {"benchmarks.figures", "benchmarks.commands", "benchmarks.__main__"},
    "engine/test_conductance.py": {"benchmarks.peers"},
    "support/fuzz/run.py": {"benchmarks.figures"},
}
"""Tests that hold what a benchmark prints to its promise, and which; all others of them are in tests/benchmarks."""


def modules(folder: Path) -> list[Path]:
    """The modules that stand in ``folder`` itself, its ``__init__.py`` not counted."""
    return sorted(path for path in folder.glob("*.py") if path.name != "__init__.py")


def folders() -> list[Path]:
    """Every folder with code."""
    return sorted({path.parent for top in TOP for path in (ROOT / top).rglob("*.py")})


@cache
def texts() -> dict[Path, str]:
    """What every file of the tests says, by its path."""
    return {path: path.read_text(encoding="utf-8") for path in TESTS.rglob("*.py")}


@cache
def imports(path: Path) -> set[str]:
    """The names of the modules that a file imports, wherever in it."""
    text = texts()[path] if path in texts() else path.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(text)))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    parents = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
    return plain | {f"{node.module}.{alias.name}" for node in parents for alias in node.names}


def test_no_room_is_a_pile() -> None:
    crowded = {str(folder.relative_to(ROOT)): len(modules(folder)) for folder in folders()}
    assert len(crowded) > 60
    assert {name: count for name, count in crowded.items() if count > MOST_MODULES} == {}


def test_every_package_says_what_it_holds() -> None:
    """Programs and stand-ins are no packages of ours: what they are copied or put beside decides."""
    packages = [
        path
        for path in (ROOT / top / "__init__.py" for top in TOP if top != "tests")
        for path in path.parent.rglob("__init__.py")
    ]
    packages += [path for path in TESTS.rglob("__init__.py") if not path.is_relative_to(STANDINS)]
    assert len(packages) > 40
    silent = [str(path.relative_to(ROOT)) for path in packages if not ast.get_docstring(ast.parse(path.read_text()))]
    assert silent == []
    without = {folder for folder in folders() if not folder.is_relative_to(TESTS)} - {path.parent for path in packages}
    assert {folder for folder in without if not folder.is_relative_to(PROGRAMS)} == set()


def test_tests_stand_where_what_they_test_stands() -> None:
    for folder in {path.parent.relative_to(TESTS) for path in TESTS.rglob("test_*.py")}:
        if folder.parts[0] not in NOT_ROOMS:
            rooms = [ROOT / folder, ROOT / "lava_vpr" / folder]
            assert any(room.is_dir() for room in rooms), f"tests/{folder} is no room's"
    assert not list(TESTS.glob("test_*.py"))


def test_no_test_imports_another() -> None:
    for path in texts():
        others = [name for name in imports(path) if re.search(r"(^|\.)(test_\w+|conftest)(\.|$)", name)]
        assert others == [], path


def test_what_is_taken_from_benchmarks() -> None:
    """The real images of `benchmarks.places`, and what is itself tested."""
    for path in texts():
        name = str(path.relative_to(TESTS))
        taken = {".".join(found.split(".")[:2]) for found in imports(path) if found.startswith("benchmarks.")}
        if not name.startswith("benchmarks/"):
            assert taken - {"benchmarks.places"} == MEASURED.get(name, set()), name


def test_the_package_imports_nothing_of_the_evidence() -> None:
    """Simulators, peers and other packages are evidence beside the package: it runs without benchmarks and scripts."""
    evidence = re.compile(r"\b(benchmarks|scripts|support)\b")
    product = [path for top in ("lava_vpr", "processes", "deploy") for path in (ROOT / top).rglob("*.py")]
    named = [path for path in product if evidence.search(path.read_text(encoding="utf-8"))]
    assert {path: names for path in named if (names := {name for name in imports(path) if evidence.match(name)})} == {}


HELPERS = [path for path in sorted((TESTS / "support").rglob("*.py")) if not path.is_relative_to(STANDINS)]


@pytest.mark.parametrize("module", HELPERS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_helper_says_who_uses_it(module: Path) -> None:
    """The last sentence of its docstring: "Used by ", and the rooms of tests that import it, or name it or its file."""
    if module.name in ("__init__.py", "models.py"):  # Lava finds a Process's models beside it
        return
    dotted = ".".join(module.relative_to(TESTS).with_suffix("").parts)
    parent, _, name = dotted.rpartition(".")
    file = f'"{module.parent.name}" / "{module.name}"'
    used = re.compile(rf"{re.escape(dotted)}\b|from {re.escape(parent)} import [^\n]*\b{name}\b|{re.escape(file)}")
    users = {
        path.relative_to(TESTS).parts[0] if path.parent != TESTS else "conftest"
        for path, text in texts().items()
        if path != module and used.search(text)
    }
    said = re.search(r"Used by ([a-z_,\s]+)\.$", ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or "")
    assert said is not None, f"{dotted}: say who uses it: {', '.join(sorted(users))}"
    assert set(re.split(r",\s+|\s+and\s+", said[1])) == users


def test_no_benchmark_hides_a_package() -> None:
    """A program run in an environment of its own finds the modules beside it before the packages that it needs."""
    for folder in (place for place in folders() if place.is_relative_to(ROOT / "benchmarks")):
        beside = {path.stem for path in modules(folder)}
        for path in modules(folder):
            needed = {name.split(".")[0] for name in imports(path)}
            assert not needed & beside, f"{path}: {needed & beside}"


PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def part(title: str) -> str:
    """The text below a heading of the second level."""
    (found,) = re.findall(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    return str(found)


@cache
def rooms() -> dict[str, list[str]]:
    """The folders that the page's table of rooms names, with the modules that it names in each."""
    rows = re.findall(r"^\| `([a-z_/]+)/` \| (.*) \|$", part("Rooms"), re.MULTILINE)
    assert len({name for name, _ in rows}) == len(rows), "a room stands twice"
    return {name: re.findall(r"`([a-z_0-9]+)`", text.rpartition("|")[2]) for name, text in rows}


def is_process(folder: Path) -> bool:
    """Whether a folder holds one Process: these are listed in docs/lava.md."""
    return (folder / "process.py").is_file()


@cache
def folders_here() -> dict[str, set[str]]:
    """Every folder with modules, and their names; of a Process's folder, and of dunder files, only that they are."""
    found: dict[str, set[str]] = {}
    for top in TOP[:-1]:
        for path in sorted((ROOT / top).rglob("*.py")):
            folder = path.parent
            if is_process(folder) or folder.is_relative_to(PROGRAMS):
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


FOLDERS = ("lava_vpr", "deploy", "processes", "benchmarks", "scripts", "examples")


def test_a_class_name_means_one_thing() -> None:
    homes = defaultdict(list)
    for path in (path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if re.search(r"^\s*class ", text, re.MULTILINE) else ():
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert "Localizer" in homes
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}
