"""The front end's cores: what they hold is what was counted, and what a board cannot hold is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.deploy.mapping.front_end_images import front_end_images
from lava_vpr.deploy.registers.synapse_memory import unpack
from lava_vpr.deploy.registers.synapses import SynapseFormat
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd

SPEC = FrontEnd(width=8)


@pytest.mark.parametrize("board", [KAPOHO_BAY, replace(KAPOHO_BAY, compartments=60, axons_out=150)])
def test_cores_hold_what_the_plan_counted(board: Board) -> None:
    plan, made = placed(SPEC, board), front_end_images(SPEC, board, ())
    cores = {(core.chip, core.core): core for core in made.cores}
    assert len(cores) == len(made.cores) == plan.cores
    for name, each in plan.populations.items():
        own = [cores[place] for place in sorted({(chip, core) for chip, core, _ in made.tables[name].tolist()})]
        assert [len(core.compartments) for core in own] == each.sizes.tolist()
        assert max(len(core.axons_in) for core in own) == each.axons_in
        assert max(len(core.axons_out) for core in own) == each.axons_out
        assert max(len(core.synapses) for core in own) / plan.board.memory.capacity == pytest.approx(each.memory)
        assert sum(int(core.axons_in[:, 2].sum()) for core in own) == each.stored


def test_no_row_has_two_synapses_to_one_neuron() -> None:
    """Whether two of a row add up is unproven: nengo-loihi's emulator counts the last alone."""
    for core in front_end_images(SPEC, KAPOHO_BAY, ()).cores:
        forms = [None if form is None else SynapseFormat.of(form, core.name) for form in core.registers["synapseFmt"]]
        rows = unpack(core.synapses, core.axons_in, forms, len(core.compartments), core.name)
        ways = np.column_stack([np.repeat(np.arange(len(core.axons_in)), np.diff(rows.starts)), rows.compartments])
        assert len(np.unique(ways, axis=0)) == len(ways) > 0


def test_every_input_axon_has_one_source() -> None:
    made = front_end_images(SPEC, KAPOHO_BAY, ())
    out = np.concatenate([core.axons_out[:, 1:] for core in made.cores]).tolist()
    into = [[core.chip, core.core, axon] for core in made.cores for axon in range(len(core.axons_in))]
    assert sorted(out) == sorted(into)


@pytest.mark.parametrize(
    ("spec", "taken", "words"),
    [
        (SPEC, 250, r"^7 cores and 250 of the network, but Kapoho Bay \(two Loihi 1 chips\) has 256$"),
        (FrontEnd(width=8, window=8), 0, r"^no public source shows how events of a camera come to axons of the chip$"),
    ],
)
def test_what_a_board_cannot_hold_is_refused(spec: FrontEnd, taken: int, words: str) -> None:
    used = [divmod(core, KAPOHO_BAY.cores) for core in range(taken)]
    with pytest.raises(NetworkLimitError, match=words):
        front_end_images(spec, KAPOHO_BAY, used)
