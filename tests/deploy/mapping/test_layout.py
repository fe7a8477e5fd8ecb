"""Ranges of neurons, inputs on cores, cores on the mesh: the best of all, and near it where all are too many."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from support.boards.plans import check_images, check_plan, even, network, parts_of, tiny

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Mesh
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.mapping.partition import assign_cores, distances, partition
from lava_vpr.deploy.mapping.placing import counts_of, even as even_ranges, farthest, fitting, longest, spread
from lava_vpr.deploy.mapping.sizing import Sizing
from lava_vpr.deploy.registers.core_images import core_images, host_tables


@settings(max_examples=50, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1000), cores=st.integers(1, 4), count=st.integers(0, 9))
def test_spreading_is_the_best_of_all_consecutive_parts(seed: int, cores: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    each, axons = rng.random(count), rng.integers(0, 4, count)
    room, out, busy = rng.integers(0, 8, cores), rng.integers(0, 15, cores), rng.random(cores)
    best = None
    for sizes in parts_of(count, cores):
        ends = np.cumsum(sizes)
        groups = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        if all(n <= r for n, r in zip(sizes, room, strict=True)) and all(
            axons[own].sum() <= o for own, o in zip(groups, out, strict=True)
        ):
            level = max(b + each[own].sum() for b, own in zip(busy, groups, strict=True))
            best = level if best is None else min(best, level)
    found = spread(each, axons, room, out, busy)
    assert (found is None) == (best is None)
    if found is not None and best is not None:
        ends = np.cumsum(found)
        level = max(b + each[end - n : end].sum() for b, end, n in zip(busy, ends, found, strict=True))
        assert level == pytest.approx(best)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1000), words=st.integers(9, 40), about=st.integers(1, 40))
def test_the_farthest_end_is_the_last_that_fits(seed: int, words: int, about: int) -> None:
    made = network(40, 8, share=0.3, seed=seed)
    sizing = Sizing(made, tiny(synapse_words=words), even(made))
    for first in (0, 7, 39):
        sizes = np.arange(1, 41 - first)
        fits = fitting(sizing, sizes, *sizing.growing(first, 1, 40 - first))
        last = int(sizes[fits].max(initial=0))
        assert fits[:last].all()
        assert farthest(sizing, first, 40, about) == last
        assert farthest(sizing, first, 5, about) == min(5, last)


def test_even_ranges_are_as_short_as_any() -> None:
    """Of ranges whose rows differ: none is longer than the longest of the shortest that fit."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        made = network(12, 30, share=0.9, seed=seed)
        weights = made.weights * (rng.random((30, 12)) < np.linspace(1, 0.1, 12))
        made = replace(made, weights=weights.astype(np.int16))
        sizing = Sizing(made, tiny(synapse_words=50), even(made))
        best = longest(sizing, 12, 12)
        cores = best.size - 1
        bounds = even_ranges(sizing, cores, best)
        tried = []
        for cuts in itertools.combinations(range(1, 12), cores - 1):
            ends = np.array([0, *cuts, 12])
            if fitting(sizing, np.diff(ends), *sizing.taken(np.diff(ends), counts_of(sizing, ends))).all():
                tried.append(int(np.diff(ends).max()))
        assert int(np.diff(bounds).max()) == min(tried)


# Where cores are.


def literal_hops(plan: Plan, exc_spikes: float, rates: np.ndarray) -> float:
    """Tiles that messages cross in a step, axon by axon; nothing fires more than once a step."""
    spiking, total = exc_spikes / plan.network.neurons, 0.0
    for core, image in zip(plan.cores, core_images(plan), strict=True):
        exc, inh, inputs = (core.part(name) for name in ("exc", "inh", "inputs"))
        for source, chip, other, _ in image.axons_out.tolist():
            rate = spiking
            if source >= 2 * exc.size:  # behind the neurons and their counters
                rate = min(1.0, exc_spikes)
            if source >= 2 * exc.size + inh.size:
                rate = rates[inputs.first + source - inputs.compartment]
            (x, y), (other_x, other_y) = (
                (8 * c + n // 4 // 4, n // 4 % 4) for c, n in ((core.chip, core.core), (chip, other))
            )
            total += rate * (abs(x - other_x) + abs(y - other_y))
    return total


@pytest.mark.parametrize("bias_input", [False, True])
def test_hops_are_those_of_every_output_axon(bias_input: bool) -> None:
    made = network(40, 60, bias_input=bias_input)
    rates = np.random.default_rng(5).random(60) / 5
    board = replace(KAPOHO_BAY, compartments=18)
    plan = partition(made, board, rates, exc_spikes=0.5)
    check_plan(plan)
    assert plan.hops == pytest.approx(literal_hops(plan, 0.5, rates), rel=1e-4)
    assert plan.hops > 0


def test_two_chips_only_when_one_is_full() -> None:
    made = network(30, 20)
    rates = even(made)
    one = partition(made, replace(KAPOHO_BAY, compartments=12, cores=6), rates)
    two = partition(made, replace(KAPOHO_BAY, compartments=12, cores=4), rates)
    assert {core.chip for core in one.cores} == {0}
    assert [sum(core.chip == chip for core in two.cores) for chip in (0, 1)] == [4, 2]
    for plan in (one, two):
        check_plan(plan)
        check_images(plan)
    tables = host_tables(two)
    for chip in (0, 1):
        chosen = [core.part("exc") for core in two.cores if core.chip == chip]
        columns = np.concatenate([np.arange(part.first, part.first + part.size) for part in chosen])
        needed = np.flatnonzero(made.weights[:, columns].any(axis=1))
        assert set(needed) == set(tables.injection[tables.injection[:, 1] == chip, 0])


def test_real_chips_fill_in_order() -> None:
    made = network(299, 30, inhibition=0)
    plan = partition(made, replace(KAPOHO_BAY, compartments=4), even(made))
    check_plan(plan)
    assert [sum(core.chip == chip for core in plan.cores) for chip in (0, 1)] == [128, 22]


def test_cores_on_the_mesh_are_best_for_few_and_near_for_more() -> None:
    rng = np.random.default_rng(6)
    board = replace(KAPOHO_BAY, mesh=Mesh(1, columns=3, rows=2), cores=6)
    worst = 1.0
    for _ in range(20):
        flow = rng.random((5, 5)) ** 4
        every = np.array([(0, core) for core in range(6)])
        near = distances(every, board)
        chosen = (list(order) for order in itertools.permutations(range(6), 5))
        best = min(float((flow * near[np.ix_(order, order)]).sum()) for order in chosen)
        where, hops = assign_cores(flow, board)
        order = where[:, 1]
        assert len(set(order.tolist())) == 5
        assert hops == pytest.approx(float((flow * near[np.ix_(order, order)]).sum()))
        worst = max(worst, (hops or 0) / best)
    assert worst < 1.2
    flow = rng.random((40, 40)) ** 6
    where, hops = assign_cores(flow, KAPOHO_BAY)
    start = np.stack([np.zeros(40, np.int64), np.arange(40)], axis=1)
    assert (hops or 0) < 0.9 * (flow * distances(start, KAPOHO_BAY)).sum()


def test_cores_of_one_tile_send_no_hops() -> None:
    made = network(300, 200)
    plan = partition(made, tiny(synapse_words=3000), even(made))
    assert 1 < len(plan.cores) <= 4
    assert plan.hops == 0
