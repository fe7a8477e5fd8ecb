"""What cores do is counted step by step as a literal count has it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from support.boards.plans import busy_plan, even, network as small_network, random_network, simple_plan, tiny, trains_of

from lava_vpr.deploy.boards.board import LOIHI_2
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.events import KINDS, count_events
from lava_vpr.deploy.mapping.partition import partition, tiles
from lava_vpr.engine.inference import counting, fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains

Neuron = tuple[str, int]
"""Population and number; ``root`` and ``leaf`` apart, an injected input without a compartment is a ``source``."""


def positions(plan: Plan) -> np.ndarray:
    return tiles(np.array([(core.chip, core.core) for core in plan.cores]), plan.board)


def small_chips(monkeypatch: pytest.MonkeyPatch, fan_in: int = 5, direct: int = 8) -> None:
    """Leaves and relays for networks of a few neurons."""
    monkeypatch.setattr(fixed, "FAN_IN", fan_in)
    monkeypatch.setattr(fixed, "DIRECT", direct)


def plans(count: int) -> Iterator[tuple[int, Plan]]:
    """Random networks in random plans, both input modes, some without inhibition."""
    for seed in range(count):
        changes = {"inhibition": 0} if seed % 8 == 7 else {}
        yield seed, simple_plan(random_network(seed, bias_input=seed % 3 == 1, **changes), 1 + seed % 6, seed)


class Literal:
    """The same counts neuron by neuron, synapse by synapse: `found`, int64 (n, steps, cores) by name."""

    def __init__(self, plan: Plan, trains: Trains, entry: tuple[int, int] | None = None) -> None:
        self.plan, self.network, self.trains, self.entry = plan, plan.network, trains, entry
        n, self.steps, _ = trains.exc.shape
        self.found = {name: np.zeros((n, self.steps, len(plan.cores)), np.int64) for name in KINDS}
        self.home = dict(self.compartments())
        self.where = positions(plan)
        for query in range(n):
            self.present(query)

    def compartments(self) -> Iterator[tuple[Neuron, int]]:
        for k, core in enumerate(self.plan.cores):
            for part in core.parts:
                for number in range(part.first, part.first + part.size):
                    inhibitory = "root" if number == self.network.inhibitory - 1 else "leaf"
                    yield (inhibitory if part.population == "inh" else part.population, number), k

    def row(self, source: Neuron, k: int) -> tuple[bool, dict[Neuron, int]]:
        """Whether the row that a spike of ``source`` meets on core k is dense, and its synapses; none: no message."""
        (name, number), network = source, self.network
        core, last = self.plan.cores[k], ("root", network.inhibitory - 1)
        here = [i for (population, i), at in self.home.items() if population == "exc" and at == k]
        if name == "exc":
            target = ("leaf", number // fixed.FAN_IN) if network.leaves else last
            return False, {target: 2} if self.home[target] == k else {}
        if name == "counted":  # what goes to its counter, besides
            return False, {("counters", number): 2} if self.home["counters", number] == k else {}
        if name == "leaf":
            return False, {last: 2} if self.home[last] == k else {}
        if name == "root":
            return False, {("exc", i): -network.lateral for i in here} if network.inhibition else {}
        if name == "source" and network.relayed:
            return False, {("inputs", number): 2} if self.home["inputs", number] == k else {}
        weights = {("exc", i): int(network.weights[number, i]) for i in here}
        dense = bool(core.dense_inputs[number])
        if not any(weights.values()):
            return dense, {}
        return dense, weights if dense else {i: weight for i, weight in weights.items() if weight}

    def present(self, q: int) -> None:
        """One presentation, with its own dynamics; who spikes must be who spikes in the trains."""
        network, steps, arriving = self.network, self.network.steps, {}
        v = dict.fromkeys(self.home, 0)
        for t in range(self.steps):
            spikes: list[Neuron] = []
            sums, arriving = arriving, {}
            for neuron, k in self.home.items():
                (name, number), before = neuron, v[neuron]
                a = sum(sums.get(neuron, []))
                if name == "inputs" and network.bias_input:  # its train is known, its membrane is not
                    reason = t < steps or not self.trains.inputs[q, steps - 1, number]
                    fires = bool(self.trains.inputs[q, t, number])
                    self.count(q, t, k, input_updates=reason)
                    touched = reason
                else:
                    bias = int(network.bias[number]) if name == "exc" else 0
                    keep = {"exc": 4096 - network.decay, "counters": 4096}.get(name, 0)
                    reason = before != 0 or a != 0 or bias != 0
                    touched = reason or neuron in sums
                    size = abs(before) * keep >> 12
                    after = max(-(2**23) + 1, (size if before >= 0 else -size) + (a << 6) + bias)
                    fires = after > {"exc": network.threshold, "counters": 131071}.get(name, 1) << 6
                    v[neuron] = 0 if fires else after
                    self.count(q, t, k, input_updates=reason and name == "inputs")
                    if name == "exc":
                        assert fires == bool(self.trains.exc[q, t, number])
                self.count(q, t, k, updates=reason, touched=touched, spikes=fires, read_outs=fires and name == "exc")
                spikes += [neuron] if fires else []
                spikes += [("counted", number)] if fires and name == "exc" else []
            if not network.bias_input:
                spikes += [("source", int(j)) for j in np.flatnonzero(self.trains.inputs[q, t])]
            for neuron in spikes:
                self.send(q, t, neuron, arriving)

    def send(self, q: int, t: int, source: Neuron, arriving: dict[Neuron, list[int]]) -> None:
        """The messages of a spike, and what they meet."""
        cores = self.plan.cores
        for k, core in enumerate(cores):
            dense, row = self.row(source, k)
            if not row:
                continue
            sender = ("exc", source[1]) if source[0] == "counted" else source
            start = self.where[self.home[sender]] if sender in self.home else self.entry or (8 * core.chip, 0)
            east_west, north_south = (int(tile) for tile in abs(self.where[k] - np.array(start)))
            own = {"east_west": east_west, "north_south": north_south}
            self.count(q, t, k, messages_in=1, **{"operations_dense" if dense else "operations_sparse": len(row)})
            if source[0] in ("inputs", "source"):
                self.count(q, t, k, input_messages=1, **{f"input_hops_{way}": far for way, far in own.items()})
            if source[0] == "source":
                self.count(q, t, k, injected_messages=1, **{f"injected_hops_{way}": far for way, far in own.items()})
            else:
                home = self.home[sender]
                self.count(q, t, home, messages_out=1, crossings=core.chip != cores[home].chip)
                self.count(q, t, home, **{f"hops_{way}": far for way, far in own.items()})
            for neuron, weight in row.items():
                arriving.setdefault(neuron, []).append(weight)

    def count(self, q: int, t: int, k: int, **events: int) -> None:
        for name, number in events.items():
            self.found[name][q, t, k] += number


@pytest.mark.quick(1)
@pytest.mark.parametrize("deep", [False, True])
def test_counts_step_by_step(deep: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if deep:
        small_chips(monkeypatch)
    seen = dict.fromkeys((*KINDS, "leaves", "relays", "signed", "biased", "uninhibited"), 0)
    for seed, plan in plans(24):
        network, trains, entry = plan.network, trains_of(plan.network, 2, seed), (3, 2) if seed % 2 else None
        counted, expected = count_events(plan, trains, entry=entry), Literal(plan, trains, entry).found
        for name in KINDS:
            assert np.array_equal(getattr(counted, name), expected[name]), (seed, name)
            seen[name] += int(expected[name].sum())
        assert np.array_equal(counted.inh_spikes, counting.inhibitory_spikes(network, trains.exc).sum(axis=2))
        seen["leaves"] += network.leaves
        seen["relays"] += network.relayed
        seen["signed"] += network.signed
        seen["biased"] += bool(network.bias.any())
        seen["uninhibited"] += not network.inhibition
    assert seen["leaves"] >= 20 * deep
    assert seen["relays"] >= 5 * deep
    assert [name for name in seen if not seen[name] and name not in ("leaves", "relays")] == []


@pytest.mark.parametrize("bias_input", [False, True])
def test_counts_of_much_activity(bias_input: bool) -> None:
    several = 0
    for seed, changes in ((0, {}), (1, {"inhibition": 0}), (2, {"threshold": 3}), (3, {"threshold": 900})):
        plan = busy_plan(bias_input=bias_input, steps=12, **changes)
        trains = trains_of(plan.network, 2, seed)
        counted, expected = count_events(plan, trains), Literal(plan, trains).found
        for name in KINDS:
            assert np.array_equal(getattr(counted, name), expected[name]), (seed, name)
        several += int(counted.exc_spikes.sum())
    assert several > 20


@pytest.mark.parametrize("bias_input", [False, True])
@pytest.mark.parametrize("signed", [False, True])
def test_counts_on_a_partitioned_network(bias_input: bool, signed: bool) -> None:
    made = small_network(90, 90, inhibition=20, bias_input=bias_input, signed=signed, seed=3)
    plan = partition(made, tiny(synapse_words=250, counters=True), even(made), dense_rows=True)
    assert len(plan.cores) > 2
    assert any(core.dense_inputs.any() and not core.dense_inputs.all() for core in plan.cores)
    trains = trains_of(made, 2, 1)
    counted, expected = count_events(plan, trains), Literal(plan, trains).found
    for name in KINDS:
        assert np.array_equal(getattr(counted, name), expected[name]), name
    assert counted.exc_spikes.sum() > 50


def eye(**changes: object) -> FixedNetwork:
    """Each input makes one of four neurons spike, which forget at once."""
    weights, bias = (127 * np.eye(4)).astype(np.int16), np.zeros(4, np.int32)
    return replace(FixedNetwork(weights, bias, 7, False, 100, 1, 0, 4095, 40), **changes)


def one_core(network: FixedNetwork, seed: int = 0) -> Plan:
    plan = simple_plan(network, 1, seed)
    return replace(plan, cores=(replace(plan.cores[0], dense_inputs=np.zeros(network.inputs, bool)),))


def first_spike(network: FixedNetwork) -> Trains:
    """Input 1 spikes in step 0, and neuron 1 in the next."""
    inputs, exc = (np.zeros((1, network.interval, 4), np.uint8) for _ in range(2))
    inputs[0, 0, 1] = exc[0, 1, 1] = 1
    return Trains(exc, inputs)


def test_one_spike_from_input_to_inhibition() -> None:
    network = eye()
    found = count_events(one_core(network), first_spike(network))
    # Step 0: the input's message; 1: its neuron spikes, which its counter keeps from then on; 2: the inhibitory neuron
    # spikes; 3: it takes from all four, which forget that in the step after.
    expected = {
        "messages_in": [1, 2, 1, 0, 0, 0],
        "operations_sparse": [1, 2, 4, 0, 0, 0],
        "operations_dense": [0, 0, 0, 0, 0, 0],
        "spikes": [0, 1, 1, 0, 0, 0],
        "read_outs": [0, 1, 0, 0, 0, 0],
        "updates": [0, 1, 2, 5, 5, 1],
    }
    for name, values in expected.items():
        assert getattr(found, name)[0, :6, 0].tolist() == values, name
    assert found.inh_spikes[0].tolist()[:4] == [0, 0, 1, 0]


def test_a_neuron_with_a_bias_is_updated_in_every_step() -> None:
    network = eye(bias=np.array([-64, 0, 5, 0], np.int32), inhibition=0)
    plan = one_core(network)
    found = count_events(plan, first_spike(network))
    assert found.updates[0, :5, 0].tolist() == [
        2,
        3,
        4,
        3,
        3,
    ]  # neuron 1 in step 1, the inhibitory one in step 2, the counter from then on
    assert (found.touched == found.updates).all()


def test_touched_is_updated_or_hit_by_nothing() -> None:
    # Weights 2 and 0 in dense rows: neuron 1 is hit without effect, neuron 0 cancelled by the inhibitory neuron.
    more = 0
    for seed in range(12):
        made = random_network(seed, size=(3, 6), bits=1, decay=4095, steps=30, bias_input=False, signed=False)
        plan = simple_plan(made, 2, seed)
        counted = count_events(plan, trains_of(made, 2, seed))
        assert (counted.touched >= counted.updates).all()
        more += int((counted.touched - counted.updates).sum())
    assert more > 0


def test_queries_are_counted_each_alone_and_what_is_mapped() -> None:
    plan = busy_plan(bias_input=True)
    trains = trains_of(plan.network, 4, 2)
    whole = count_events(plan, trains)
    assert (whole.queries, whole.steps, whole.injected) == (4, plan.network.interval, False)
    assert whole.accesses[0, 0].sum() == 20 + 20 + 1 + 30
    assert whole.input_accesses[3, 7].sum() == 30
    assert whole.tiles == len({(core.chip, core.core // 4) for core in plan.cores}) > 1
    for q in range(4):
        one = count_events(plan, Trains(trains.exc[[q]], trains.inputs[[q]]))
        for name in (*KINDS, "accesses", "input_accesses", "input_spikes", "exc_spikes", "inh_spikes"):
            assert np.array_equal(getattr(one, name), getattr(whole, name)[[q]]), name
    assert np.array_equal(
        whole.each("spikes"), whole.exc_spikes.sum(1) + whole.inh_spikes.sum(1) + whole.each("input_spikes")
    )


def test_injected_spikes_enter_where_they_are_said_to(monkeypatch: pytest.MonkeyPatch) -> None:
    for direct in (1024, 8):
        small_chips(monkeypatch, direct=direct)
        plan = busy_plan(bias_input=False)
        trains = trains_of(plan.network, 1, 0)
        own, far = count_events(plan, trains), count_events(plan, trains, entry=(3, 2))
        where = positions(plan)
        for counted, start in ((own, [(8 * core.chip, 0) for core in plan.cores]), (far, [(3, 2)] * len(plan.cores))):
            ways = abs(where - np.array(start))
            assert np.array_equal(counted.injected_hops_east_west, counted.injected_messages * ways[:, 0])
            assert np.array_equal(counted.injected_hops_north_south, counted.injected_messages * ways[:, 1])
        assert far.injected_hops_north_south.any()
        assert np.array_equal(own.hops_east_west, far.hops_east_west)
        assert (own.injected_messages.sum() == own.input_spikes.sum()) == plan.network.relayed
        assert (own.injected_messages == own.input_messages).all() != plan.network.relayed


def test_a_board_whose_mesh_is_not_public() -> None:
    made = replace(small_network(12, 20), steps=29, threshold=20)
    plan = partition(made, LOIHI_2, even(made))
    counted = count_events(plan, trains_of(made, 2, 0))
    assert counted.tiles is None
    assert not counted.hops_east_west.any()
    assert counted.exc_spikes.sum() > 5
    assert counted.each("messages_out").sum() == counted.exc_spikes.sum() + counted.inh_spikes.sum()


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
        Trains(trains.exc[:, 1:], trains.inputs[:, 1:]),
    ):
        with pytest.raises(ValueError, match="trains hold no input spikes, or are not those of the plan's network"):
            count_events(plan, bad)
