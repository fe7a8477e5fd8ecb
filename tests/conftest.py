"""Shared fixtures."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder with real images and the decoder oracle, or skip."""
    root = os.environ.get("LAVA_VPR_DATA", "")
    if not root or not (Path(root) / "data").is_dir():
        pytest.skip("needs real images: set LAVA_VPR_DATA to the folder that holds data/ and oracle/")
    return Path(root)
