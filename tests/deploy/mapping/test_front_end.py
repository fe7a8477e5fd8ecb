"""The spiking front end on cores: what each holds, counted again, which limit binds, and what a board cannot hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import PackedRows, row_words
from lava_vpr.deploy.mapping.front_end import EVENTS, placed
from lava_vpr.deploy.mapping.front_end_images import front_end_images
from lava_vpr.deploy.registers.synapse_memory import unpack
from lava_vpr.deploy.registers.synapses import SynapseFormat
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import all_weights, event_synapses, populations

SPEC, SMALL = FrontEnd(width=16), FrontEnd(width=8)


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


@pytest.mark.parametrize("board", [KAPOHO_BAY, replace(KAPOHO_BAY, compartments=60, axons_out=150)])
def test_cores_hold_what_the_plan_counted(board: Board) -> None:
    plan, made = placed(SMALL, board), front_end_images(SMALL, board, ())
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
    for core in front_end_images(SMALL, KAPOHO_BAY, ()).cores:
        forms = [None if form is None else SynapseFormat.of(form, core.name) for form in core.registers["synapseFmt"]]
        rows = unpack(core.synapses, core.axons_in, forms, len(core.compartments), core.name)
        ways = np.column_stack([np.repeat(np.arange(len(core.axons_in)), np.diff(rows.starts)), rows.compartments])
        assert len(np.unique(ways, axis=0)) == len(ways) > 0


def test_every_input_axon_has_one_source() -> None:
    made = front_end_images(SMALL, KAPOHO_BAY, ())
    out = np.concatenate([core.axons_out[:, 1:] for core in made.cores]).tolist()
    into = [[core.chip, core.core, axon] for core in made.cores for axon in range(len(core.axons_in))]
    assert sorted(out) == sorted(into)


@pytest.mark.parametrize(
    ("spec", "taken", "words"),
    [
        (SMALL, 250, r"^7 cores and 250 of the network, but Kapoho Bay \(two Loihi 1 chips\) has 256$"),
        (FrontEnd(width=8, window=8), 0, r"^no public source shows how events of a camera come to axons of the chip$"),
    ],
)
def test_what_a_board_cannot_hold_is_refused(spec: FrontEnd, taken: int, words: str) -> None:
    used = [divmod(core, KAPOHO_BAY.cores) for core in range(taken)]
    with pytest.raises(NetworkLimitError, match=words):
        front_end_images(spec, KAPOHO_BAY, used)
