"""A folder to damage, for tests of what commands refuse."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from support.common.commands import SHORT, run
from support.common.imagefiles import write_images


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of six places, their model ``m.lvpr``, its bundle ``b``, and ``m4.lvpr`` of four; tests work on copies."""
    root = tmp_path_factory.mktemp("good")
    write_images(root / "ref", 6)
    write_images(root / "query", 6)
    (root / "quick.toml").write_text(SHORT)
    run("train", root / "ref", "-o", root / "m.lvpr", "--config", root / "quick.toml")
    run("train", root / "ref", "-o", root / "m4.lvpr", "--config", root / "quick.toml", "--places", "0:4")
    run("deploy", root / "m.lvpr", "--target", "loihi2", "-o", root / "b")
    (root / "list.txt").write_text("".join(f"query/img{k}.png\n" for k in range(6)))
    (root / "gt.txt").write_text("".join(f"{k}: {k}\n" for k in range(6)))
    (root / "xy.csv").write_text("x,y\n" + "".join(f"{k},0\n" for k in range(6)))
    return root


@pytest.fixture
def place(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(good, tmp_path / "w")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"
