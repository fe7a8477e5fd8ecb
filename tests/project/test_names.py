"""One name, one thing: no two classes of the project share a name."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("lava_vpr", "deploy", "processes", "benchmarks", "scripts", "examples")


def test_a_class_name_means_one_thing() -> None:
    homes = defaultdict(list)
    for path in (path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert "Localizer" in homes
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}
