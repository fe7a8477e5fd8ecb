"""The stand-in board of the tests of deployment, and the modules of its program."""

from __future__ import annotations

from typing import Any

import pytest
from support.boards import host_programs
from support.boards.kapoho_board import board, load_program  # noqa: F401


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The modules of the program for Kapoho Bay, of which `rungs` is every board's."""
    return load_program(host_programs.flat("kapoho_bay", tmp_path_factory.mktemp("flat") / "program"))
