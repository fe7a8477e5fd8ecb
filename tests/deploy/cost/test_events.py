"""What cores do is counted as the register-level simulation counts it, and step by step as a literal count has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.boards.plans import busy_plan, chips_of, pictures, random_network, simple_plan, trains_of
from support.boards.small_boards import even, tiny
from support.boards.small_boards import network as small_network

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.events import KINDS, EventCounts, count_events
from lava_vpr.deploy.mapping.mesh import tiles
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.deploy.registers.core_images import core_images, host_tables
from lava_vpr.deploy.registers.simulator_kernels import EVENTS
from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork
from lava_vpr.engine.trains import Trains


def positions(plan: Plan) -> np.ndarray:
    return tiles(np.array([(core.chip, core.core) for core in plan.cores]), plan.board)


def simulated(plan: Plan, n: int, seed: int) -> dict[str, np.ndarray]:
    return chips_of(plan, positions=positions(plan)).present(*pictures(plan.network, n, seed)).events


def test_counts_are_those_of_the_registers() -> None:
    seen = dict.fromkeys(EVENTS, 0)
    for seed in range(24):
        network = random_network(seed, bias_input=seed % 2 == 1)
        plan = simple_plan(network, 1 + seed % 6, seed)
        counted, expected = count_events(plan, trains_of(network, 2, seed)), simulated(plan, 2, seed)
        for name in EVENTS:
            assert np.array_equal(getattr(counted, name).sum(axis=(0, 1)), expected[name]), (seed, name)
            seen[name] += int(expected[name].sum())
    assert min(seen.values()) > 100, seen


@pytest.mark.parametrize("bias_input", [False, True])
def test_counts_on_a_partitioned_network(bias_input: bool) -> None:
    made = replace(small_network(90, 90, inhibition=20, bias_input=bias_input, seed=3), steps=50)
    plan = partition(made, tiny(synapse_words=240), even(made))
    assert len(plan.cores) == 4
    assert len({core.dense_lateral for core in plan.cores}) == 2
    assert any(core.dense_inputs.any() and not core.dense_inputs.all() for core in plan.cores)
    counted, expected = count_events(plan, trains_of(made, 3, 1)), simulated(plan, 3, 1)
    for name in EVENTS:
        assert np.array_equal(getattr(counted, name).sum(axis=(0, 1)), expected[name]), name
    assert counted.exc_spikes.sum() > 50


def literal(plan: Plan, trains: Trains) -> dict[str, np.ndarray]:
    """The same counts step by step, from the images' axons and rows and one membrane after another."""
    images, tables, network = core_images(plan), host_tables(plan), plan.network
    n, total, _ = trains.exc.shape
    found = {name: np.zeros((n, total, len(images)), np.int64) for name in KINDS}
    place = {(image.chip, image.core): k for k, image in enumerate(images)}
    formats = [[f and f["compression"] for f in image.registers["synapseFmt"]] for image in images]
    where, inh = positions(plan), np.zeros_like(trains.exc)
    inh[:, 1:] = trains.exc[:, :-1]
    spikes = {"exc": trains.exc, "inh": inh, "inputs": trains.inputs}

    def arrive(at: tuple[int, int], k: int, axon: int, way: tuple[int, int] | None) -> None:
        first, _, synapses = images[k].axons_in[axon]
        sparse = formats[k][int(images[k].synapses[first]) & 15] == 0
        found["messages_in"][(*at, k)] += 1
        found["operations_sparse" if sparse else "operations_dense"][(*at, k)] += synapses
        if way is not None:
            found["input_messages"][(*at, k)] += 1
            found["input_hops_east_west"][(*at, k)] += way[0]
            found["input_hops_north_south"][(*at, k)] += way[1]

    for name, table in (("exc", tables.exc), ("inh", tables.inh), ("inputs", tables.inputs)):
        for number, (chip, core, compartment) in enumerate(table):
            k = place[chip, core]
            own = images[k].axons_out[images[k].axons_out[:, 0] == compartment]
            for at in zip(*np.nonzero(spikes[name][:, :, number]), strict=True):
                found["spikes"][(*at, k)] += 1
                for _, target_chip, target_core, axon in own:
                    if target_core < 0:
                        found["read_outs"][(*at, k)] += 1
                        continue
                    target = place[target_chip, target_core]
                    way = abs(where[k] - where[target])
                    found["messages_out"][(*at, k)] += 1
                    found["crossings"][(*at, k)] += target_chip != chip
                    found["hops_east_west"][(*at, k)] += way[0]
                    found["hops_north_south"][(*at, k)] += way[1]
                    arrive(at, target, axon, tuple(way) if name == "inputs" else None)
    for number, chip, core, axon in tables.injection:
        k = place[chip, core]
        entry = abs(where[k] - (chip * KAPOHO_BAY.columns, 0))
        for at in zip(*np.nonzero(trains.inputs[:, :, number]), strict=True):
            arrive(at, k, axon, tuple(entry))
    keep, weights = 4096 - network.decay, network.weights.astype(int)
    for core, (name, number) in _compartments(tables, place):
        for q in range(n):
            v = 0
            for t in range(total):
                if name == "inputs":
                    reason = touched = t < network.steps or not trains.inputs[q, network.steps - 1, number]
                elif name == "inh":
                    reason = touched = bool(inh[q, t, number])
                else:
                    drive = int(trains.inputs[q, t - 1] @ weights[:, number]) if t else 0
                    pulls = int(trains.exc[q, t - 2].sum() - trains.exc[q, t - 2, number]) if t > 1 else 0
                    a = drive - pulls * network.lateral
                    reason = v != 0 or a != 0
                    touched = v != 0 or _hit(plan, trains, q, t, core, number)
                    size = abs(v) * keep >> 12
                    v = (size if v >= 0 else -size) + (a << 6)
                    v = 0 if trains.exc[q, t, number] else v
                found["updates"][q, t, core] += reason
                found["touched"][q, t, core] += touched
                found["input_updates"][q, t, core] += reason and name == "inputs"
    return found


def _compartments(tables, place):  # type: ignore[no-untyped-def]
    for name in ("exc", "inh", "inputs"):
        for number, (chip, core, _) in enumerate(getattr(tables, name)):
            yield place[chip, core], (name, number)


def _hit(plan: Plan, trains: Trains, q: int, t: int, core: int, number: int) -> bool:
    """Whether a stored synapse of a spike delivers to exc neuron ``number`` in step ``t``."""
    own, network = plan.cores[core], plan.network
    if (
        t
        and any(
            network.weights[j, number] or own.dense_inputs[j]  # the core has rows of inputs with a weight there only
            for j in np.flatnonzero(trains.inputs[q, t - 1])
            if network.weights[j, own.part("exc").first : own.part("exc").first + own.part("exc").size].any()
        )
    ):
        return True
    if t < 2 or not network.inhibition:
        return False
    relays = np.flatnonzero(trains.exc[q, t - 2])
    return any(i != number or (own.dense_lateral and own.part("exc").size > 1) for i in relays)


@pytest.mark.parametrize("bias_input", [False, True])
def test_counts_step_by_step(bias_input: bool) -> None:
    several = 0
    for seed, changes in ((0, {}), (1, {"inhibition": 0}), (2, {"threshold": 3}), (3, {"threshold": 900})):
        plan = busy_plan(bias_input=bias_input, steps=12, **changes)
        trains = trains_of(plan.network, 2, seed)
        counted, expected = count_events(plan, trains), literal(plan, trains)
        for name in KINDS:
            assert np.array_equal(getattr(counted, name), expected[name]), (seed, name)
        several += int(counted.exc_spikes.sum())
    assert several > 20


def test_a_relays_own_dense_row_touches_its_neuron() -> None:
    # Each input makes one neuron spike; two steps later its own relay's row holds a 0 for it, and nothing else arrives.
    network = FixedNetwork((255 * np.eye(4)).astype(np.uint8), 8, 0, 100, 1, 0, 4095, 40)
    touched = []
    for seed in range(6):
        plan = simple_plan(network, 1, seed)
        trains = trains_of(network, 2, seed)
        counted, expected = count_events(plan, trains), literal(plan, trains)
        assert np.array_equal(counted.touched, expected["touched"])
        assert np.array_equal(counted.updates, expected["updates"])
        touched.append((plan.cores[0].dense_lateral, bool((counted.touched > counted.updates).any())))
    assert (True, True) in touched


def test_touched_is_updated_or_hit_by_nothing() -> None:
    # Weights 2 and 0 in dense rows: neuron 1 is hit without effect, neuron 0 cancelled by its neighbour's relay.
    more = 0
    for seed in range(12):
        network = random_network(seed, size=(3, 6), bits=1, decay=4095, steps=30, bias_input=False)
        plan = simple_plan(network, 2, seed)
        counted = count_events(plan, trains_of(network, 2, seed))
        assert (counted.touched >= counted.updates).all()
        more += int((counted.touched - counted.updates).sum())
    assert more > 0


def test_parts_and_what_is_mapped() -> None:
    plan = busy_plan(bias_input=True)
    trains = trains_of(plan.network, 4, 2)
    whole = count_events(plan, trains)
    assert (whole.queries, whole.steps, whole.injected) == (4, plan.network.steps + SILENT_STEPS, False)
    assert whole.accesses[0, 0].sum() == 2 * 20 + 30
    assert whole.input_accesses[3, 7].sum() == 30
    assert whole.tiles == len({(core.chip, core.core // 4) for core in plan.cores}) > 1
    for q in range(4):
        one = count_events(plan, Trains(trains.exc[[q]], trains.inputs[[q]]))
        part = whole.part(slice(q, q + 1))
        for name in EventCounts.__dataclass_fields__:
            assert np.array_equal(getattr(one, name), getattr(part, name)), name
    assert np.array_equal(
        whole.each("spikes"), whole.exc_spikes.sum(1) + whole.inh_spikes.sum(1) + whole.each("input_spikes")
    )


def test_injected_spikes_enter_where_they_are_said_to() -> None:
    plan = busy_plan(bias_input=False)
    trains = trains_of(plan.network, 1, 0)
    own, far = count_events(plan, trains), count_events(plan, trains, entry=(3, 2))
    where = positions(plan)
    for counted, start in ((own, [(8 * core.chip, 0) for core in plan.cores]), (far, [(3, 2)] * len(plan.cores))):
        ways = abs(where - np.array(start))
        assert np.array_equal(counted.input_hops_east_west, counted.input_messages * ways[:, 0])
        assert np.array_equal(counted.input_hops_north_south, counted.input_messages * ways[:, 1])
    assert far.input_hops_north_south.any()
    assert np.array_equal(own.hops_east_west, far.hops_east_west)


def test_a_board_whose_mesh_is_not_public() -> None:
    made = replace(small_network(12, 20), steps=20, shift=2, threshold=20)
    plan = partition(made, LOIHI_2, even(made))
    counted = count_events(plan, trains_of(made, 2, 0))
    assert counted.tiles is None
    assert not counted.hops_east_west.any()
    assert counted.exc_spikes.sum() > 5
    assert counted.each("messages_out").sum() == 2 * counted.exc_spikes.sum()


def test_trains_of_another_network_are_refused() -> None:
    plan = busy_plan(bias_input=False)
    trains = trains_of(plan.network, 2, 0)
    wrong = trains.exc.copy()
    query, step, neuron = np.argwhere(wrong)[-1]
    wrong[query, step, neuron] = 0
    with pytest.raises(
        ValueError, match=f"^query {query}: the spikes of step {step} are not those of the plan's network$"
    ):
        count_events(plan, Trains(wrong, trains.inputs))
    for bad in (
        Trains(trains.exc),
        Trains(trains.exc, trains.inputs[:, :, 1:]),
        Trains(trains.exc[..., 1:], trains.inputs),
    ):
        with pytest.raises(ValueError, match="trains hold no input spikes, or are not those of the plan's network"):
            count_events(plan, bad)
