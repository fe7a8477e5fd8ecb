"""The front end's cores: what they hold is what was counted, and what a board cannot hold is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.deploy.mapping.front_end_images import front_end_images, stored_weights
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import all_weights, populations

SPEC = FrontEnd(width=8)


@pytest.mark.parametrize("board", [KAPOHO_BAY, replace(KAPOHO_BAY, compartments=60, axons_out=150)])
def test_cores_hold_what_the_plan_counted(board: Board) -> None:
    ways = []
    for (source, target, _), row in stored_weights(SPEC, board).items():
        synapses = abs(row)
        synapses.data = np.ceil(synapses.data / 127).astype(np.int32)
        ways.append((source, target, synapses))
    plan, made = placed(SPEC, board, ways), front_end_images(SPEC, board, ())
    cores = {(core.chip, core.core): core for core in made.cores}
    assert len(cores) == len(made.cores) == plan.cores
    for name, each in plan.populations.items():
        own = [cores[place] for place in sorted({(chip, core) for chip, core, _ in made.tables[name].tolist()})]
        assert [len(core.compartments) for core in own] == each.sizes.tolist()
        assert max(len(core.axons_in) for core in own) == each.axons_in
        assert max(len(core.axons_out) for core in own) == each.axons_out
        assert max(len(core.synapses) for core in own) / plan.board.memory.capacity == pytest.approx(each.memory)
        assert sum(int(core.axons_in[:, 2].sum()) for core in own) == each.stored


def test_parts_of_a_weight_add_up_to_it() -> None:
    """But what excites neurons whose threshold is 0 is twice as much, as it is 1; what silences is one synapse."""
    rows, groups = stored_weights(SPEC, KAPOHO_BAY), populations(SPEC)
    for (source, target), weights in all_weights(SPEC).items():
        parts = [row * (1 << way[2]) for way, row in rows.items() if way[:2] == (source, target)]
        twice = 0 * weights if groups[target].threshold else weights.maximum(0)
        assert abs(sum(parts) - (weights + twice).maximum(-127 * 128)).nnz == 0
    assert (rows["filters", "filters", 7].data == -127).all()


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
