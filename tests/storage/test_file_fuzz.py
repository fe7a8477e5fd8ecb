"""Honest files changed at random: what is taken is sound, by a checker that shares no code with the readers."""

from __future__ import annotations

import ast
import random
import subprocess
import sys
from pathlib import Path

import pytest
from support.common import children
from support.fuzz.files import bundles, cases, corpus, lists
from support.fuzz.files.cases import Case
from support.fuzz.files.corpus import Corpus
from support.fuzz.files.trial import SOUND, tried

ROOT = Path(__file__).resolve().parents[2]
CHECKER = ROOT / "tests" / "support" / "fuzz" / "soundness"
ALLOWED = {
    "ast",
    "collections",
    "csv",
    "hashlib",
    "io",
    "json",
    "math",
    "os",
    "pathlib",
    "re",
    "stat",
    "struct",
    "typing",
}
ALLOWED |= {"zlib", "xml", "numpy", "tomli", "support", "__future__"}


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    """The honest files."""
    return corpus.make(tmp_path_factory.mktemp("honest"))


def whole(made: Corpus, kind: str, name: str) -> Case:
    """An honest file as a case that changes nothing; all commands are tried with it."""
    contents = {
        "model": lambda: {"m.lvpr": made.models[name]},
        "bundle": lambda: made.bundles[name],
        "checkpoint": lambda: {"n.lvpr.checkpoint": made.checkpoints[name]},
        "settings": lambda: {"settings.toml": made.texts[name]},
        "list": lambda: {name: lists.HONEST[name]},
    }
    return Case(0, 0, kind, name, "nothing", contents[kind](), draw=0.0)


HONEST = [
    *(("model", name) for name in corpus.SETTINGS),
    *(("bundle", name) for name in corpus.BUNDLES),
    *(("checkpoint", name) for name in corpus.INTERRUPTED),
    *(("settings", name) for name in corpus.SETTINGS),
    *(("list", name) for name in lists.HONEST),
]


@pytest.mark.parametrize(("kind", "name"), HONEST)
def test_honest_files_are_taken_and_sound(honest: Corpus, kind: str, name: str) -> None:
    outcome = tried(whole(honest, kind, name), honest)
    assert outcome.kind == SOUND, outcome.told


def test_a_bundle_sealed_again_is_the_same(honest: Corpus) -> None:
    for files in honest.bundles.values():
        again = bundles.sealed(files)
        assert corpus.manifest_of(again) == corpus.manifest_of(files)


def test_seed_and_number_decide_a_case(honest: Corpus) -> None:
    first, again = (cases.make(honest, 3, number) for number in (17, 17))
    assert first == again
    assert first.files == again.files
    assert len({cases.make(honest, 3, number).told for number in range(30)}) > 25
    random.seed(5)  # nobody's but the case's own generator is asked
    assert cases.make(honest, 3, 17).files == first.files


def test_the_checker_shares_no_code_with_the_readers() -> None:
    modules = sorted(CHECKER.glob("*.py"))
    assert len(modules) >= 8
    for module in modules:
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert name.split(".")[0] in ALLOWED, f"{module.name} imports {name}"
                assert not name.startswith("support.") or name.startswith("support.fuzz.soundness"), module.name
        assert "__import__" not in module.read_text(encoding="utf-8")


def run(*words: str) -> subprocess.CompletedProcess[str]:
    """Run the fuzzer in a process of its own, whose workers are forked before any thread is started."""
    command = [sys.executable, "-m", "support.fuzz.files.run", *words]
    environment = {"PYTHONPATH": str(ROOT / "tests"), "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    return children.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
