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


def pytest_configure() -> None:
    """Throw away compiled kernels that are older than any of the engine's sources.

    numba looks only at the file a function stands in; a kernel with another file's function inlined would go stale.
    """
    engine = Path(__file__).parents[1] / "lava_vpr"
    for folder in (engine, engine / "engine"):
        newest = max(path.stat().st_mtime for path in (engine / "engine").glob("*.py"))
        for path in folder.glob("__pycache__/*.nb[ci]"):
            if path.stat().st_mtime < newest:
                path.unlink(missing_ok=True)
