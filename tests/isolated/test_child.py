"""Programs that are run to their end: what they say is kept, and nothing of them outlives the call."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.common import children

from lava_vpr.isolated.child import environment_without_python, run_child

SPAWN = (
    "import pathlib, subprocess, sys, time; child = subprocess.Popen([sys.executable, '-c', 'import time; "
    "time.sleep(60)']); pathlib.Path(sys.argv[1]).write_text(str(child.pid)); {then}"
)


def python(source: str, *words: str | Path) -> list[str | Path]:
    return [sys.executable, "-c", source, *words]


def test_what_a_program_says_is_kept(tmp_path: Path) -> None:
    source = (
        "import os, sys; print(os.getcwd(), os.environ['WORD']); print('a\\n\\n b \\n', file=sys.stderr); sys.exit(3)"
    )
    ended = run_child(python(source), seconds=60, folder=tmp_path, environment={**os.environ, "WORD": "w"})
    assert (ended.code, ended.out, ended.last) == (3, f"{tmp_path} w\n", "b")


def test_one_that_says_nothing_has_no_last_word() -> None:
    assert run_child(python(""), seconds=60) == (0, "", "")
    assert run_child(python(""), seconds=60).last == ""


def test_one_that_cannot_be_started() -> None:
    with pytest.raises(FileNotFoundError):
        run_child(["/nowhere/program"], seconds=1)


@pytest.mark.quick(1)
@pytest.mark.parametrize("then", ["time.sleep(60)", "sys.stdout.close(); sys.exit(0)"])
def test_nothing_outlives_the_call(then: str, tmp_path: Path) -> None:
    """Neither one that takes too long, nor what one that ended has started: it would keep the pipes open."""
    seconds = 1.0
    while not (tmp_path / "pid").exists():  # a busy machine takes its time to start two programs
        with pytest.raises(subprocess.TimeoutExpired):
            run_child(python(SPAWN.format(then=then), tmp_path / "pid"), seconds=seconds)
        seconds *= 3
    pid = int((tmp_path / "pid").read_text())
    assert children.until(lambda: children.gone(pid), 1)


def test_an_environment_without_pythons_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/elsewhere")
    kept = environment_without_python()
    assert "PYTHONPATH" not in kept
    assert kept["PATH"] == os.environ["PATH"]
