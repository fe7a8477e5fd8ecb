"""Two programs at once, readers who go away, thousands of images in little memory: what only whole processes show."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common import children
from support.common.commands import run
from support.common.imagefiles import write_images

SLOW = "[network]\nsteps = 128\n[learning]\nsteps = 100\nepochs = 10000\n"
QUICK = SLOW.replace("10000", "2")


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "lava_vpr", *map(str, words)]


def learn(folder: Path) -> None:
    """The model ``m.lvpr``, learned in this process."""
    run("train", folder / "ref", "-o", folder / "m.lvpr", "--config", folder / "quick.toml")


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
    learn(here)
    assert sorted(path.name for path in here.iterdir()) == ["m.lvpr", "quick.toml", "ref", "slow.toml"]


def test_a_reader_who_goes_away_loses_nothing(here: Path) -> None:
    learn(here)
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
    assert errors.replace(children.COMPILING.encode(), b"") == b""
    assert (here / "f.json").stat().st_size > 500


def test_narrow_terminals_keep_the_figures(here: Path) -> None:
    learn(here)
    shown = children.run(
        command("eval", "m.lvpr", "ref"),
        cwd=here,
        env={**os.environ, "COLUMNS": "40"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in ("R@1", "R@5", "R@10", "R@100P", "contrast *", "cosine"):
        assert name in shown
    assert "…" not in shown
    assert max(len(line) for line in shown.splitlines() if line[0] in "┏┃┡│├└") <= 40  # in parts below each other


IMAGES = 3000
FILES = 40
LIMIT = 1_000_000_000  # bytes
FEW_STEPS = "[network]\nsteps = 32\n[learning]\nsteps = 40\nepochs = 1\n"


MEASURE = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
"""Starts a command from a process that holds little: Linux counts what the starter held as the command's own."""


def peak(folder: Path, *words: object) -> int:
    """Bytes that a command held at most, which must succeed."""
    command = [sys.executable, "-c", MEASURE, sys.executable, "-m", "lava_vpr", *map(str, words)]
    done = children.run(
        command, cwd=folder, capture_output=True, text=True, check=True, env={**os.environ, "MPLBACKEND": "Agg"}
    )
    code, most = map(int, done.stdout.split())
    assert code == 0
    needed = most * (1 if sys.platform == "darwin" else 1024)
    print(f"{words[0]}: at most {needed / 1e6:.0f} MB")  # shown by pytest -s
    return needed


def test_what_the_tests_hold_is_not_counted(tmp_path: Path) -> None:
    ballast = np.ones(40_000_000)
    assert peak(tmp_path, "--version") < ballast.nbytes


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few photographs of 640 x 480, each listed many times, and a second look at each."""
    root = tmp_path_factory.mktemp("memory")
    rng = np.random.default_rng(0)
    for k in range(FILES):
        scene = rng.integers(0, 200, (24, 32, 3)).astype(np.uint8)
        for season, light in (("summer", 0), ("winter", 40)):
            image = cv2.resize(scene + np.uint8(light), (640, 480), interpolation=cv2.INTER_CUBIC)
            cv2.imwrite(str(root / f"{season}{k}.jpg"), image)
    for season in ("summer", "winter"):
        (root / f"{season}.txt").write_text("".join(f"{season}{k % FILES}.jpg\n" for k in range(IMAGES)))
        rows = "".join(f"{20 * k},0\n" for k in range(IMAGES))
        (root / f"{season}.csv").write_text("x,y\n" + rows)
    (root / "gt.json").write_text(json.dumps([k % FILES for k in range(IMAGES)]))
    (root / "quick.toml").write_text(FEW_STEPS)
    return root


@pytest.mark.slow
def test_many_queries_of_a_short_route(place: Path) -> None:
    peak(place, "train", "summer.txt", "--places", f"0:{FILES}", "-o", "short.lvpr", "--config", "quick.toml")
    chosen = ("--places", f"0:{IMAGES}", "--gt", "gt.json")
    needed = peak(place, "eval", "short.lvpr", "winter.txt", *chosen, "--json", "short.json")
    assert json.loads((place / "short.json").read_text())["queries"] == IMAGES
    assert needed < LIMIT / 2


@pytest.mark.slow
def test_many_queries_of_a_long_route(place: Path) -> None:
    """3,000 images against 3,000 places; one matrix of scores is 72 MB."""
    assert peak(place, "train", "summer.txt", "-o", "long.lvpr", "--config", "quick.toml") < LIMIT
    options = ("--positions", "summer.csv", "winter.csv", "--radius", 25, "--sequence", 5, "--baseline", "sad")
    needed = peak(place, "eval", "long.lvpr", "winter.txt", *options, "--json", "long.json", "--report", "report")
    values = json.loads((place / "long.json").read_text())
    assert (values["queries"], values["places"]) == (IMAGES, IMAGES)
    assert needed < LIMIT
    assert peak(place, "query", "long.lvpr", "winter.txt", "-o", "long.csv", "--sequence", 5) < LIMIT
