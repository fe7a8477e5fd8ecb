"""The faults of scripts/mutants.toml fit the code: `scripts/mutants.py` can try each of them."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from scripts import mutants

ROOT = Path(__file__).resolve().parents[2]


MUTANTS = mutants.mutants()


@cache
def text_of(file: str) -> str:
    return (ROOT / file).read_text(encoding="utf-8")


@cache
def parsed(file: str) -> tuple[str, frozenset[str]]:
    """What a file says, layout aside, and the functions at its top."""
    tree = ast.parse(text_of(file))
    return ast.dump(tree), frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_fault_fits_the_code_and_has_a_test(mutant: Any) -> None:
    assert ast.dump(ast.parse(mutant.applied(text_of(mutant.file)))) != parsed(mutant.file)[0]
    assert mutant.test in parsed(mutant.tests)[1]


def test_every_fault_has_a_name_of_its_own() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS)


def test_words_that_choose_no_fault_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a test to run, pytest would run all."""
    monkeypatch.setattr(mutants, "tested", lambda *_: pytest.fail("it ran tests"))
    with pytest.raises(SystemExit, match="no row has --help in its name or file"):
        mutants.main(["--help"])
