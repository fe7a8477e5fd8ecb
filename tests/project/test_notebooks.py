"""The notebooks are sound and clean; CI executes them."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import re
from pathlib import Path
from typing import Any

import pytest

from lava_vpr.processes import __all__ as names_of_processes

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = {path.stem: path for path in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))}
READ: dict[str, dict[str, Any]] = {
    name: json.loads(path.read_text(encoding="utf-8")) for name, path in NOTEBOOKS.items()
}
CODE: dict[str, list[dict[str, Any]]] = {
    name: [cell for cell in notebook["cells"] if cell["cell_type"] == "code"] for name, notebook in READ.items()
}
EACH = pytest.mark.parametrize("name", NOTEBOOKS)

# What begins a path of a machine: one of the folders at its root, or a drive. A slash between words does not.
ABSOLUTE = re.compile(r"(?<![\w./])(?:/(?:home|root|tmp|usr|work|var|opt|mnt|Users|private)\b|[A-Z]:\\)")


def source(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


def texts(cell: dict[str, Any]) -> list[str]:
    """All text of a code cell's stored outputs."""
    found = []
    for output in cell["outputs"]:
        found.append("".join(output.get("text", "")))
        found += ["".join(v) for kind, v in output.get("data", {}).items() if kind.startswith("text/")]
    return found


def test_there_are_five() -> None:
    assert set(NOTEBOOKS) == {"deploy", "first_map", "front_end", "lava_processes", "learning"}


@EACH
def test_it_is_a_notebook_of_format_4(name: str) -> None:
    cells = READ[name]["cells"]
    assert READ[name]["nbformat"] == 4
    assert len(CODE[name]) >= 5
    assert len({cell["id"] for cell in cells}) == len(cells)
    for cell in cells:
        assert cell["cell_type"] in ("markdown", "code")
        assert source(cell).strip()


@EACH
def test_imports_lead_somewhere(name: str) -> None:
    for cell in CODE[name]:
        for node in ast.walk(ast.parse(source(cell))):
            if not isinstance(node, ast.ImportFrom) or not str(node.module).startswith("lava_vpr"):
                continue
            if node.module == "lava_vpr.processes":
                assert {taken.name for taken in node.names} <= set(names_of_processes)
                continue
            module = importlib.import_module(str(node.module))
            for taken in node.names:
                found = hasattr(module, taken.name) or importlib.util.find_spec(f"{node.module}.{taken.name}")
                assert found, f"{node.module}.{taken.name}"


def test_every_run_of_lava_is_stopped_in_its_cell() -> None:
    runs = 0
    for cell in CODE["lava_processes"]:
        for process in set(re.findall(r"^\s*(\w+)\.run\(", source(cell), re.MULTILINE)) - {"subprocess"}:
            runs += 1
            assert re.search(rf"^\s*{process}\.stop\(\)$", source(cell), re.MULTILINE), source(cell)
    assert runs >= 5


@EACH
def test_stored_outputs_are_those_of_one_run_from_the_top(name: str) -> None:
    assert [cell["execution_count"] for cell in CODE[name]] == list(range(1, len(CODE[name]) + 1))
    outputs = [output for cell in CODE[name] for output in cell["outputs"]]
    assert not any(output["output_type"] == "error" for output in outputs)
    assert any("image/png" in output.get("data", {}) for output in outputs)


@EACH
def test_no_machine_and_no_date_is_named(name: str) -> None:
    # That of the machine is what `scripts/run_notebook.py --save` itself looks for.
    forbidden = [ABSOLUTE, re.compile(r"\b20\d\d-\d\d-\d\d\b"), re.compile(r"\b\d\d:\d\d:\d\d\b")]
    for cell in CODE[name]:
        for text in (*texts(cell), source(cell)):
            for pattern in forbidden:
                assert not pattern.search(text), pattern.search(text)
        assert "stderr" not in [output.get("name") for output in cell["outputs"]]
        assert cell["metadata"] == {}
    assert set(READ[name]["metadata"]) == {"kernelspec", "language_info"}


@pytest.mark.parametrize("line", ["see /home/me/x", "in /tmp/a.py", "'/work/main'", r"C:\x"])
def test_an_absolute_path_is_noticed(line: str) -> None:
    assert ABSOLUTE.search(line)


@pytest.mark.parametrize("line", ["v / 64", "137/4096 a step", "docs/lava.md", "and/or", "route/query", "a/tmp"])
def test_other_slashes_are_not(line: str) -> None:
    assert not ABSOLUTE.search(line)


@EACH
def test_it_is_small(name: str) -> None:
    assert NOTEBOOKS[name].stat().st_size < 400_000
