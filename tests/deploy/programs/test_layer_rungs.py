"""The ladder's rungs of a front end's layers: they hold on sound registers, and tell what fails."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards.host_programs import Made
from support.boards.kapoho_board import Board, climb_here, edited, layout, make, random_network

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.front_end import front_end_files
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import GeneralNetwork, Population, Synapses, simulate
from lava_vpr.inputs.front_end import FrontEnd

LAYERS = ["clock", "pixels", "filters", "pairs", "onsets", "cells", "pools"]
NAMES = [f"front end: {layer}" for layer in LAYERS]


def made_with_a_front_end(folder: Path) -> Made:
    """A bundle that holds one."""
    files, _ = front_end_files(FrontEnd(width=8, levels=8, race=6, budget=20), KAPOHO_BAY, [(0, 0)])
    return make(folder, layout("one core", random_network(3, signed=True, threshold=30), 0.0), front_end=files)


def test_there_is_one_for_each_layer_and_none_without(board: Board, tmp_path: Path) -> None:
    assert list(FrontEnd().populations) == LAYERS
    report = climb_here(board, made_with_a_front_end(tmp_path))
    assert report["passed"]
    assert [rung["name"] for rung in report["rungs"]][-9:-2] == NAMES
    for rung in report["rungs"][-9:-2]:
        assert rung["proves"], rung
        assert np.unique(rung["expected"]).size > 1, rung  # some spike more often than others, or not at all


@pytest.mark.parametrize("steps", [13, 61, 125])
def test_their_counts_are_the_general_simulators(program: Any, steps: int) -> None:
    """Each neuron is a population there, reset at the start of a presentation."""
    silent = 3
    for rung in program.layer_rungs.layer_rungs(steps, heard=True):
        n, interval, mantissas = len(rung.neurons), steps + silent, np.array(rung.biases)
        neurons = tuple(
            Population(np.array([threshold]), mantissas[:, [i]], np.full((2, 1), 6), LifParameters(du, dv), interval)
            for i, (du, dv, threshold) in enumerate(rung.neurons)
        )
        synapses = tuple(
            Synapses(
                source,
                target,
                np.array([[weight >> 7 if abs(weight) > 127 else weight]]),
                exponent=7 if abs(weight) > 127 else 0,
                sign="excitatory" if weight > 0 else "inhibitory",
            )
            for source, target, weight in rung.synapses
        )
        films = simulate(GeneralNetwork(1, neurons, synapses), np.zeros((2 * interval, 1), bool)).spikes
        counts = np.stack([film.reshape(2, interval).sum(axis=1) for film in films], axis=1)
        assert counts.shape == (2, n)
        assert rung.counts(steps, silent) == counts.tolist(), rung.name


FORMATS = "setattr(own.synapseFmt[i], name, "
BOARD, CHIP, LINK = "board_device.py", "embedded.c", "board_link.py"
WRONG: dict[str, tuple[str, str, str, list[str]]] = {
    "currents are gone": (
        BOARD,
        "configure(**profile)",
        "configure(**dict(profile, decayU=4095))",
        ["filters", "cells", "pools"],
    ),
    "currents outlive a query": (CHIP, "{.U = 0, .V", "{.U = own->cx_state[compartment].U, .V", ["filters", "pools"]),
    "exponents of rows": (BOARD, f"{FORMATS}value", f"{FORMATS}min(value, 0) if name == 'wgtExp' else value", LAYERS),
    "biases": (LINK, "pieces(query.biases[self.chip], ROOM)", "pieces(0 * query.biases[self.chip], ROOM)", LAYERS),
}
"""What the board gets wrongly: file, text, what becomes of it, and the layers whose rungs must fail."""


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_fails_their_rungs(board: Board, tmp_path: Path, name: str) -> None:
    file, old, new, layers = WRONG[name]
    made = made_with_a_front_end(tmp_path)
    report = climb_here(edited(board, made, file, old, new), made, *NAMES)
    assert [row["name"] for row in report["rungs"] if not row["passed"]] == [f"front end: {layer}" for layer in layers]


def test_the_program_of_a_deployed_bundle_climbs_them(board: Board, tmp_path: Path) -> None:
    made = made_with_a_front_end(tmp_path)
    for simulate_it in (["--simulate"], []):
        ended = board.run(made, "--ladder", tmp_path / "ladder.json", *simulate_it)
        assert (ended.code, ended.err) == (0, ""), ended.out
        well = [line.split(": ")[1] for line in ended.out.splitlines() if line.startswith("ok front end")]
        assert well == LAYERS
