"""A backend and a board are added by a row each, and every command knows them."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import PLACES, fails, figures, run

from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.interface import BackendRow, Presentations
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.board import BOARDS, KAPOHO_BAY, Board
from lava_vpr.deploy.bundle import targets
from lava_vpr.deploy.bundle.targets import TARGETS, Target
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.model import Model


class Dummy(HostBackend):
    """The host once more; it says what it does."""

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], dict[str, int]]:
        logging.getLogger("lava_vpr").warning("the dummy counts %d queries", len(shown.rates))
        return super().count_spikes(model, shown)


DUMMY_BACKEND = BackendRow(
    "dummy",
    "the host once more",
    make=lambda threads, advance: Dummy(Pool(threads)),
    unavailable=lambda: None,
    counts_only=True,
)
DUMMY_BOARD = replace(KAPOHO_BAY, name="dummy", title="Dummy", chips=1, cores=4, compartments=30)
DUMMY_TARGET = replace(TARGETS["kapoho-bay"], name="dummy")


@pytest.fixture
def backend() -> Iterator[None]:
    """With the backend ``dummy``."""
    BACKENDS.register(DUMMY_BACKEND)
    yield
    BACKENDS.remove("dummy")


@pytest.fixture
def board() -> Iterator[None]:
    """With the board ``dummy``."""
    BOARDS.register(DUMMY_BOARD)
    TARGETS.register(DUMMY_TARGET)
    yield
    TARGETS.remove("dummy")
    BOARDS.remove("dummy")


@pytest.mark.usefixtures("here", "backend")
def test_commands_use_a_new_backend() -> None:
    assert figures("query", "--backend", "dummy") == figures("query")
    told = run("eval", "m.lvpr", "query", "--backend", "dummy").stderr
    assert f"note: the dummy counts {PLACES} queries\n" in told
    result = run("verify", "m.lvpr", "query", "--limit", 2, "--backend", "dummy", "--json", "v.json")
    assert "every spike equal" in result.stdout
    verdict = json.loads(Path("v.json").read_text())["backends"]["dummy"]
    assert (verdict["available"], verdict["equal"], verdict["queries"]) == (True, True, 2)
    assert "the host once more" in run("doctor").stdout


@pytest.mark.usefixtures("here")
def test_a_backend_that_was_removed_is_unknown() -> None:
    assert "'dummy' is not one of 'host', 'lava-fixed'" in fails(
        "eval", "m.lvpr", "query", "--backend", "dummy", code=2
    )
    with pytest.raises(BackendUnavailableError, match=r"^there is no backend 'dummy'; choose from host, lava-fixed"):
        BACKENDS["dummy"]


@pytest.mark.usefixtures("here", "board")
def test_commands_use_a_new_board() -> None:
    assert "bits a weight" in run("fit", "--target", "dummy", "--weight-bits", 3).stdout
    run("fit", "m.lvpr", "--target", "dummy", "--json", "f.json")
    placed = json.loads(Path("f.json").read_text())
    assert placed["target"] == "dummy"
    assert all(sum(part["size"] for part in core["parts"]) <= 30 for core in placed["mapping"]["cores"])
    run("deploy", "m.lvpr", "--target", "dummy", "-o", "b")
    manifest = json.loads(Path("b/manifest.json").read_text())
    assert (manifest["target"], manifest["limits"]["cores"]) == ("dummy", 4)
    assert "# A place network for Dummy\n" in Path("b/README.md").read_text()
    result = run("verify", "b", "query", "--limit", 2, "--backend", "bundle")
    assert "every spike equal" in result.stdout


@pytest.mark.usefixtures("here")
def test_a_board_that_was_removed_is_unknown() -> None:
    assert "'dummy' is not one of 'kapoho-bay', 'loihi2'" in fails("fit", "m.lvpr", "--target", "dummy", code=2)


def test_a_board_without_a_target_is_refused() -> None:
    assert set(TARGETS) == set(BOARDS)
    BOARDS.register(DUMMY_BOARD)
    try:
        with pytest.raises(TypeError, match=r"^board 'dummy' has no target; register one in lava_vpr\.deploy\.bundle"):
            targets.check_targets()
    finally:
        BOARDS.remove("dummy")


def test_every_row_is_complete() -> None:
    assert all(isinstance(row, Board) for row in BOARDS.values())
    assert all(isinstance(row, Target) for row in TARGETS.values())
    assert {row.board for row in BACKENDS.values()} - {None} <= set(BOARDS)
    assert next(iter(BACKENDS)) == "host"
