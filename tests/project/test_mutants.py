"""The faults of scripts/mutants.toml fit the code: `scripts/mutants.py` can try each of them."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


def script() -> ModuleType:
    """scripts/mutants.py."""
    spec = importlib.util.spec_from_file_location("mutants", ROOT / "scripts" / "mutants.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MUTANTS = script().mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_fault_fits_the_code_and_has_a_test(mutant: Any) -> None:
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    assert ast.dump(ast.parse(mutant.applied(text))) != ast.dump(ast.parse(text))
    tests = ast.parse((ROOT / mutant.tests).read_text(encoding="utf-8")).body
    assert mutant.test in {node.name for node in tests if isinstance(node, ast.FunctionDef)}


def test_every_fault_has_a_name_of_its_own() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS)


def test_words_that_choose_no_fault_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a test to run, pytest would run all."""
    program = script()
    monkeypatch.setattr(program, "tested", lambda *_: pytest.fail("it ran tests"))
    with pytest.raises(SystemExit, match="no row has --help in its name or file"):
        program.main(["--help"])
