"""The spiking front end on cores: what each holds, counted anew, and what binds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import PackedRows, row_words
from lava_vpr.deploy.mapping.front_end import placed, stored_synapses
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import synapses

SPEC = FrontEnd(width=16)


@pytest.mark.parametrize(
    ("limits", "population", "binds"),
    [
        ({"compartments": 200}, "pairs", "compartments"),
        ({"axons_in": 300}, "filters", "axons in"),
        ({"memory": PackedRows(1000)}, "filters", "synapse memory"),
        ({"axons_out": 250, "compartments": 60}, "pixels", "axons out"),
    ],
)
def test_every_core_is_within_the_limits_and_one_neuron_more_is_not(
    limits: dict[str, object], population: str, binds: str
) -> None:
    board = replace(KAPOHO_BAY, **limits)  # type: ignore[arg-type]
    plan, rows = placed(SPEC, board), stored_synapses(SPEC, board)
    assert plan.populations[population].binds == binds
    assert plan.exceeded() == ""
    for name, each in plan.populations.items():
        ends = np.append(each.starts[1:], each.neurons)
        assert each.neurons == SPEC.populations[name]
        found = [
            _taken(board, [row for (_, to), row in rows.items() if to == name], start, end)
            for start, end in zip(each.starts.tolist(), ends.tolist(), strict=True)
        ]
        if each.cores > 1 and each.binds != "axons out":
            more = _taken(board, [row for (_, to), row in rows.items() if to == name], 0, int(ends[0]) + 1)
            limits = (board.compartments, board.axons_in, board.memory.capacity)
            assert any(need > limit for need, limit in zip(more, limits, strict=True))
        most = np.max(found, axis=0)
        assert (each.compartments, each.axons_in) == tuple(most[:2])
        assert each.memory == pytest.approx(most[2] / board.memory.capacity)
        assert each.memory <= 1
        assert each.compartments <= board.compartments
        assert each.axons_in <= board.axons_in
        assert each.axons_out <= board.axons_out
    stored = sum(int(row.sum()) for row in rows.values())
    assert sum(each.stored for each in plan.populations.values()) == stored


def _taken(board: Board, rows: list[object], start: int, end: int) -> tuple[int, int, int]:
    """Compartments, input axons and words of a core, row by row."""
    axons = words = 0
    index = board.memory.sparse_bits(end - start)
    assert index is not None
    for row in rows:
        for count in row.toarray()[start:end].sum(axis=0):  # type: ignore[attr-defined]
            axons += count > 0
            words += int(row_words(count, 8 + index)) if count else 0
    return end - start, axons, words


def test_a_weight_beyond_a_board_s_bits_is_several_synapses() -> None:
    """With a sign in 8 bits 255 is three times 127 at most; where all of one sign need none, it is one."""
    plain = sum(each.weights.nnz for each in synapses(SPEC))
    boards = (KAPOHO_BAY, LOIHI_2)
    sizes = {board.name: sum(int(row.sum()) for row in stored_synapses(SPEC, board).values()) for board in boards}
    assert sizes["loihi2"] == plain
    more = sum(int((-(-abs(each.weights.data) // 127) - 1).sum()) for each in synapses(SPEC))
    assert sizes["kapoho-bay"] == plain + more > plain


def test_too_many_cores_are_said() -> None:
    board = replace(KAPOHO_BAY, cores=4, compartments=64)
    plan = placed(SPEC, board)
    told = plan.exceeded(3)
    assert told == f"{plan.cores} cores and 3 of the network, but {board.title} has 8"
    assert plan.as_json(3)["fits"] is False
    assert placed(SPEC, KAPOHO_BAY).as_json(1)["fits"] is True
    assert placed(SPEC, LOIHI_2).as_json(1)["fits"] is None


def test_axons_that_no_number_of_cores_helps_are_said() -> None:
    plan = placed(SPEC, replace(KAPOHO_BAY, axons_out=2, compartments=64))
    assert " axons out, of 2" in plan.exceeded()
