"""NeuroBench's metrics: counted literally, and beside the package itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.boards.small_boards import network
from support.common.small_models import encoded, small_model

from benchmarks.neurobench import metrics
from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.interface import Presentations
from lava_vpr.bench.measure.workload import input_updates, membrane_updates, of_trains, workload
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.encoding import query_rates
from lava_vpr.engine.inference.bias_input import LEVEL, bias_input_spikes, biases, start_membranes
from lava_vpr.engine.inference.fixed import FixedNetwork, count_spikes
from lava_vpr.engine.inference.membranes import membranes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.trains import Trains

INPUTS, NEURONS, STEPS, N = 30, 7, 25, 3


def small(bias_input: bool = False, seed: int = 0, inhibition: int = 44) -> tuple[FixedNetwork, np.ndarray, np.ndarray]:
    """A network whose neurons spike and inhibit each other, with rates and keys."""
    made = network(NEURONS, INPUTS, bias_input=bias_input, seed=seed, inhibition=inhibition)
    made = replace(made, steps=STEPS, threshold=20, shift=1, inhibition_exponent=0)
    rates = np.random.default_rng(seed).integers(0, 20000, (N, INPUTS)).astype(np.uint16)
    rates[:, ::4] = 0
    return made, rates, presentation_keys(seed, "query", np.arange(N))


def trains_of(made: FixedNetwork, rates: np.ndarray, keys: np.ndarray) -> Trains:
    """Every spike."""
    trains = metrics.trains_of(made, rates, keys)
    if not made.bias_input:
        return trains
    inputs = np.zeros((N, STEPS + 3, INPUTS), np.uint8)
    for k in range(N):
        inputs[k, :STEPS] = bias_input_spikes(rates[k], int(keys[k]), STEPS)
    return replace(trains, inputs=inputs)


@pytest.mark.parametrize("bias_input", [False, True])
@pytest.mark.parametrize("inhibition", [44, 0])
def test_metrics_are_what_literal_loops_count(bias_input: bool, inhibition: int) -> None:
    made, rates, keys = small(bias_input, inhibition=inhibition)
    trains = trains_of(made, rates, keys)
    found = of_trains(made, trains, rates, keys)
    excite = made.weights.astype(int)
    relay = np.full(NEURONS, 2)
    inhibit = inhibition * (1 - np.eye(NEURONS, dtype=int))
    every = [*excite.ravel(), *relay, *inhibit.ravel()]
    operations = 0
    assert trains.inputs is not None
    assert trains.inh is not None
    for q in range(N):
        for t in range(STEPS + 3):
            for j in np.flatnonzero(trains.inputs[q, t]):
                operations += sum(1 for w in excite[j] if w != 0)
            operations += int(trains.exc[q, t].sum())
            for i in np.flatnonzero(trains.inh[q, t]):
                operations += sum(1 for w in inhibit[i] if w != 0)
    neurons = 2 * NEURONS + (INPUTS if bias_input else 0)
    spikes = int(trains.exc.sum()) + int(trains.inh.sum()) + (int(trains.inputs.sum()) if bias_input else 0)
    assert trains.exc.sum() > 10
    assert found.parameters == len(every)
    assert found.footprint_bytes == len(every) + 4 * neurons
    assert found.connection_sparsity == pytest.approx(sum(w == 0 for w in every) / len(every))
    assert found.activation_sparsity == pytest.approx(1 - spikes / (neurons * (STEPS + 3) * N))
    assert found.dense_operations == len(every) * (STEPS + 3)
    assert found.effective_macs == 0
    assert found.effective_acs == pytest.approx(operations / N)


def test_effective_operations_are_those_that_the_engine_counts() -> None:
    made, rates, keys = small()
    _, events, _ = count_spikes(made, rates, keys)
    trains = trains_of(made, rates, keys)
    late = int(trains.exc[:, -1].sum())  # their relays would fire after the end, which the engine counts in advance
    wanted = events["synaptic_operations"] - late * (NEURONS - 1)
    assert of_trains(made, trains, rates, keys).effective_acs == pytest.approx(wanted / N)


@pytest.mark.parametrize("seed", range(4))
def test_membranes_are_those_that_spike(seed: int) -> None:
    """Recomputed from input and relays alone, neurons spike where the engine has a spike, and are 0 then."""
    made, rates, keys = small(seed=seed)
    trains = trains_of(made, rates, keys)
    assert trains.inputs is not None
    assert trains.inh is not None
    for q in range(N):
        after, fired = membranes(made, trains.inputs[q], trains.inh[q])
        assert np.array_equal(fired, trains.exc[q])
        assert not after[fired != 0].any()
        assert (after <= made.threshold << 6).all()
        assert after.any()
        assert not after[0].any()
    assert trains.exc.any()


def truncated(value: int, keep: int) -> int:
    """``value keep / 4096``, towards zero."""
    return abs(value) * keep // 4096 * (1 if value > 0 else -1)


def test_membrane_updates_are_those_of_neurons_stepped_one_by_one() -> None:
    """Both populations as two loops of compartments; the relay's membrane comes and goes within a step."""
    made, rates, keys = small()
    trains = trains_of(made, rates, keys)
    assert trains.inputs is not None
    assert trains.inh is not None
    weights, changed = made.weights.astype(int), 0
    for q in range(N):
        exc, inh, drive, relayed = [0] * NEURONS, [0] * NEURONS, [0] * NEURONS, [0] * NEURONS
        for step in range(STEPS + 3):
            fired, hit = [], []
            for i in range(NEURONS):
                before = exc[i], inh[i]
                exc[i] = truncated(exc[i], 4096 - made.decay) + (drive[i] << 6)
                inh[i] += relayed[i] << 6
                fired.append(exc[i] > made.threshold << 6)
                hit.append(inh[i] > 1 << 6)
                exc[i] = 0 if fired[i] else exc[i]
                inh[i] = 0 if hit[i] else inh[i]
                changed += 2 if step == 0 else (exc[i] != before[0]) + (inh[i] != before[1])
            assert [bool(x) for x in trains.exc[q, step]] == fired
            sums = trains.inputs[q, step].astype(int) @ weights >> made.shift
            drive = [int(sums[i]) - made.lateral * (sum(hit) - hit[i]) for i in range(NEURONS)]
            relayed = [2 * spike for spike in fired]
    assert membrane_updates(made, trains.inputs, trains.inh) == changed


def test_a_missing_relay_would_be_seen() -> None:
    made, rates, keys = small()
    trains = trains_of(made, rates, keys)
    assert trains.inputs is not None
    assert trains.inh is not None
    found = [membrane_updates(made, trains.inputs, inh) for inh in (trains.inh, np.zeros_like(trains.inh))]
    assert found[0] != found[1]


def test_updates_of_inputs_that_integrate() -> None:
    _, rates, keys = small(1)
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
    model = replace(model, network=replace(model.network, bias_input=mode))  # type: ignore[type-var]
    rates = query_rates(queries.activity, model.config)[:5]
    shown = Presentations(rates, 3)
    trains = HostBackend(1).trains(model, shown)
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
