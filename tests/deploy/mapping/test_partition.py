"""Networks on cores: every limit, few cores against bounds and against trying everything, what is minimised next."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards.small_boards import check_images, check_plan, even, network, parts_of, tiny, words

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.plan import CorePlan
from lava_vpr.deploy.mapping.layout import with_relays
from lava_vpr.deploy.mapping.partition import fewest_cores, layouts_on_fewest_cores, partition
from lava_vpr.deploy.mapping.row_formats import choose_formats
from lava_vpr.deploy.mapping.sizing import Sizing
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError


@settings(max_examples=40, deadline=None, derandomize=True)
@given(data=st.data())
def test_what_fits_holds_every_limit_and_needs_are_what_is_written(data: st.DataObject) -> None:
    number = data.draw
    made = network(
        number(st.integers(1, 40)),
        number(st.integers(1, 60)),
        bits=number(st.sampled_from([1, 2, 3, 7, 8])),
        share=number(st.sampled_from([0.0, 0.1, 0.42, 1.0])),
        inhibition=number(st.sampled_from([0, 1, 44, 200])),
        bias_input=number(st.booleans()),
        seed=number(st.integers(0, 99)),
    )
    board = replace(
        KAPOHO_BAY,
        cores=number(st.sampled_from([4, 16, 128])),
        compartments=number(st.sampled_from([5, 20, 90, 1024])),
        axons_in=number(st.sampled_from([made.inputs + made.neurons + 1, 150, 4096])),
        axons_out=number(st.sampled_from([60, 300, 4096])),
        synapse_words=number(st.sampled_from([80, 150, 400, 16_384])),
        formats=number(st.sampled_from([3, 16])),
    )
    try:
        plan = partition(made, board, even(made))
    except NetworkLimitError:
        return
    check_plan(plan)
    check_images(plan)


# Few cores.


def literal_words(made: FixedNetwork, board: Board, bits: tuple[int, int], first: int, end: int) -> int:
    """Least words of a core's rows, each in every format."""
    size = end - first
    index = [wide for wide in board.index_bits if size - 1 < 1 << wide]
    total = 0
    for row in made.weights[:, first:end]:
        count = int(np.count_nonzero(row))
        if count:
            total += min([words(size, bits[0]), *(words(count, bits[0] + wide) for wide in index)])
    if made.inhibition:
        total += words(size, bits[1]) * (size < made.neurons)
        if size > 1:
            total += size * min([words(size, bits[1]), *(words(size - 1, bits[1] + wide) for wide in index)])
    return total


def literal_fits(made: FixedNetwork, board: Board, bits: tuple[int, int], bounds: list[int], others: int) -> bool:
    """Whether relays fit beside these ranges and on ``others`` more cores, in any order of the cores."""
    ranges = list(itertools.pairwise(bounds))
    cores, total = len(ranges), len(ranges) + others
    sizes = [end - first for first, end in ranges] + [0] * others
    most = []
    for first, end in [*ranges, *[(0, 0)] * others]:
        active = int((made.weights[:, first:end] > 0).any(axis=1).sum())
        own = (end - first == 1) if made.inhibition else 0
        axons = active + (made.neurons - own if made.inhibition and end > first else 0)
        rows = literal_words(made, board, bits, first, end) if end > first else 0
        room = [board.axons_in - axons, board.synapse_words - rows, board.compartments - end + first]
        if min(room) < 0 or board.axons_out < 2 * (end - first):
            return False
        most.append(min(room))
    cost = [(cores - (size == 1)) * (made.inhibition > 0) for size in sizes for _ in range(size)]
    for order in itertools.permutations(range(total)):
        for relays in parts_of(made.neurons, total):
            begin = 0
            for core, count in zip(order, relays, strict=True):
                out = board.axons_out - 2 * sizes[core] - sum(cost[begin : begin + count])
                if count > most[core] or out < 0:
                    break
                begin += count
            else:
                return True
    return False


def literal_fewest(made: FixedNetwork, board: Board, bits: tuple[int, int], share: int = 1) -> int | None:
    """Fewest cores of excitatory neurons and relays, with at least ``share`` neurons a core, by trying everything."""
    for total in range(1, board.cores + 1):
        for cores in range(1, min(total, made.neurons) + 1):
            for cuts in itertools.combinations(range(1, made.neurons), cores - 1):
                bounds = [0, *cuts, made.neurons]
                if min(np.diff(bounds)) >= share and literal_fits(made, board, bits, bounds, total - cores):
                    return total
    return None


def small_problem(seed: int) -> tuple[FixedNetwork, Board]:
    rng = np.random.default_rng(seed)
    made = network(
        int(rng.integers(1, 6)),
        int(rng.integers(1, 6)),
        bits=int(rng.integers(1, 9)),
        share=float(rng.choice([0.3, 0.6, 1.0])),
        inhibition=int(rng.choice([0, 1, 44, 85])),
        bias_input=bool(rng.random() < 0.5),
        seed=seed,
    )
    board = tiny(
        compartments=int(rng.choice([1024, rng.integers(1, 8)])),
        axons_out=int(rng.integers(3, 16)),
        axons_in=int(rng.choice([4096, rng.integers(2, 14)])),
        synapse_words=int(rng.choice([16_384, rng.integers(3, 20)])),
    )
    return made, board


def test_cores_are_as_few_as_any_plan_has_where_that_is_claimed() -> None:
    """Never fewer than trying everything finds; as few, if spikes are injected, as where no neuron stands alone."""
    outcomes, several = set(), 0
    for seed in range(160):
        drawn, board = small_problem(seed)
        bits = (Sizing(drawn, board, even(drawn)).weight_bits, Sizing(drawn, board, even(drawn)).lateral_bits)
        fewest, shared = literal_fewest(drawn, board, bits), literal_fewest(drawn, board, bits, share=2)
        for made in (drawn, replace(drawn, bias_input=False)):
            layouts = layouts_on_fewest_cores(Sizing(made, board, even(made, 0.5)))
            cores = len(layouts[0].relays) if layouts else None
            outcomes.add(cores)
            if cores is not None:
                compartments = 2 * made.neurons + made.input_compartments
                assert fewest is not None, f"seed {seed}"
                assert cores >= max(fewest, -(-compartments // board.compartments)), f"seed {seed}"
            if not made.bias_input and shared is not None:
                assert cores is not None, f"seed {seed}"
                assert cores <= shared, f"seed {seed}"
            if not made.bias_input and layouts and (np.diff(layouts[0].bounds) > 1).all():
                assert cores == fewest, f"seed {seed}"
                several += fewest != 1
    assert outcomes == {None, 1, 2, 3, 4}
    assert several > 10


@pytest.mark.parametrize("seed", [45, 763, 864, 924, 1228])
def test_ranges_with_most_room_for_relays_spare_a_core(seed: int) -> None:
    drawn, board = small_problem(seed)
    made = replace(drawn, bias_input=False)
    sizing = Sizing(made, board, even(made, 0.5))
    fewest = literal_fewest(made, board, (sizing.weight_bits, sizing.lateral_bits))
    assert fewest is not None
    assert fewest_cores(sizing) == fewest


def test_a_relay_has_no_axon_to_a_core_where_its_neuron_is_alone() -> None:
    made = network(20, 5, share=1.0)
    # Five rows of inputs, one of the relays elsewhere, and one to the relay: no core has memory for two neurons.
    board = replace(KAPOHO_BAY, compartments=2, axons_out=2 + 19, synapse_words=7)
    plan = partition(made, board, even(made))
    check_plan(plan)
    check_images(plan)
    assert len(plan.cores) == 20


# What is minimised next.


@pytest.mark.parametrize("room", [150, 170, 190, 230, 300, 1000])
def test_of_all_ranges_those_with_the_fewest_operations_then_the_least_busy_core(room: int) -> None:
    made = network(14, 40, share=0.7, bits=8, inhibition=40)
    rates = np.random.default_rng(1).random(40)
    sizing = Sizing(made, tiny(compartments=12, synapse_words=room, cores=8), rates)
    best = min(layouts_on_fewest_cores(sizing), key=lambda layout: (layout.added, layout.busiest))
    tried = []
    for cores in range(1, len(best.relays) + 1):
        for cuts in itertools.combinations(range(1, 14), cores - 1):
            bounds = np.array([0, *cuts, 14])
            if max(np.diff(bounds)) <= 6:
                layout = with_relays(sizing, bounds, np.diff(bounds))
                tried += [(layout.added, layout.busiest)] if layout is not None else []
    assert (best.added, best.busiest) == min(tried)


def test_rows_turn_dense_only_as_far_as_memory_demands() -> None:
    made = network(100, 300, share=0.42, bits=3)
    rates = np.random.default_rng(2).random(300)
    free = partition(made, tiny(), rates / 20)
    need = free.cores[0].needs.synapse_words or 0
    assert len(free.cores) == 1
    assert not free.cores[0].dense_lateral
    assert not free.cores[0].dense_inputs.any()
    operations, dense = [], []
    for less in (0, 1, 800, 1200, 1300):
        plan = partition(made, tiny(synapse_words=need - less, cores=1), rates / 20)
        load = plan.cores[0].load
        operations.append(load.operations_dense + load.operations_sparse)
        dense.append(int(plan.cores[0].dense_inputs.sum()))
        assert (plan.cores[0].needs.synapse_words or 0) <= need - less
    assert operations == sorted(operations)
    assert dense == sorted(dense)
    assert dense[0] == 0
    assert dense[-1] > 0


def test_a_dense_row_that_is_given_back_was_not_needed() -> None:
    """Making any dense row sparse again that costs operations would take more memory than there is."""
    made = network(90, 200, share=0.6, bits=5)
    rates = np.random.default_rng(3).random(200) / 10
    sizing = Sizing(made, KAPOHO_BAY, rates)
    counts = np.count_nonzero(made.weights, axis=1)
    for limit in range(2540, 2600, 3):
        stored = choose_formats(sizing, 0, 90, limit)
        assert stored is not None
        turned = np.flatnonzero(stored.dense_inputs & (counts < 90))
        assert turned.size > 3
        for row in turned:
            assert stored.words + words(int(counts[row]), 5 + 7) - words(90, 5) > limit


def test_a_row_without_a_zero_is_dense_at_once() -> None:
    made = network(50, 30, share=1.0)
    assert partition(made, KAPOHO_BAY, even(made)).cores[0].dense_inputs.all()


def test_the_busiest_core_is_as_little_busy_as_neighbouring_ranges_allow() -> None:
    """Neurons with many weights come first: equal numbers would not be equal times."""
    made = network(300, 500)
    weights = made.weights * (np.random.default_rng(0).random((500, 300)) < np.linspace(1, 0.2, 300))
    made = replace(made, weights=weights.astype(np.uint8))
    plan = partition(made, tiny(synapse_words=6000), even(made))
    assert len(plan.cores) >= 2
    sizes = [core.part("exc").size for core in sorted(plan.cores, key=lambda core: core.part("exc").first)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1]
    times = [core.load.nanoseconds for core in plan.cores]
    assert max(times) < 1.05 * min(times)


def test_inputs_are_spread_so_that_no_core_waits() -> None:
    made = network(100, 1568, bias_input=True)
    rates = np.random.default_rng(4).random(1568) ** 4
    rates *= 20 / rates.sum()
    plan = partition(made, KAPOHO_BAY, rates)
    assert len(plan.cores) == 2
    times = [core.load.nanoseconds for core in plan.cores]
    assert max(times) < 1.01 * min(times)
    assert plan.host_spikes == 0


# What is public of Loihi 2.


def test_loihi_2_is_divided_by_neurons_alone() -> None:
    made = network(60, 50, bias_input=True)
    plan = partition(made, replace(LOIHI_2, compartments=100), even(made))
    check_plan(plan)
    assert len(plan.cores) == 2
    assert plan.hops is None
    assert [core.core for core in plan.cores] == [0, 1]
    for core in plan.cores:
        assert core.dense_lateral
        assert core.load.operations_sparse == pytest.approx(core.part("inh").size * 0.2 / 60, rel=1e-3)
        assert core.needs.synapse_words is None
    assert partition(replace(made, shift=3), LOIHI_2, even(made)).network.shift == 3


def test_equal_networks_have_equal_plans() -> None:
    made = network(200, 400, bias_input=True)
    board = replace(KAPOHO_BAY, synapse_words=3000)
    one, two = (partition(made, board, even(made)) for _ in range(2))
    assert [(c.chip, c.core, c.parts, c.needs, c.load) for c in one.cores] == [
        (c.chip, c.core, c.parts, c.needs, c.load) for c in two.cores
    ]
    for a, b in zip(one.cores, two.cores, strict=True):
        assert np.array_equal(a.dense_inputs, b.dense_inputs)


def test_load_counts_what_rates_say() -> None:
    made = network(20, 30, share=0.5)
    rates = np.random.default_rng(7).random(30)
    core: CorePlan = partition(made, KAPOHO_BAY, rates, exc_spikes=2.0).cores[0]
    counts = np.count_nonzero(made.weights, axis=1)
    active, load = counts > 0, core.load
    assert load.messages_in == pytest.approx(rates[active].sum() + 2 * 2.0, rel=1e-4)
    assert load.operations_sparse == pytest.approx((rates * counts).sum() + 2.0 * 19 + 2.0, rel=1e-4)
    assert load.operations_dense == 0
    assert load.updates == pytest.approx(20 + 2.0, rel=1e-4)
    assert load.spikes == pytest.approx(4.0, rel=1e-4)
    assert load.messages_out == pytest.approx(2 * 2.0 + 2.0, rel=1e-4)
    wanted = 16 * load.messages_in + 4.7 * load.operations_sparse + 9.7 * load.updates + 30 * 4 + 5.1 * 6
    assert load.nanoseconds == pytest.approx(wanted, rel=1e-4)
