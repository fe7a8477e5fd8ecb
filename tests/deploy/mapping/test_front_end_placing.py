"""The spiking front end on cores: what each holds, counted anew, and what binds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import PackedRows, row_words
from lava_vpr.deploy.mapping.front_end import EVENTS, placed
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import all_weights, event_synapses, populations

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
    plan = placed(SPEC, board)
    assert plan.populations[population].binds == binds
    assert plan.exceeded() == ""
    for name, each in plan.populations.items():
        ends = np.append(each.starts[1:], each.neurons)
        assert each.neurons == SPEC.populations[name]
        found = [
            _taken(board, [row for (_, to, _), row in plan.rows.items() if to == name], start, end)
            for start, end in zip(each.starts.tolist(), ends.tolist(), strict=True)
        ]
        if each.cores > 1 and each.binds != "axons out":
            more = _taken(board, [row for (_, to, _), row in plan.rows.items() if to == name], 0, int(ends[0]) + 1)
            limits = (board.compartments, board.axons_in, board.memory.capacity)
            assert any(need > limit for need, limit in zip(more, limits, strict=True))
        most = np.max(found, axis=0)
        assert (each.compartments, each.axons_in) == tuple(most[:2])
        assert each.memory == pytest.approx(most[2] / board.memory.capacity)
        assert each.memory <= 1
        assert each.compartments <= board.compartments
        assert each.axons_in <= board.axons_in
        assert each.axons_out <= board.axons_out
    stored = sum(row.nnz for row in plan.rows.values())
    assert sum(each.stored for each in plan.populations.values()) == stored


def _taken(board: Board, rows: list[object], start: int, end: int) -> tuple[int, int, int]:
    """Compartments, input axons and words of a core, row by row."""
    axons = words = 0
    index = board.memory.sparse_bits(end - start)
    assert index is not None
    for row in rows:
        for count in (row.toarray()[start:end] != 0).sum(axis=0):  # type: ignore[attr-defined]
            axons += count > 0
            words += int(row_words(count, 8 + index)) if count else 0
    return end - start, axons, words


@pytest.mark.parametrize("spec", [SPEC, FrontEnd(width=16, window=8)], ids=["images", "events"])
@pytest.mark.parametrize(("board", "largest"), [(KAPOHO_BAY, 127), (LOIHI_2, 255)])
def test_a_weight_beyond_a_board_s_bits_is_two_synapses_that_add_up_to_it(
    spec: FrontEnd, board: Board, largest: int
) -> None:
    """With a sign in 8 bits 127 is the most, where all of one sign need none, 255.

    What excites neurons whose threshold is 0 is twice as much, as it is 1; what silences is one synapse at most.
    """
    rows, groups = placed(spec, board).rows, populations(spec)
    every = {**all_weights(spec), **({(EVENTS, "pixels"): event_synapses(spec)} if spec.window else {})}
    for (source, target), weights in every.items():
        twice = 0 * weights if groups[target].threshold else weights.maximum(0)
        whole = (weights + twice).maximum(-largest * 128).toarray()
        parts = {exponent: row.toarray() for (*way, exponent), row in rows.items() if way == [source, target]}
        assert np.array_equal(sum(part * (1 << exponent) for exponent, part in parts.items()), whole)
        assert max(int(abs(part).max()) for part in parts.values()) <= largest
        assert (sum(part != 0 for part in parts.values()) <= 1 + (abs(whole) > largest)).all()
    assert (rows["filters", "filters", 7].data == -largest).all()
    assert any(exponent for _, _, exponent in rows)


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
