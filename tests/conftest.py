"""Shared fixtures."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.common.commands import link_route, make_route


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder with real images and the decoder oracle, or skip."""
    root = os.environ.get("LAVA_VPR_DATA", "")
    if not root or not (Path(root) / "data").is_dir():
        pytest.skip("needs real images: set LAVA_VPR_DATA to the folder that holds data/ and oracle/")
    return Path(root)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic route and a model of it; never written to."""
    return make_route(tmp_path_factory.mktemp("made") / "w")


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own to work in, which sees what was made."""
    monkeypatch.chdir(tmp_path)
    return link_route(made, tmp_path)
