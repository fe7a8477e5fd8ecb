"""Two programs at once, readers who go away, closed folders: what only whole processes show."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.common import children
from support.common.imagefiles import write_images

SLOW = "[network]\nsteps = 128\n[learning]\nsteps = 100\nepochs = 10000\n"
QUICK = SLOW.replace("10000", "2")


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "lava_vpr", *map(str, words)]


@pytest.fixture
def here(tmp_path: Path) -> Path:
    write_images(tmp_path / "ref", 6)
    (tmp_path / "slow.toml").write_text(SLOW)
    (tmp_path / "quick.toml").write_text(QUICK)
    return tmp_path


def test_a_second_training_of_the_same_model_is_refused(here: Path) -> None:
    with children.Child(command("train", "ref", "-o", "m.lvpr", "--config", "slow.toml"), cwd=here):
        children.until((here / ".m.lvpr.lock").exists, 120)
        second = children.run(
            command("train", "ref", "-o", "m.lvpr", "--config", "quick.toml"),
            cwd=here,
            capture_output=True,
            text=True,
        )
        assert second.returncode == 1
        assert second.stderr == (
            "lava-vpr: error: m.lvpr: another training is writing it; wait, or choose another name\n"
        )
    # A killed training holds nothing back.
    (here / "m.lvpr.checkpoint").unlink(missing_ok=True)
    children.run(command("train", "ref", "-o", "m.lvpr", "--config", "quick.toml"), cwd=here, check=True)
    assert sorted(path.name for path in here.iterdir()) == ["m.lvpr", "quick.toml", "ref", "slow.toml"]


def test_a_reader_who_goes_away_loses_nothing(here: Path) -> None:
    children.run(command("train", "ref", "-o", "m.lvpr", "--config", "quick.toml"), cwd=here, check=True)
    process = children.Child(
        command("eval", "m.lvpr", "ref", "--json", "f.json"),
        cwd=here,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    errors = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=120) == 0
    assert errors == b""
    assert (here / "f.json").stat().st_size > 500


def test_narrow_terminals_keep_the_figures(here: Path) -> None:
    children.run(command("train", "ref", "-o", "m.lvpr", "--config", "quick.toml"), cwd=here, check=True)
    shown = children.run(
        command("eval", "m.lvpr", "ref"),
        cwd=here,
        env={**os.environ, "COLUMNS": "40"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in ("R@1", "R@100P", "P@100R", "AUC", "weighted_probability", "contrast *"):
        assert name in shown
    assert "…" not in shown
