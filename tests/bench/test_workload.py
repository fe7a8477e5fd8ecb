"""NeuroBench's metrics: counted literally, and beside the package itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.boards.plans import network
from support.common.small_models import encoded, small_model

from benchmarks.neurobench import metrics
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.bench.measure.workload import input_updates, membrane_updates, of_trains, workload
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.biases import LEVEL, biases, start_membranes
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.membranes import membranes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import query_rates

INPUTS, NEURONS, STEPS, N = 30, 7, 25, 3
KINDS = ("injected", "bias", "deep")
"""Inputs injected directly or on the chip; injected through relays, with leaves, which small limits bring about."""


@pytest.fixture
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """One of `KINDS`."""
    if request.param == "deep":
        monkeypatch.setattr(fixed, "FAN_IN", 3)
        monkeypatch.setattr(fixed, "DIRECT", 5)
    return str(request.param)


every_kind = pytest.mark.parametrize("kind", KINDS, indirect=True)


def small(
    kind: str = "injected", seed: int = 0, inhibition: int = 44, signed: bool = True
) -> tuple[FixedNetwork, np.ndarray, np.ndarray]:
    """A network whose neurons spike and inhibit each other, with rates and keys."""
    made = network(NEURONS, INPUTS, bias_input=kind == "bias", seed=seed, inhibition=inhibition)
    made = replace(made, steps=STEPS, threshold=9, signed=signed)
    if signed:
        weights = made.weights * np.where(np.arange(INPUTS) % 5 == 1, -1, 1)[:, None]
        bias = np.array([-3, 0, 2, -40, 0, 5, 11], np.int32)
        made = replace(made, weights=weights.astype(np.int16), bias=bias)
    rates = np.random.default_rng(seed).integers(0, 20000, (N, INPUTS)).astype(np.uint16)
    rates[:, ::4] = 0
    return made, rates, presentation_keys(seed, "query", np.arange(N, dtype=np.uint64))


trains_of = metrics.trains_of


@every_kind
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("inhibition", [44, 0])
def test_metrics_are_what_literal_loops_count(kind: str, signed: bool, inhibition: int) -> None:
    made, rates, keys = small(kind, inhibition=inhibition, signed=signed)
    trains = trains_of(made, rates, keys)
    found = of_trains(made, trains, rates, keys)
    leaves, relays = (3, INPUTS) if kind == "deep" else (0, 0)
    layers = {
        "inputs": made.weights.astype(int),
        "listened": np.full((NEURONS, 1), 2),
        "leaves": np.full((leaves, 1), 2),
        "root": np.full((1, NEURONS), inhibition),
        "relays": np.full((relays, 1), 2),
    }
    every = [int(weight) for layer in layers.values() for weight in layer.ravel()]
    operations = 0
    assert trains.inh.shape[2] == leaves + 1
    spiking = {"inputs": trains.inputs, "listened": trains.exc, "leaves": trains.inh[..., :-1]}
    spiking |= {"root": trains.inh[..., -1:], "relays": trains.inputs[..., :relays]}
    for name, spikes in spiking.items():
        for _, _, source in zip(*np.nonzero(spikes), strict=True):
            operations += sum(1 for weight in layers[name][source] if weight != 0)
    on_chip = INPUTS if kind != "injected" else 0
    neurons = NEURONS + leaves + 1 + on_chip
    spikes = int(trains.exc.sum()) + int(trains.inh.sum()) + (int(trains.inputs.sum()) if on_chip else 0)
    biases_held = NEURONS if signed else 0
    assert trains.exc.sum() > 10
    assert found.parameters == len(every) + biases_held
    assert found.footprint_bytes == len(every) + 4 * (neurons + biases_held)
    assert found.connection_sparsity == pytest.approx(sum(w == 0 for w in every) / len(every))
    assert found.activation_sparsity == pytest.approx(1 - spikes / (neurons * made.interval * N))
    assert found.dense_operations == len(every) * made.interval
    assert found.effective_macs == 0
    assert found.effective_acs == pytest.approx(operations / N)


@every_kind
def test_effective_operations_are_those_that_the_engine_counts(kind: str) -> None:
    made, rates, keys = small(kind)
    _, events, _ = count_spikes(made, rates, keys)
    found = of_trains(made, trains_of(made, rates, keys), rates, keys)
    assert found.effective_acs == pytest.approx(events["synaptic_operations"] / N)


@pytest.mark.parametrize("seed", range(4))
def test_membranes_are_those_that_spike(seed: int) -> None:
    """Recomputed from input and inhibition alone, neurons spike where the engine has a spike, and are 0 then."""
    made, rates, keys = small(seed=seed)
    trains = trains_of(made, rates, keys)
    for q in range(N):
        after, fired = membranes(made, trains.inputs[q], trains.inh[q])
        assert np.array_equal(fired, trains.exc[q])
        assert not after[fired != 0].any()
        assert (after <= made.threshold << 6).all()
        assert after.any()
        assert np.array_equal(after[0], made.bias)
    assert trains.exc.any()


def truncated(value: int, keep: int) -> int:
    """``value keep / 4096``, towards zero."""
    return abs(value) * keep // 4096 * (1 if value > 0 else -1)


@pytest.mark.parametrize("kind", ["injected", "deep"], indirect=True)
def test_membrane_updates_are_those_of_neurons_stepped_one_by_one(kind: str) -> None:
    """Every population as a loop of compartments; what has no memory comes and goes within a step."""
    made, rates, keys = small(kind)
    trains = trains_of(made, rates, keys)
    weights, leaves, relays, changed = made.weights.astype(int), made.leaves, made.relayed, 0
    for q in range(N):
        exc, others = [0] * NEURONS, [0] * (leaves + 1 + relays * INPUTS)
        drive, arrived = [0] * NEURONS, [0] * len(others)
        for step in range(made.interval):
            fired, hit = [], []
            for i in range(NEURONS):
                before = exc[i]
                exc[i] = truncated(exc[i], 4096 - made.decay) + (drive[i] << 6) + int(made.bias[i])
                fired.append(exc[i] > made.threshold << 6)
                exc[i] = 0 if fired[i] else exc[i]
                changed += 1 if step == 0 else exc[i] != before
            for i in range(len(others)):
                before = others[i]
                others[i] += arrived[i] << 6
                hit.append(others[i] > 1 << 6)
                others[i] = 0 if hit[i] else others[i]
                changed += 1 if step == 0 else others[i] != before
            assert [bool(x) for x in trains.exc[q, step]] == fired
            assert [bool(x) for x in trains.inh[q, step]] == hit[: leaves + 1]
            reaching = np.array(hit[leaves + 1 :], int) if relays else trains.inputs[q, step].astype(int)
            drive = [int(own) - made.lateral * hit[leaves] for own in reaching @ weights]
            arrived = [2 * sum(fired[3 * leaf : 3 * leaf + 3]) for leaf in range(leaves)]
            arrived += [2 * (sum(hit[:leaves]) if leaves else sum(fired))]
            arrived += [2 * int(spike) for spike in trains.inputs[q, step]] if relays else []
    assert membrane_updates(made, trains.inputs, trains.inh) == changed


def test_a_missing_inhibition_would_be_seen() -> None:
    made, rates, keys = small()
    trains = trains_of(made, rates, keys)
    found = [membrane_updates(made, trains.inputs, inh) for inh in (trains.inh, np.zeros_like(trains.inh))]
    assert found[0] != found[1]


def test_updates_of_inputs_that_integrate() -> None:
    _, rates, keys = small()
    own, key = rates[0], int(keys[0])
    mantissa, exponent = biases(own)
    changed = INPUTS
    for j in range(INPUTS):
        bias, v = int(mantissa[j]) << int(exponent[j]), int(start_membranes(key, INPUTS)[j])
        for step in range(STEPS):
            after = v + bias if v + bias <= LEVEL else 0
            changed += int(after != v) if step else 0
            v = after
    assert input_updates(own, key, STEPS) == changed > INPUTS


@pytest.mark.parametrize("mode", [False, True])
def test_a_model_is_counted_on_its_own_queries(mode: bool) -> None:
    model, queries = small_model(), encoded(noise=0.4)
    changed = replace(model.network, bias_input=mode, regular=True)  # type: ignore[type-var]
    model = replace(model, network=changed)
    rates = query_rates(queries.activity, model.config)[:5]
    shown = Presentations(rates, 3)
    trains = HostBackend().trains(model, shown)
    wanted = of_trains(model.network, trains, rates, shown.keys)  # type: ignore[arg-type]
    asked = QuerySet.of(model, queries, seed=3)
    assert workload(asked, limit=5) == workload(asked, asked.trains(slice(None)), limit=5) == wanted
    assert wanted.activation_sparsity < 1


def test_comparison_notices_a_difference() -> None:
    pairs = {name: (5.0, 5.0) for name in metrics.THEIRS}
    assert metrics.equal(pairs)
    assert not metrics.equal(pairs | {"effective_acs": (5.0, 5.01)})
    assert not metrics.equal(pairs | {"connection_sparsity": (0.5, 0.5002)})
    assert not metrics.equal({"effective_acs": (5.0, 5.0)})


@pytest.mark.slow
@pytest.mark.skipif(not metrics.PYTHON.exists(), reason="there is no neurobench; run make neurobench")
@pytest.mark.parametrize("seed", range(2))
def test_metrics_equal_those_of_the_package(seed: int) -> None:
    made, rates, keys = small(seed=seed)
    pairs = metrics.compare(made, rates, keys)
    assert metrics.equal(pairs), pairs
