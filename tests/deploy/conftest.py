"""The stand-in board of the tests of deployment, and the modules of its program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.boards.kapoho_board import _objects, board, flat, load_program  # noqa: F401


@pytest.fixture(scope="module")
def program(flat: Path) -> Any:  # noqa: F811
    """The modules of the program for Kapoho Bay, of which `rungs` is every board's."""
    return load_program(flat)
