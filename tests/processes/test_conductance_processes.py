"""The conductance network as Lava Processes: every spike, weight and threshold equal to the host engine's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.lava.model_harness import build, drive

from lava_vpr.config import Config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.engine.conductance.kernels import Constants
from lava_vpr.engine.conductance.model import (
    ConductanceState,
    constants,
    count_spikes,
    initial_state,
    train_presentation,
)
from lava_vpr.engine.random import presentation_key, presentation_keys
from lava_vpr.errors import ConfigError, LavaVprError, NetworkLimitError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.processes.conductance.conductance_place_network.process import (
    ConductanceLIF,
    ConductancePlaceNetwork,
    PyConductanceLIFFloat,
    excitatory_neuron,
    inhibitory_neuron,
)
from lava_vpr.processes.conductance.delayed_synapses.process import (
    ConductancePlastic,
    DelayedDense,
    PyDelayedDenseFloat,
)
from lava_vpr.processes.conductance.neurons import ConductanceNeuron
from lava_vpr.processes.encoders.process import FinePoissonEncoder

pytestmark = pytest.mark.lava

INPUTS, NEURONS = 14, 6
JOB = "lava_vpr.processes.jobs.conductance:conductance"
EVENTS = ("synaptic_operations", "input_spikes", "exc_spikes", "inh_spikes")


def small(rule: str = "triplet", **network: float) -> Config:
    """A network of few neurons and steps that spikes a lot, and whose weights, clipping and theta all matter."""
    paper = preset("paper")
    values = {"neurons": NEURONS, "steps": 160, "rest_steps": 25, "delay_max_ms": 4.0, "timer_rate": 1.0} | network
    learning = replace(
        paper.learning, rule=rule, eta_pre=0.02, eta_post=0.4, weight_sum=6.0, theta_start_mv=12.0, tau_theta_ms=1e3
    )
    return replace(paper, network=replace(paper.network, **values), learning=learning)


def some_rates(n: int, inputs: int = INPUTS, high: float = 0.3) -> NDArray[np.uint32]:
    """Spike probabilities, a few of them 0, uint32 (n, inputs)."""
    values = np.random.default_rng(n).uniform(-0.15 * high, high, (n, inputs))
    return (np.maximum(values, 0) * 2**32).astype(np.uint32)


def through_lava(
    state: ConductanceState,
    rates: NDArray[np.uint32],
    keys: NDArray[np.uint64],
    config: Config,
    timeout: float = 120,
    **options: bool,
) -> dict[str, NDArray[Any]]:
    """What the network of Processes makes of it, in a child process."""
    arrays = {"weights": state.weights, "theta_mv": state.theta_mv, "delays": state.delays}
    given_arrays = arrays | {"rates": rates, "keys": keys}
    return run_isolated(JOB, given_arrays, {"config": to_dict(config), "raster": True} | options, timeout=timeout)


def host_raster(
    state: ConductanceState, rates: NDArray[np.uint32], keys: NDArray[np.uint64], config: Config
) -> NDArray[np.int32]:
    """Spikes of the steps with input by the host engine, from presentations of every length up to the full one."""
    totals = [np.zeros((len(rates), state.weights.shape[1]), np.int32)]
    for steps in range(1, config.network.steps + 1):
        shorter = replace(config, network=replace(config.network, steps=steps))
        totals.append(count_spikes(state, rates, keys, shorter)[0])
    return np.diff(totals, axis=0).transpose(1, 0, 2)


@pytest.mark.slow
def test_every_spike_of_the_frozen_network_equals_the_host_engine() -> None:
    config = small()
    state = initial_state(config, INPUTS)
    # Two neurons alike spike together, and so do their inhibitory ones; the rest is shorter than the delays.
    for array in (state.weights, state.delays):
        array[:, 1] = array[:, 0]
    state.theta_mv[:] = [11.0, 11.0, 12.0, 12.5, 13.0, 14.0]
    rates, keys = some_rates(3), presentation_keys(3, "query", np.arange(3))
    got = through_lava(state, rates, keys, config)
    counts, events = count_spikes(state, rates, keys, config)
    np.testing.assert_array_equal(got["counts"], counts)
    np.testing.assert_array_equal(got["events"], [events[name] for name in EVENTS])
    np.testing.assert_array_equal(got["raster"][:, : config.network.steps], host_raster(state, rates, keys, config))
    assert got["counts"].dtype == np.int32
    assert (counts.sum(axis=1) > 2).all(), "every presentation must spike to test anything"
    assert (counts.sum(axis=0) > 0).sum() > 2
    assert got["raster_inh"].sum(axis=2).max() > 1
    assert got["raster"].shape == got["raster_inh"].shape == (3, 185, NEURONS)


@pytest.mark.parametrize("rule", ["paper", pytest.param("triplet", marks=pytest.mark.slow)])
def test_every_weight_and_threshold_of_the_learning_network_equals_the_host_engine(rule: str) -> None:
    config = small(rule, rest_steps=10)
    state = initial_state(config, INPUTS)
    rates = some_rates(3)
    keys = np.array([presentation_key(3, "train", 0, epoch) for epoch in range(3)], np.uint64)
    got = through_lava(state, rates, keys, config, learn=True)
    before = state.weights.copy()
    counts = [train_presentation(state, own, int(key), config)[0] for own, key in zip(rates, keys, strict=True)]
    np.testing.assert_array_equal(got["counts"], counts)
    np.testing.assert_array_equal(got["weights"], state.weights)
    np.testing.assert_array_equal(got["theta_mv"], state.theta_mv)
    assert np.sum(counts) > 10
    assert not np.array_equal(before, state.weights)


@pytest.mark.slow
def test_a_presentation_at_full_size_equals_the_host_engine() -> None:
    config = preset("paper")
    state = initial_state(config, 784)
    state.weights *= config.learning.weight_sum / state.weights.sum(axis=0)
    rates, keys = some_rates(1, 784, high=60e-4), presentation_keys(0, "query", np.arange(1))
    got = through_lava(state, rates, keys, config, timeout=300)
    counts, events = count_spikes(state, rates, keys, config)
    np.testing.assert_array_equal(got["counts"], counts)
    np.testing.assert_array_equal(got["events"], [events[name] for name in EVENTS])
    assert counts.sum() > 10


def alone(
    neuron: ConductanceNeuron, excited: list[float], inhibited: list[int], gi: NDArray[np.float64] | None = None
) -> tuple[PyConductanceLIFFloat, NDArray[np.bool_]]:
    """Neurons without Lava, one for each of ``gi`` (default: one at rest), after what arrives in each step; spikes."""
    conductance = np.zeros(1) if gi is None else gi
    model = build(ConductanceLIF(shape=conductance.shape, neuron=neuron, theta=THETA), PyConductanceLIFFloat)
    model.gi[:] = conductance
    fired = np.zeros((len(excited), *conductance.shape), bool)
    for step, (more, spikes) in enumerate(zip(excited, inhibited, strict=True)):
        model.time_step = step + 1
        model.g_e_in.waiting, model.g_i_in.waiting = np.full_like(conductance, more), np.full_like(conductance, -spikes)
        model.run_spk()
        fired[step] = model.s_out.sent
    return model, fired


THETA = 9.0
NEURON = excitatory_neuron(constants(small(), learn=True))


@settings(deadline=None, max_examples=15, derandomize=True)
@given(seed=st.integers(0, 2**32), strength=st.sampled_from([0.5, 3.0]), others=st.sampled_from([0.0, 0.02, 0.2]))
def test_a_neuron_equals_its_equations_one_event_after_another(seed: int, strength: float, others: float) -> None:
    rng = np.random.default_rng(seed)
    excited = list(rng.uniform(0.0, strength, 120))
    inhibited = list(rng.integers(2, 6, 120) * (rng.random(120) < others))
    neuron = replace(NEURON, freeze=4, refractory=9)
    model, fired = alone(neuron, excited, inhibited)
    v, ge, gi, theta, since, spikes = -65.0, 0.0, 0.0, THETA, 1 << 40, []
    for step in range(120):
        ge += excited[step]
        for _ in range(inhibited[step]):
            gi += 17.0
        since += 1
        if since >= 4:
            v += (0.1 / 100.0) * ((-65.0 - v) + ge * (0.0 - v) + gi * (-100.0 - v))
        ge -= (0.1 / 1.0) * ge
        gi -= (0.1 / 2.0) * gi
        theta -= (0.1 / 1e3) * theta
        if v > (theta - 20.0) + -52.0 and since >= 9:
            v, since = -65.0, 0
            theta += 0.05
            spikes.append(step)
    assert np.flatnonzero(fired).tolist() == spikes
    assert (model.v[0], model.ge[0], model.gi[0], model.theta[0]) == (v, ge, gi, theta)
    assert others > 0.0 or len(spikes) > 2


def test_spikes_that_inhibit_together_are_added_one_by_one() -> None:
    gi = np.random.default_rng(0).uniform(0.0, 17.0, 400)
    one_by_one, grouped = (gi + 17.0) + 17.0, gi + 34.0
    assert (one_by_one != grouped).any(), "otherwise this tests nothing"
    model, _ = alone(replace(NEURON, gi_decay=0.0), [0.0], [2], gi)
    np.testing.assert_array_equal(model.gi, one_by_one)


def test_a_neuron_holds_after_a_spike_and_its_theta_grows() -> None:
    neuron = replace(NEURON, freeze=4, refractory=9, theta_decay=0.0)
    model, fired = alone(neuron, [50.0] * 40, [0] * 40)
    assert fired.sum() > 2
    assert (np.diff(np.flatnonzero(fired)) == 9).all()
    assert model.theta[0] == pytest.approx(THETA + 0.05 * fired.sum())


def test_inhibition_keeps_a_neuron_silent() -> None:
    free, held = (alone(NEURON, [2.0] * 60, [k] * 60)[1] for k in (0, 1))
    assert free.any()
    assert not held.any()


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.integers(0, 2**32), st.integers(0, 9), st.integers(5, 30))
def test_delays_are_those_of_a_literal_version(seed: int, longest: int, interval: int) -> None:
    rng = np.random.default_rng(seed)
    weights, delays = rng.random((3, 4)), rng.integers(0, longest + 1, (3, 4))
    spikes = rng.random((2 * interval, 4)) < 0.4
    model = build(DelayedDense(weights=weights, delays=delays, interval=interval), PyDelayedDenseFloat)
    want = np.zeros((2 * interval + longest + 2, 3))
    for step, source in np.argwhere(spikes):
        for i in range(3):
            arrival = step + delays[i, source] + 1
            if arrival < (step // interval + 1) * interval:  # what is on its way when a presentation begins is lost
                want[arrival, i] += weights[i, source]
    np.testing.assert_array_equal(drive(model, spikes, "s_in", "a_out"), want[: 2 * interval])


def constants_of(total: int) -> Constants:
    return constants(small(), learn=True)._replace(total=total)


WEIGHTS, DELAYS = np.full((NEURONS, INPUTS), 0.3), np.ones((NEURONS, INPUTS), np.uint16)
RATES, KEYS = np.ones((2, INPUTS), np.uint32), np.zeros(2, np.uint64)


def holed() -> NDArray[np.float64]:
    weights = WEIGHTS.copy()
    weights[2, 3] = np.nan
    return weights


def fine(**changed: Any) -> FinePoissonEncoder:
    return FinePoissonEncoder(**{"rates": RATES, "keys": KEYS, "steps": 5, "silent_steps": 0} | changed)


def network(config: Config, **changed: Any) -> ConductancePlaceNetwork:
    state = {"weights": WEIGHTS.T, "theta_mv": np.full(NEURONS, 20.0), "delays": DELAYS.T} | changed
    return ConductancePlaceNetwork(state=ConductanceState(**state), config=config)


REFUSED = [
    (lambda: DelayedDense(weights=WEIGHTS, delays=DELAYS[:, 1:]), NetworkLimitError, "of one shape, (neurons, inputs)"),
    (lambda: DelayedDense(weights=holed(), delays=DELAYS), NetworkLimitError, "a weight is not finite"),
    (lambda: DelayedDense(weights=WEIGHTS, delays=DELAYS * 0.5), NetworkLimitError, "float64 must be whole steps"),
    (
        lambda: DelayedDense(weights=WEIGHTS, delays=DELAYS.astype(np.int64) - 2),
        NetworkLimitError,
        "delays of -1..-1 steps",
    ),
    (lambda: DelayedDense(weights=WEIGHTS, delays=DELAYS * 65535), NetworkLimitError, "in 0..65534"),
    (lambda: DelayedDense(weights=WEIGHTS, delays=DELAYS, interval=-1), NetworkLimitError, "interval is -1"),
    (
        lambda: ConductancePlastic(
            weights=WEIGHTS, delays=DELAYS, learning=small().learning, constants=constants_of(0), dt_ms=0.1
        ),
        NetworkLimitError,
        "a presentation of 0 steps",
    ),
    (
        lambda: fine(rates=RATES.astype(np.uint16)),
        NetworkLimitError,
        "rates are uint16 (2, 14), but must be uint32",
    ),
    (lambda: fine(keys=KEYS[:1]), NetworkLimitError, "must be uint64 (2,)"),
    (lambda: fine(steps=0), NetworkLimitError, "0 steps and 0 silent"),
    (lambda: replace(NEURON, leak=1.0), NetworkLimitError, "leak is 1.0, but Euler's method needs [0, 1)"),
    (lambda: replace(NEURON, gi_decay=-0.1), NetworkLimitError, "gi_decay is -0.1"),
    (lambda: replace(NEURON, threshold=float("nan")), NetworkLimitError, "threshold is nan, but must be finite"),
    (lambda: replace(NEURON, freeze=-1), NetworkLimitError, "freeze is -1, but must be at least 0"),
    (
        lambda: ConductanceLIF(shape=(NEURONS,), neuron=NEURON, theta=np.zeros(3)),
        NetworkLimitError,
        "theta of shape (3,) must be finite, one value or of shape (6,)",
    ),
    (lambda: ConductanceLIF(shape=(2,), neuron=NEURON, interval=-1), NetworkLimitError, "interval is -1"),
    (lambda: network(preset("loihi")), ConfigError, "use the preset paper"),
    (lambda: network(small(), theta_mv=np.zeros(3)), NetworkLimitError, "theta (3,) must be finite, for 6 neurons"),
    (lambda: network(small(), weights=WEIGHTS), NetworkLimitError, "of one shape"),
]


@pytest.mark.parametrize(("make", "error", "text"), REFUSED)
def test_what_is_out_of_range_is_refused(make: Any, error: type[LavaVprError], text: str) -> None:
    with pytest.raises(error) as caught:
        make()
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_refusal_inside_the_job_reaches_the_caller() -> None:
    config = small()
    state = replace(initial_state(config, INPUTS), theta_mv=np.zeros(NEURONS - 1))
    with pytest.raises(LavaVprError, match="theta"):
        through_lava(state, some_rates(1), np.zeros(1, np.uint64), config)


def test_inhibitory_neurons_feel_no_theta() -> None:
    neuron = inhibitory_neuron(constants(small(), learn=True))
    assert (neuron.theta_plus, neuron.theta_decay, neuron.offset, neuron.g_inh) == (0.0, 0.0, 0.0, 0.0)
