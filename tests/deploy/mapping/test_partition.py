"""Networks on cores: every limit, few cores against trying everything, what is minimised next."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from support.boards.plans import (
    check_images,
    check_plan,
    even,
    listened,
    network,
    parts_of,
    tiny,
    words,
)

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.boards.plan import CorePlan
from lava_vpr.deploy.mapping.layout import choose_formats
from lava_vpr.deploy.mapping.partition import fewest_cores, partition
from lava_vpr.deploy.mapping.sizing import Sizing
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError


@pytest.fixture(params=[(4096, 1024), (4096, 2), (3, 2)], ids=["direct", "relays", "leaves and relays"])
def shape(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small networks that have one inhibitory neuron or leaves, with relays or without."""
    fan_in, direct = request.param
    monkeypatch.setattr(fixed, "FAN_IN", fan_in)
    monkeypatch.setattr(fixed, "DIRECT", direct)


def drawn(data: st.DataObject) -> tuple[FixedNetwork, Board]:
    number = data.draw
    signed = number(st.booleans())
    made = network(
        number(st.integers(1, 40)),
        number(st.integers(1, 60)),
        bits=number(st.sampled_from([1, 2, 3, 6, 7])),
        share=number(st.sampled_from([0.0, 0.1, 0.42, 1.0])),
        inhibition=number(st.sampled_from([0, 1, 44, 200])),
        signed=signed,
        bias_input=number(st.booleans()),
        seed=number(st.integers(0, 99)),
    )
    return made, replace(
        KAPOHO_BAY,
        cores=number(st.sampled_from([4, 16, 128])),
        compartments=number(st.sampled_from([5, 20, 90, 1024])),
        axons_in=number(st.sampled_from([made.inputs + made.neurons + 1, 150, 4096])),
        axons_out=number(st.sampled_from([60, 300, 4096])),
        memory=PackedRows(number(st.sampled_from([80, 150, 400, 16_384]))),
        formats=number(st.sampled_from([4, 16])),
    )


@pytest.mark.quick(2)
@pytest.mark.usefixtures("shape")
@settings(max_examples=60, deadline=None, derandomize=True)
@given(data=st.data())
def test_what_fits_holds_every_limit_and_needs_are_what_is_counted(data: st.DataObject) -> None:
    made, board = drawn(data)
    try:
        plan = partition(made, board, even(made))
    except NetworkLimitError:
        return
    check_plan(plan)
    check_images(plan)


@pytest.mark.parametrize(("neurons", "bias_input"), [(1100, False), (5000, False), (5000, True)])
def test_large_networks_hold_every_limit(neurons: int, bias_input: bool) -> None:
    made = network(neurons, 300, share=0.58, signed=True, bias_input=bias_input)
    check_plan(partition(made, replace(KAPOHO_BAY, memory=PackedRows(5000)), even(made)))


@pytest.mark.parametrize(("neurons", "most"), [(3000, 48), (8000, 125)])
def test_thousands_of_places_are_mapped_within_seconds(neurons: int, most: int) -> None:
    """Of about a second, a minute is left for a machine that is busy."""
    made = network(neurons, 2048, share=0.58, signed=True)
    begin = time.perf_counter()
    plan = partition(made, KAPOHO_BAY, even(made))
    assert time.perf_counter() - begin < 60
    assert len(plan.cores) <= most
    assert sum(core.part("exc").size for core in plan.cores) == neurons
    assert sum(core.part("inh").size for core in plan.cores) == (1 if neurons <= 4096 else 3)
    assert sum(core.part("inputs").size for core in plan.cores) == 2048
    for core in plan.cores:
        assert (core.needs.synapse_words or 0) <= 0.95 * 16_384
        assert (core.needs.axons_in or 0) <= 4096
        assert (core.needs.axons_out or 0) <= 4096
    assert plan.weight_bits == 4


# Few cores.

Stored = tuple[int, int, bool]
"""Bits of a stored weight of the inputs and of the root, and whether rows may be dense."""


def literal_words(made: FixedNetwork, board: Board, bits: Stored, first: int, end: int) -> int:
    """Least words of a core's rows to its excitatory neurons, each of an input in every format."""
    size = end - first
    index = [wide for wide in board.memory.index_bits if size - 1 < 1 << wide]
    total = words(size, bits[1] + min(index, default=1 << 20)) if made.inhibition else 0
    for row in made.weights[:, first:end]:
        count = int(np.count_nonzero(row))
        if count:
            dense = [words(size, bits[0])] * bits[2]
            total += min([*dense, *(words(count, bits[0] + wide) for wide in index)], default=1 << 20)
    return total


def literal_fits(made: FixedNetwork, board: Board, bits: Stored, bounds: list[int], total: int) -> bool:
    """Whether everything fits on ``total`` cores with these ranges: inhibitory neurons on any, inputs in any order."""
    ranges = [*itertools.pairwise(bounds), *[(0, 0)] * (total - len(bounds) + 1)]
    exc_cores, rooms = len(bounds) - 1, []
    for first, end in ranges:
        active = int((made.weights[:, first:end] != 0).any(axis=1).sum())
        held = (
            end - first,
            active + bool(made.inhibition and end > first),
            2 * (end - first),
            literal_words(made, board, bits, first, end) if end > first else 0,
        )
        limits = (board.compartments, board.axons_in, board.axons_out, board.memory.capacity)
        rooms.append(np.array(limits) - held)
    if min(room.min() for room in rooms) < 0:
        return False
    axons = [sum(bool(row[first:end].any()) for first, end in ranges[:exc_cores]) for row in made.weights]
    relayed = int(made.relayed)
    for places in itertools.product(range(total), repeat=made.inhibitory):
        left = [room.copy() for room in rooms]
        for inh, core in enumerate(places):
            heard = len(listened(made, inh))
            out = exc_cores * bool(made.inhibition) if inh == made.inhibitory - 1 else 1
            left[core] -= (1, heard, out, heard)
        if min(room.min() for room in left) < 0:
            continue
        if not made.input_compartments:
            return True
        for order in itertools.permutations(range(total)):
            for sizes in parts_of(made.inputs, total):
                begin = 0
                for core, size in zip(order, sizes, strict=True):
                    out = sum(axons[begin : begin + size])
                    if (left[core] < (size, relayed * size, out, relayed * size)).any():
                        break
                    begin += size
                else:
                    return True
    return False


def literal_fewest(made: FixedNetwork, board: Board, bits: Stored) -> int | None:
    """Fewest cores, by trying everything."""
    for total in range(1, board.cores + 1):
        for cores in range(1, min(total, made.neurons) + 1):
            for cuts in itertools.combinations(range(1, made.neurons), cores - 1):
                if literal_fits(made, board, bits, [0, *cuts, made.neurons], total):
                    return total
    return None


def small_problem(seed: int) -> tuple[FixedNetwork, Board]:
    rng = np.random.default_rng(seed)
    signed = bool(rng.random() < 0.5)
    made = network(
        int(rng.integers(1, 6)),
        int(rng.integers(1, 6)),
        bits=int(rng.integers(1, 8)),
        share=float(rng.choice([0.3, 0.6, 1.0])),
        inhibition=int(rng.choice([0, 1, 44, 85])),
        signed=signed,
        bias_input=bool(rng.random() < 0.3),
        seed=seed,
    )
    board = tiny(
        cores=3,
        compartments=int(rng.choice([1024, rng.integers(1, 8)])),
        axons_out=int(rng.integers(3, 16)),
        axons_in=int(rng.choice([4096, rng.integers(2, 14)])),
        synapse_words=int(rng.choice([16_384, rng.integers(3, 24)])),
    )
    return made, board


@pytest.mark.usefixtures("shape")
def test_cores_are_as_few_as_trying_everything_finds_but_for_a_few() -> None:
    """Never fewer; and one more, or none at all, in at most one of twenty problems this tight."""
    outcomes, worse, tried = set(), 0, 0
    for seed in range(60):
        made, board = small_problem(seed)
        sizing = Sizing(made, board, even(made, 0.5), dense_rows=bool(seed % 2))
        cores = fewest_cores(sizing)
        fewest = literal_fewest(made, board, (sizing.weight_bits, sizing.inhibition_bits, sizing.dense_rows))
        outcomes.add(cores)
        tried += fewest is not None
        if cores is not None:
            assert fewest is not None, f"seed {seed}"
            assert cores >= fewest, f"seed {seed}"
        worse += cores != fewest
    assert outcomes == {None, 1, 2, 3}
    assert tried > 20
    assert worse <= tried / 20, worse


def test_each_range_reaches_as_far_as_a_core_holds() -> None:
    """Without anything but excitatory neurons to place, cores are the fewest that any ranges need."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        made = network(12, 8, share=float(rng.choice([0.3, 0.6])), seed=seed, signed=True)
        board = tiny(cores=40, synapse_words=int(rng.integers(14, 40)))
        sizing = Sizing(made, replace(board, axons_in=4096), even(made), dense_rows=bool(seed % 2))
        bits = (sizing.weight_bits, sizing.inhibition_bits, sizing.dense_rows)
        fits = {
            (first, end): literal_words(made, board, bits, first, end) <= board.memory.capacity
            for first, end in itertools.combinations(range(13), 2)
        }
        fewest = {0: 0}
        for end in range(1, 13):
            ways = [fewest[first] + 1 for first in range(end) if fits[first, end] and first in fewest]
            if ways:
                fewest[end] = min(ways)
        plan = fewest_cores(sizing)
        if 12 in fewest:
            assert fewest[12] <= plan <= fewest[12] + 1  # the inhibitory neuron's core
        else:
            assert plan is None


def test_the_inhibitory_neuron_stands_beside_others_where_there_is_room() -> None:
    made = network(20, 30)
    (core,) = partition(made, KAPOHO_BAY, even(made)).cores
    assert [(part.population, part.first, part.size) for part in core.parts] == [
        ("exc", 0, 20),
        ("counters", 0, 20),
        ("inh", 0, 1),
    ]
    alone = partition(made, tiny(axons_in=31 + 19), even(made))
    assert [[part.population for part in core.parts] for core in alone.cores] == [["exc"], ["inh"]]
    check_plan(alone)


# What is minimised next.


def test_equal_ranges_where_they_fit_else_the_longest_is_short() -> None:
    made = network(300, 500)
    plan = partition(made, tiny(synapse_words=9000), even(made))
    sizes = [core.part("exc").size for core in plan.cores]
    assert max(sizes) - min(sizes) <= 1
    weights = made.weights * (np.random.default_rng(0).random((500, 300)) < np.linspace(1, 0.02, 300))
    uneven = replace(made, weights=weights.astype(np.int16))
    plan = partition(uneven, tiny(synapse_words=4200, cores=3), even(made))
    check_plan(plan)
    sizes = [core.part("exc").size for core in plan.cores if core.part("exc").size]
    assert max(sizes) > min(sizes) + 1


def test_rows_turn_dense_only_as_far_as_memory_demands() -> None:
    made = network(100, 300, share=0.42, bits=3)
    rates = np.random.default_rng(2).random(300)
    free = partition(made, tiny(), rates / 20)
    need = free.cores[0].needs.synapse_words or 0
    assert len(free.cores) == 1
    assert not free.cores[0].dense_inputs.any()
    operations, dense = [], []
    for less in (0, 1, 8, 16, 29):
        board = tiny(synapse_words=-(-(need - less) * 20 // 19), cores=1)
        plan = partition(made, board, rates / 20, dense_rows=True)
        load = plan.cores[0].load
        operations.append(load.operations_dense + load.operations_sparse)
        dense.append(int(plan.cores[0].dense_inputs.sum()))
        assert (plan.cores[0].needs.synapse_words or 0) <= board.memory.capacity
    assert operations == sorted(operations)
    assert dense == sorted(dense)
    assert dense[0] == 0
    assert dense[-1] > 0


def test_a_dense_row_that_is_given_back_was_not_needed() -> None:
    """Making any dense row sparse again that costs operations would take more memory than there is."""
    made = network(90, 200, share=0.6, bits=5)
    rates = np.random.default_rng(3).random(200) / 10
    sizing = Sizing(made, KAPOHO_BAY, rates, dense_rows=True)
    counts = np.count_nonzero(made.weights, axis=1)
    for limit in range(2130, 2400, 30):
        stored = choose_formats(sizing, 0, 90, limit)
        assert stored.words <= limit
        turned = np.flatnonzero(stored.dense_inputs & (counts < 90))
        assert turned.size > 3
        for row in turned:
            assert stored.words + words(int(counts[row]), 6 + 7) - words(90, 6) > limit


def test_a_row_without_a_zero_is_dense_at_once() -> None:
    made = network(50, 30, share=1.0)
    assert partition(made, KAPOHO_BAY, even(made), dense_rows=True).cores[0].dense_inputs.all()
    assert not partition(made, KAPOHO_BAY, even(made)).cores[0].dense_inputs.any()


def test_unless_it_is_asked_otherwise_every_weight_is_counted_with_its_index() -> None:
    made = network(50, 30, share=1.0, signed=True)
    sizing = Sizing(made, KAPOHO_BAY, even(made))
    stored = choose_formats(sizing, 0, 50, 10_000)
    assert not stored.dense_inputs.any()
    assert stored.words == 30 * words(50, 4 + 6) + words(50, sizing.inhibition_bits + 6) + 50
    assert choose_formats(sizing, 0, 50, stored.words - 1) is None


def test_inputs_are_spread_so_that_no_core_waits() -> None:
    made = network(100, 1568, bias_input=True)
    rates = np.random.default_rng(4).random(1568) ** 4
    rates *= 20 / rates.sum()
    plan = partition(made, KAPOHO_BAY, rates)
    assert len(plan.cores) == 2
    times = [core.load.busy for core in plan.cores]
    assert max(times) < 1.05 * min(times)
    assert plan.host_spikes == 0


# What is public of Loihi 2.


def test_loihi_2_is_divided_by_neurons_alone() -> None:
    made = network(60, 50, bias_input=True)
    plan = partition(made, replace(LOIHI_2, compartments=60), even(made))
    check_plan(plan)
    assert len(plan.cores) == 2
    assert plan.hops is None
    assert [core.core for core in plan.cores] == [0, 1]
    for core in plan.cores:
        assert core.needs.synapse_words is None
        of_root = 0.2 * core.part("exc").size
        assert core.load.operations_sparse == pytest.approx(0.2 * core.part("inh").size + of_root, rel=1e-3)


def test_equal_networks_have_equal_plans() -> None:
    made = network(200, 400, bias_input=True)
    board = replace(KAPOHO_BAY, memory=PackedRows(3000))
    one, two = (partition(made, board, even(made)) for _ in range(2))
    assert [(c.chip, c.core, c.parts, c.needs, c.load) for c in one.cores] == [
        (c.chip, c.core, c.parts, c.needs, c.load) for c in two.cores
    ]
    for a, b in zip(one.cores, two.cores, strict=True):
        assert np.array_equal(a.dense_inputs, b.dense_inputs)


def test_load_counts_what_rates_say() -> None:
    made = network(20, 30, share=0.5)
    rates = np.random.default_rng(7).random(30)
    core: CorePlan = partition(made, KAPOHO_BAY, rates, exc_spikes=0.5).cores[0]
    counts = np.count_nonzero(made.weights, axis=1)
    active, load = counts > 0, core.load
    # Half a spike a step arrives at the counters and at the inhibitory neuron, which spikes as often.
    assert load.messages_in == pytest.approx(rates[active].sum() + 0.5 + 0.5 + 0.5, rel=1e-4)
    assert load.operations_sparse == pytest.approx((rates * counts).sum() + 0.5 + 0.5 + 0.5 * 20, rel=1e-4)
    assert load.operations_dense == 0
    assert load.updates == pytest.approx(20 + 20 + 0.5, rel=1e-4)
    assert load.spikes == pytest.approx(1.0, rel=1e-4)
    assert load.messages_out == pytest.approx(2 * 0.5 + 0.5, rel=1e-4)
    wanted = 16 * load.messages_in + 4.7 * load.operations_sparse + 9.7 * load.updates + 30 + 5.1 * 1.5
    assert load.busy == pytest.approx(wanted, rel=1e-4)


def test_load_of_relays() -> None:
    made = network(1100, 40, share=1.0)
    rates = np.random.default_rng(8).random(40)
    plan = partition(made, KAPOHO_BAY, rates / 4)
    assert sum(core.load.messages_in for core in plan.cores) == pytest.approx(
        (rates / 4).sum() * 4 + 0.2 + 0.2 + 0.2 * 3, rel=1e-3
    )
    assert len([core for core in plan.cores if core.part("exc").size]) == 3
