"""The cost model: published figures digit for digit, times step by step, what every figure is made of, and times before
there are queries: the reference images, asked as queries and counted as those of `bench`."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from support.boards.plans import busy_plan, even, network as small_network, trains_of
from support.common.small_models import encoded, small_model

from lava_vpr import loihi
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.bench.modelling import step_times
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.boards.constants import HOST_POWER, LEVELS, LOIHI_1, Constant, Estimate, total
from lava_vpr.deploy.boards.plan import Plan, Times
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost import embedded, expected
from lava_vpr.deploy.cost.between_queries import clearing, outside_steps
from lava_vpr.deploy.cost.closed_form import step_microseconds, step_nanoseconds, step_picojoules
from lava_vpr.deploy.cost.costs import BoardFigures, all_microseconds, modelled, wall_milliseconds
from lava_vpr.deploy.cost.events import KINDS, EventCounts, count_events
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains

WAYS = ("east_west", "north_south")


PUBLISHED = {
    "accesses": 800 * 350,
    "touched": 139_616,
    "spikes": 32,
    "operations_dense": 2_249_600,
    "messages_out": 28_136,
    "hops_north_south": 11_273,
}
"""What was published of a network of 784 inputs, 400 neurons and 400 inhibitory ones in 350 steps."""


def test_the_published_counts_digit_for_digit() -> None:
    nothing = {name: np.zeros((1, 1, 1), np.int64) for name in KINDS} | {
        name: np.zeros((1, 1), np.int64) for name in ("input_spikes", "exc_spikes", "inh_spikes")
    }
    made = {name: np.full((1, 1, 1), value, np.int64) for name, value in PUBLISHED.items()}
    counted = EventCounts(**{"input_accesses": nothing["spikes"], **nothing, **made, "injected": True, "tiles": 2})
    counted = replace(counted, updates=counted.touched)
    found = step_picojoules(counted, LOIHI_1, "nominal")
    assert sum(float(part.sum()) for part in found.values()) / 1e6 == pytest.approx(100.3851658, abs=1e-10)
    assert found["synaptic operations"].sum() / 1e6 == pytest.approx(79.8608)
    davies = (
        loihi.DAVIES_SYNAPSE_PJ * 2_249_600
        + loihi.DAVIES_INACTIVE_PJ * 800 * 350
        + (loihi.DAVIES_ACTIVE_PJ - loihi.DAVIES_INACTIVE_PJ) * 139_616
        + loihi.DAVIES_WITHIN_TILE_PJ * 28_136
        + loihi.DAVIES_HOP_NORTH_SOUTH_PJ * 11_273
    )
    assert round(davies / 1e6) == 72
    low = sum(float(part.sum()) for part in step_picojoules(counted, LOIHI_1, "low").values()) / 1e6
    # Davies has no energy of sending a message, only of its way within a tile: low does not take one for the other.
    sending = (loihi.MESSAGE_PJ - loihi.DAVIES_WITHIN_TILE_PJ) * 28_136
    assert low == pytest.approx((davies + sending) / 1e6, rel=0.02)
    assert low < (davies + sending) / 1e6


MODES = ("injected", "relayed", "bias")


@pytest.fixture(autouse=True)
def input_mode(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The mode of a test that takes several; relays stand before networks of a few neurons in ``relayed``."""
    mode = str(getattr(request, "param", "injected"))
    monkeypatch.setattr(fixed, "DIRECT", 8 if mode == "relayed" else 1024)
    return mode


every_mode = pytest.mark.parametrize("input_mode", MODES, indirect=True)


def example(mode: str = "injected", n: int = 5, **changes: Any) -> tuple[Plan, EventCounts, Trains]:
    plan = busy_plan(bias_input=mode == "bias", **changes)
    trains = trains_of(plan.network, n, 4)
    assert plan.network.relayed == (mode == "relayed")
    return plan, count_events(plan, trains), trains


@every_mode
def test_a_step_lasts_as_long_as_its_busiest_core(input_mode: str) -> None:
    plan, counted, _ = example(input_mode)
    receive, neurons = step_nanoseconds(counted, LOIHI_1, "nominal")
    time = step_microseconds(counted, LOIHI_1, "nominal")
    for q in range(5):
        for t in range(counted.steps):
            arriving, own = [], []
            for k, core in enumerate(plan.cores):
                x = {name: int(getattr(counted, name)[q, t, k]) for name in ("messages_in", "operations_dense")}
                arriving.append(16 * x["messages_in"] + 3.8 * x["operations_dense"])
                arriving[-1] += 4.7 * int(counted.operations_sparse[q, t, k])
                sent = int(counted.messages_out[q, t, k])
                mapped = sum(part.size for part in core.parts)
                own.append(6.0 * mapped + 3.7 * counted.updates[q, t, k] + 30 * counted.spikes[q, t, k] + 5.1 * sent)
            assert receive[q, t] == pytest.approx(max(arriving))
            assert neurons[q, t] == pytest.approx(max(own))
            used = {2: 1.0, 3: 1.0, 4: 1.4}[int(counted.tiles or 0)]
            assert time[q, t] == pytest.approx(max(*arriving, *own) / 1e3 + used)
    assert (receive > neurons).any() or input_mode == "bias"  # what inputs on the chip take is neurons' part
    assert (receive < neurons).any()
    assert (step_microseconds(counted, LOIHI_1, "high") >= 5.8).all()
    assert (step_microseconds(counted, LOIHI_1, "low") < time).all()


@every_mode
@pytest.mark.parametrize("signed", [False, True])
def test_energy_of_counts(input_mode: str, signed: bool) -> None:
    plan, counted, _ = example(input_mode, signed=signed, threshold=60)
    count = {name: counted.each(name) for name in EventCounts.__dataclass_fields__ if name not in ("injected", "tiles")}
    messages = count["messages_out"] + count["injected_messages"]
    hops = {way: count[f"hops_{way}"] + count[f"injected_hops_{way}"] for way in WAYS}
    expected = {
        "synaptic operations": 35.5 * count["operations_dense"] + 33.6 * count["operations_sparse"],
        "neuron accesses": 51.2 * count["accesses"],
        "neuron updates": 21.6 * count["updates"],
        "spikes": 69.3 * count["spikes"],
        "hops": 3.0 * hops["east_west"] + 4.2 * hops["north_south"],
    }
    parts = step_picojoules(counted, LOIHI_1, "nominal")
    for name, picojoules in expected.items():
        assert parts[name].sum(axis=1) == pytest.approx(picojoules, rel=1e-12), name
    sent = parts["input messages"] + parts["other messages"] + parts["read-out"]
    assert sent.sum(axis=1) == pytest.approx(111 * messages, rel=1e-12)
    assert parts["input messages"].sum() == pytest.approx(111 * count["input_messages"].sum())
    others = messages - count["input_messages"] - count["read_outs"]
    assert parts["other messages"].sum() == pytest.approx(111 * others.sum())
    holding = sum(core.part("exc").size > 0 for core in plan.cores)
    assert others.sum() == (count["exc_spikes"] + holding * count["inh_spikes"]).sum() > 20
    injected = {"bias": 0, "relayed": count["input_spikes"].sum(), "injected": count["input_messages"].sum()}
    assert count["injected_messages"].sum() == injected[input_mode]
    assert hops["east_west"].any()


def figures_of(plan: Plan, counted: EventCounts) -> BoardFigures:
    return modelled(plan, counted).figures


def estimates(*values: Any) -> list[Estimate]:
    """All estimates in ``values``, which may be dictionaries of them."""
    inner = [item for value in values for item in (value.values() if isinstance(value, dict) else (value,))]
    return [item for item in inner if isinstance(item, Estimate)]


@every_mode
def test_what_a_query_costs(input_mode: str) -> None:
    plan, counted, _ = example(input_mode)
    costs, found = modelled(plan, counted), figures_of(plan, counted)
    mode, steps = "bias" if input_mode == "bias" else "injected", 34 if input_mode == "relayed" else 33
    assert (costs.target, costs.chips, costs.cores, costs.steps) == ("kapoho-bay", 2, len(plan.cores), steps)
    assert (costs.input_mode, costs.unavailable) == (mode, None)
    every = estimates(*vars(found).values(), costs.clearing)
    assert len(every) >= 20
    assert all(0 <= one.low <= one.nominal <= one.high for one in every)
    # What SANA-FE knows, and what it does not: reading counts, clearing, and settings of the inputs.
    own = sum(part.sum() / 5 for part in step_picojoules(counted, LOIHI_1, "nominal").values()) / 1e6
    beyond = found.dynamic_by_component["clearing of states"] + found.dynamic_by_component["reading of counts"]
    if mode == "bias":
        beyond = beyond + found.dynamic_by_component["settings of the inputs"]
    whole = total(found.dynamic_by_component.values())
    assert whole.nominal == pytest.approx(own + beyond.nominal)
    assert found.dynamic_by_component["read-out"].nominal == pytest.approx(111e-6 * counted.exc_spikes.sum() / 5)
    program = embedded.step_microseconds(plan, counted, LOIHI_1, "nominal")
    on_cores = step_microseconds(counted, LOIHI_1, "nominal")
    assert found.milliseconds.nominal == pytest.approx(
        (on_cores + program).sum(axis=1).mean() / 1e3 + found.embedded["query_milliseconds"].nominal
    )
    assert found.embedded["step_microseconds"].nominal == pytest.approx(program.mean())
    # Two chips, used or not.
    assert found.static_millijoules.nominal == pytest.approx(2 * 169 * found.milliseconds.nominal / 1e3)
    assert found.static_millijoules.low == pytest.approx(2 * 29 * found.milliseconds.low / 1e3)
    assert next(iter(found.io_milliseconds_by_way)) == next(iter(found.io_microjoules_by_way)) == mode
    assert set(found.io_milliseconds_by_way) == set(found.io_microjoules_by_way) == {"injected", "bias"}
    # Static energy of the time with the host's traffic, not of the chips' work alone.
    wall = {"injected": (0.1728, 0.8867, 8.2044), "relayed": (0.1181, 0.8882, 4.4593), "bias": (0.0787, 0.138, 1.811)}
    for level, milliwatts, literal in zip(LEVELS, (29, 169, 169), wall[input_mode], strict=True):
        assert found.wall_milliseconds.at(level) == pytest.approx(literal, rel=1e-3)
        assert found.wall_static_millijoules.at(level) == pytest.approx(2 * milliwatts * literal / 1e3, rel=1e-3)
    assert found.wall_static_millijoules.high > 2 * found.static_millijoules.high
    assert found.io_milliseconds == found.io_milliseconds_by_way[mode]
    assert found.dynamic_microjoules == whole
    assert sum(found.busiest.values()) == pytest.approx(1)
    assert costs.busiest_core["updates"] == pytest.approx(counted.updates.max(axis=2).mean())
    assert costs.assumptions
    # All steps, and what is outside of them.
    microjoules, milliseconds = outside_steps(plan, LOIHI_1)
    picojoules = sum(step_picojoules(counted, LOIHI_1, "nominal").values())
    assert picojoules.sum() / 5e6 + microjoules.nominal == pytest.approx(whole.nominal)
    microseconds = all_microseconds(plan, counted, LOIHI_1, "nominal")
    assert microseconds.sum() / 5e3 + milliseconds.nominal == pytest.approx(found.milliseconds.nominal)


@pytest.mark.parametrize("packet", [3.0, 27.8])
def test_packets_come_while_steps_last_and_settings_before_them(packet: float) -> None:
    """30 steps of 5 us, 40 us of silent steps and between queries, 13.9 us of counts: packet by packet."""
    ended = 0.0
    for number in range(1, 31):
        ended = max(ended, number * packet) + 5.0
    times = [Estimate(x, x, x) * 1e-3 for x in (30 * 5.0 + 40, 30 * packet, 13.9)]
    for taken, nominal in ((30, ended + 40 + 13.9), (0, 30 * packet + 190 + 13.9)):
        found = wall_milliseconds(*times, Estimate(5.0, 5.0, 5.0), taken) * 1e3
        assert (found.low, found.nominal) == pytest.approx((nominal, nominal))
        assert found.high == pytest.approx(30 * packet + 190 + 13.9)


def test_counts_of_a_query() -> None:
    plan, counted, trains = example()
    counts = modelled(plan, counted).counts
    contract = ("synaptic_operations", "neuron_updates", "input_spikes", "exc_spikes", "inh_spikes", "messages", "hops")
    assert set(contract) | {"steps"} <= set(counts)
    assert counts["input_spikes"] == trains.inputs.sum() / 5
    assert counts["exc_spikes"] == trains.exc.sum() / 5 > counts["inh_spikes"] == trains.inh.sum() / 5 > 0
    assert counts["messages"] == (counted.messages_out.sum() + counted.injected_messages.sum()) / 5
    assert counts["steps"] == 33
    assert counts["synaptic_operations"] == (counted.operations_dense.sum() + counted.operations_sparse.sum()) / 5
    hops = [f"{kind}hops_{way}" for kind in ("", "injected_") for way in WAYS]
    assert counts["hops"] == pytest.approx(sum(int(getattr(counted, name).sum()) for name in hops) / 5)
    bias, counted, _ = example("bias")
    assert modelled(bias, counted).counts["messages"] == counted.messages_out.sum() / 5


@pytest.mark.parametrize("input_mode", ["injected", "relayed"], indirect=True)
def test_input_layer_beside_an_injected_network(input_mode: str) -> None:
    # About 6 uJ per 100 steps for 784 inputs, accesses and updates alone.
    made = replace(small_network(10, 784), steps=97, regular=True)
    bias = replace(made, bias_input=True)
    found, true = (
        figures_of(plan, count_events(plan, trains_of(plan.network, 1, 0))) for plan in map(placed, (made, bias))
    )
    assert 784 * 100 * 72.8e-6 == pytest.approx(5.7, rel=0.01)
    assert found.io_microjoules_by_way["bias"].nominal > 5.7
    # The spikes are the same: what is estimated beside one network is what the other really takes.
    for mode in ("injected", "bias"):
        estimates = (one.io_microjoules_by_way[mode].nominal for one in (found, true))
        assert next(estimates) == pytest.approx(next(estimates), rel=0.05), mode
    assert true.dynamic_microjoules.nominal > true.io_microjoules_by_way["bias"].nominal
    # What a relay does: it is accessed in every step, and updated when its input spikes.
    relays = 784 * 100 * 51.2e-6 if input_mode == "relayed" else 0
    assert found.io_microjoules_by_way["injected"].nominal > relays


def placed(made: FixedNetwork) -> Plan:
    """The network's partition on Kapoho Bay."""
    return partition(made, KAPOHO_BAY, even(made))


def test_clearing_is_counted_and_rest_beside_it() -> None:
    plan, counted, _ = example()
    told = modelled(plan, counted).clearing
    assert told["exc_writes_per_query"] == 20
    east_west, north_south = embedded.entry_hops(plan)
    each = 111 + 3.0 * east_west + 4.2 * north_south + 51.2 + 21.6
    assert told["microjoules"].nominal == pytest.approx(2 * 20 * each / 1e6)  # membranes of neurons and of counters
    most = max(embedded.counts_on_chips(plan, "exc").values())
    assert 10 <= most < 20
    assert told["milliseconds"].nominal == pytest.approx(2 * most * 100 / 1e6)
    assert told["rest_microjoules"].nominal == pytest.approx(told["rest_steps_instead"] * (41 * 51.2 + 20 * 21.6) / 1e6)
    assert told["cheaper"] == (
        "rest steps" if told["rest_microjoules"].nominal < 2 * 20 * each / 1e6 else "embedded writes"
    )
    quickly = replace(plan, network=replace(plan.network, decay=4095, threshold=50, inhibition=0))
    assert clearing(quickly, counted, LOIHI_1)["cheaper"] == "rest steps"
    # A membrane that integrates a bias never rests.
    biased = replace(plan, network=replace(plan.network, bias=np.full(20, -3, np.int32)))
    told = clearing(biased, counted, LOIHI_1)
    assert told["cheaper"] == "embedded writes"
    assert told["rest_steps_instead"] is told["rest_microjoules"] is told["rest_milliseconds"] is None


def test_steps_that_are_run_cost_what_they_do_in_a_shorter_presentation() -> None:
    plan, counted, trains = example()
    cut = Trains(trains.exc[3:4, :20], trains.inputs[3:4, :20])  # type: ignore[index]
    short = count_events(replace(plan, network=replace(plan.network, steps=17)), cut)
    for name, picojoules in step_picojoules(counted, LOIHI_1, "nominal").items():
        assert np.array_equal(picojoules[3:4, :20], step_picojoules(short, LOIHI_1, "nominal")[name]), name
    microseconds = step_microseconds(counted, LOIHI_1, "nominal")
    assert np.array_equal(microseconds[3:4, :20], step_microseconds(short, LOIHI_1, "nominal"))


@every_mode
def test_outside_of_the_steps_states_are_cleared_and_inputs_set(input_mode: str) -> None:
    plan, counted, _ = example(input_mode)
    clearing, found = modelled(plan, counted).clearing, figures_of(plan, counted)
    microjoules, milliseconds = outside_steps(plan, LOIHI_1)
    written = [clearing["microjoules"], found.dynamic_by_component["reading of counts"]]
    if input_mode == "bias":
        written.append(found.dynamic_by_component["settings of the inputs"])
    assert microjoules == total(written)
    assert milliseconds == found.embedded["query_milliseconds"]
    assert milliseconds.low > clearing["milliseconds"].low


def test_loihi_2_has_counts_and_no_figures() -> None:
    made = replace(small_network(12, 20), steps=29)
    plan = partition(made, LOIHI_2, even(made))
    found = modelled(plan, count_events(plan, trains_of(made, 2, 0)))
    assert re.search("no energy or time per operation of Loihi 2 has been published", found.unavailable)
    assert found.counts["hops"] is None
    assert found.counts["synaptic_operations"]
    # One core: what it has most of is all there is.
    assert found.busiest_core["synaptic_operations"] * 32 == pytest.approx(found.counts["synaptic_operations"])
    assert found.busiest_core["accesses"] == 13
    assert estimates(*vars(found).values()) == []
    assert found.tiles is found.figures is found.as_json()["dynamic_microjoules"] is None
    nothing = modelled(busy_plan(bias_input=False), example(n=0)[1])
    assert nothing.unavailable == "there is no query"


def test_every_constant_has_its_source() -> None:
    names = [one.name for one in LOIHI_1.listed()]
    assert len(set(names)) == len(names) >= 20
    assert {item.name for item in fields(LOIHI_1) if isinstance(getattr(LOIHI_1, item.name), Constant)} <= set(names)
    for one in LOIHI_1.listed():
        assert 0 <= one.low <= one.nominal <= one.high, one.name
        assert one.unit in ("pJ", "ns", "us", "mW")
        assert re.search(r"doi 10\.|arXiv|not verified|an assumption, no figure is public", one.source), one.name
    assert total([LOIHI_1.synapse_dense]) == Estimate(23.6, 35.5, 35.5)
    assert total([LOIHI_1.update]) == Estimate(21.6, 21.6, 29.0)
    # Sending a message is known from one source; its way within a tile from another, and no bound of the first.
    assert total([LOIHI_1.message]) == Estimate(111.0, 111.0, 112.7)
    assert total([LOIHI_1.message_time]) == Estimate(5.1, 5.1, 5.1)
    assert total([LOIHI_1.register_time]) == Estimate(25.0, 100.0, 400.0)
    assert total([LOIHI_1.word_time]) == Estimate(5.0, 20.0, 80.0)
    assert LOIHI_1.static + LOIHI_1.embedded == Estimate(29.0, 169.0, 169.0)
    assert total([HOST_POWER]) == Estimate(5e3, 10e3, 20e3)
    assert (HOST_POWER.unit, "assumption" in HOST_POWER.source) == ("mW", True)
    assert total([LOIHI_1.access_time]) == Estimate(5.3, 6.0, 6.0)


def test_barrier_by_tiles() -> None:
    found = [LOIHI_1.barrier(tiles).nominal for tiles in (1, 2, 3, 4, 28, 29, 32, 64)]
    assert found == [0.6, 1.0, 1.0, 1.4, 1.4, 1.8, 1.8, 1.8]
    assert (LOIHI_1.barrier(1).low, LOIHI_1.barrier(32).low, LOIHI_1.barrier(64).low) == (0.113, 0.465, 0.465)
    assert 0.113 < LOIHI_1.barrier(16).low < 0.465
    assert all(LOIHI_1.barrier(t).high == LOIHI_1.barrier(t).nominal for t in (1, 32))


@pytest.mark.parametrize("most", [100, 3])
def test_times_are_those_of_the_references_as_queries(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of many references some, evenly spread; however few are counted at once."""
    monkeypatch.setattr(expected, "MOST", most)
    model = small_model()
    plan = plan_of(model, KAPOHO_BAY)
    asked = np.arange(8) if most > 8 else np.array([0, 4, 7])
    trains = HostBackend().trains(model, query_presentations(model, encoded()).part(asked))
    events = count_events(plan, trains)
    costs = modelled(plan, events).figures
    monkeypatch.setattr(expected, "_TOGETHER", 2)
    found = expected.timed(plan, model)
    assert found.times == Times(len(asked), 8, costs.step_microseconds, costs.milliseconds)
    assert found.times.activity == f"{'' if most > 8 else '3 of '}its 8 reference images, asked as queries"
    (core,) = found.cores
    program = costs.embedded["step_microseconds"].nominal
    barrier = KAPOHO_BAY.constants.barrier(1).nominal
    assert core.microseconds == pytest.approx(costs.step_microseconds.nominal - program - barrier)


def test_a_board_without_public_times_has_none() -> None:
    plan = plan_of(small_model(), LOIHI_2)
    assert expected.timed(plan, small_model()) is plan
    assert plan.times is None


@pytest.mark.slow
def test_the_parts_of_a_step_add_up_to_its_time() -> None:
    """The picture of the steps and the table of costs say the same."""
    plan = busy_plan()
    events = count_events(plan, trains_of(plan.network, 3, 0))
    times, costs = step_times(plan, events, LOIHI_1), modelled(plan, events).figures
    assert min(times.program) > 0
    whole = np.mean(times.busiest) + np.mean(times.program) + times.barrier
    assert whole == pytest.approx(costs.step_microseconds.nominal)
