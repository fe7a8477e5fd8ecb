"""The compiled conductance network against a literal, step-by-step version; determinism, events and errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.literal.floats import Slow, slow_presentation

from lava_vpr.config import Config, preset
from lava_vpr.engine.conductance import run as conductance_run
from lava_vpr.engine.conductance.kernels import ConductanceDrive, input_drive
from lava_vpr.engine.conductance.model import (
    ConductanceState,
    constants,
    count_spikes,
    initial_state,
    train_presentation,
)
from lava_vpr.engine.random import presentation_key, presentation_keys, uniform
from lava_vpr.engine.rates import draw_spikes
from lava_vpr.errors import ConfigError, InputError

INPUTS, NEURONS = 14, 6


def small(rule: str = "triplet", **network: float) -> Config:
    """A network of few neurons and steps that spikes a lot."""
    paper = preset("paper")
    settings = {"neurons": NEURONS, "steps": 260, "rest_steps": 150, "delay_max_ms": 2.0, "timer_rate": 1.0} | network
    # Large rates of learning, and thresholds near the reset, so that weights, clipping and theta all matter.
    learning = replace(
        paper.learning, rule=rule, eta_pre=0.02, eta_post=0.4, weight_sum=6.0, theta_start_mv=12.0, tau_theta_ms=1e3
    )
    return replace(paper, network=replace(paper.network, **settings), learning=learning)


def some_rates(n: int, seed: int = 0, high: float = 0.25) -> NDArray[np.uint32]:
    """Spike probabilities up to ``high``, a few of them 0, uint32 (n, INPUTS)."""
    values = np.random.default_rng(seed).uniform(-0.05, high, (n, INPUTS))
    return (np.maximum(values, 0) * 2**32).astype(np.uint32)


def events_of(slow: Slow, config: Config) -> dict[str, int]:
    """The events that the literal version counted, by name."""
    total = config.network.steps + config.network.rest_steps
    return {
        "synaptic_operations": slow.operations,
        "neuron_updates": 2 * NEURONS * total,
        "input_spikes": slow.inputs,
        "exc_spikes": slow.exc,
        "inh_spikes": slow.inh,
        "messages": slow.inputs + slow.exc + slow.inh,
        "steps": total,
    }


def copy(state: ConductanceState) -> ConductanceState:
    return ConductanceState(state.weights.copy(), state.theta_mv.copy(), state.delays.copy())


CASES = {
    "as set": {},
    "no rest, long delays: spikes in flight at the end": {"rest_steps": 0, "delay_max_ms": 4.0},
    "rest shorter than the delays": {"rest_steps": 10, "delay_max_ms": 4.0},
    "no delays": {"delay_max_ms": 0.0},
    "odd number of steps": {"steps": 261},
    "two chunks of input sums": {"steps": 300, "rest_steps": 300},
    "the later release's inhibition, slower timer": {"tau_gi_ms": 0.5, "timer_rate": 0.4},
}


@pytest.mark.parametrize("rule", ["triplet", "paper"])
@pytest.mark.parametrize("case", CASES)
def test_training_equals_the_literal_version_bit_for_bit(rule: str, case: str) -> None:
    config = small(rule, **CASES[case])
    state = initial_state(config, INPUTS)
    fired = 0
    for epoch, rates in enumerate(some_rates(2)):
        key = presentation_key(3, "train", 0, epoch)
        slow = slow_presentation(copy(state), rates, key, config, learn=True)
        before = state.weights.copy()
        counts, events = train_presentation(state, rates, key, config)
        np.testing.assert_array_equal(counts, slow.counts)
        np.testing.assert_array_equal(state.weights, slow.weights)
        np.testing.assert_array_equal(state.theta_mv, slow.theta)
        assert events == events_of(slow, config)
        assert not np.array_equal(before, state.weights)
        fired += slow.exc
    assert fired > 5, "the case must spike to test anything"


@pytest.mark.parametrize("case", CASES)
def test_frozen_responses_equal_the_literal_version(case: str) -> None:
    config = small(**CASES[case])
    state = initial_state(config, INPUTS)
    rates, keys = some_rates(2, seed=1), presentation_keys(3, "query", np.arange(2))
    slow = [slow_presentation(state, r, int(k), config, learn=False) for r, k in zip(rates, keys, strict=True)]
    before = copy(state)
    counts, events = count_spikes(state, rates, keys, config)
    np.testing.assert_array_equal(counts, [s.counts for s in slow])
    each = [events_of(s, config) for s in slow]
    assert events == {name: sum(e[name] for e in each) for name in events}
    assert events["inh_spikes"] > 0
    np.testing.assert_array_equal(state.weights, before.weights)
    np.testing.assert_array_equal(state.theta_mv, before.theta_mv)


@settings(deadline=None, max_examples=12, derandomize=True)
@given(
    seed=st.integers(0, 2**32),
    rule=st.sampled_from(["triplet", "paper"]),
    high=st.sampled_from([0.02, 0.3, 1.0]),
    theta=st.floats(8.0, 30.0),
    weight_sum=st.floats(1.0, 40.0),
)
def test_training_equals_the_literal_version_anywhere(
    seed: int, rule: str, high: float, theta: float, weight_sum: float
) -> None:
    config = small(rule, steps=120, rest_steps=60)
    # A large sum drives weights beyond w_max, which an arriving spike of the triplet rule clips.
    config = replace(config, learning=replace(config.learning, weight_sum=weight_sum))
    state = initial_state(config, INPUTS)
    state.theta_mv[:] = theta
    rates = some_rates(1, seed, high)[0]
    slow = slow_presentation(copy(state), rates, seed, config, learn=True)
    counts, events = train_presentation(state, rates, seed, config)
    np.testing.assert_array_equal(counts, slow.counts)
    np.testing.assert_array_equal(state.weights, slow.weights)
    np.testing.assert_array_equal(state.theta_mv, slow.theta)
    assert events == events_of(slow, config)


def test_more_plastic_neurons_than_slots() -> None:
    """The slots of plastic neurons grow; the arrivals of those already there move along."""
    config = small(neurons=40, steps=200, rest_steps=20)
    state = initial_state(config, INPUTS)
    state.weights[:], state.delays[:] = state.weights[:, :1], state.delays[:, :1]
    state.theta_mv[1:] = 12.5  # the first neuron, at 12, fires before the other 39 do, which fire together
    rates = some_rates(1, 5, 0.5)[0]
    slow = slow_presentation(copy(state), rates, 9, config, learn=True)
    counts, _ = train_presentation(state, rates, 9, config)
    assert np.count_nonzero(slow.counts) > conductance_run._PLASTIC_SLOTS
    np.testing.assert_array_equal(counts, slow.counts)
    np.testing.assert_array_equal(state.weights, slow.weights)


@pytest.mark.parametrize(("longest", "span"), [(0, 16), (5, 16), (40, 16)])
def test_input_sums_carry_over_from_chunk_to_chunk(longest: int, span: int) -> None:
    """Also where a delay is longer than a chunk, which the default sizes never reach."""
    rng = np.random.default_rng(4)
    n, steps = 11, 50
    weights, delays = rng.random((n, INPUTS)), rng.integers(0, longest + 1, (n, INPUTS)).astype(np.uint16)
    when, sources = (each.astype(np.int32) for each in np.nonzero(draw_spikes(some_rates(1)[0], 5, steps)))
    chunks = [np.empty((span, n)) for _ in range(6)]
    carry = np.zeros((n, longest))
    for k, chunk in enumerate(chunks):
        input_drive(ConductanceDrive(weights, delays, when, sources), k * span, carry, chunk)
    expected = np.zeros((6 * span, n))
    for t, j in zip(when, sources, strict=True):
        for i in range(n):
            expected[t + delays[i, j], i] += weights[i, j]
    np.testing.assert_array_equal(np.concatenate(chunks), expected)


def test_training_is_deterministic_and_does_not_depend_on_memory_order() -> None:
    config = small()
    results = []
    for order in ("C", "F"):
        state = initial_state(config, INPUTS)
        state.weights = np.array(state.weights, order=order)
        for epoch, rates in enumerate(some_rates(3)):
            train_presentation(state, rates, presentation_key(0, "train", 0, epoch), config)
        results.append(state)
    np.testing.assert_array_equal(results[0].weights, results[1].weights)
    np.testing.assert_array_equal(results[0].theta_mv, results[1].theta_mv)


def test_read_only_float32_weights_compile_nothing_new() -> None:
    config = small()
    state = initial_state(config, INPUTS)
    rates, keys = some_rates(2), presentation_keys(0, "query", np.arange(2))
    count_spikes(state, rates, keys, config)
    compiled = len(conductance_run.present.signatures)
    state.weights = state.weights.astype(np.float32)
    for array in (state.weights, state.delays, state.theta_mv, rates, keys):
        array.flags.writeable = False
    count_spikes(state, rates, keys, config)
    train_presentation(state, rates[0], 1, config)
    assert len(conductance_run.present.signatures) == compiled


def test_no_input_no_spikes_and_theta_only_decays() -> None:
    config = small()
    state = initial_state(config, INPUTS)
    counts, events = train_presentation(state, np.zeros(INPUTS, np.uint32), 1, config)
    assert counts.sum() == events["input_spikes"] == events["synaptic_operations"] == events["messages"] == 0
    expected = 12.0
    for _ in range(410):
        expected -= 1e-4 * expected
    np.testing.assert_array_equal(state.theta_mv, expected)
    np.testing.assert_allclose(state.weights.sum(axis=0), 6.0, rtol=1e-12)


def test_neurons_without_weights_keep_none() -> None:
    config = small()
    state = initial_state(config, INPUTS)
    state.weights[:, 2] = 0
    counts, _ = train_presentation(state, some_rates(1)[0], 1, config)
    assert counts[2] == 0
    assert not state.weights[:, 2].any()


def test_a_neuron_spikes_at_most_7_times_in_350_ms() -> None:
    """The released counts top out at exactly 7: one spike each 50.1 ms."""
    config = preset("paper")
    config = replace(config, network=replace(config.network, neurons=NEURONS))
    assert constants(config, learn=False).timer == 501
    state = initial_state(config, INPUTS)
    state.weights[:] = 0.0
    state.weights[:, 0] = 1.0  # nothing inhibits the only neuron with input
    state.theta_mv[:] = 8.0
    rates = np.full((1, INPUTS), 2**31, np.uint32)
    counts, events = count_spikes(state, rates, np.array([1], np.uint64), config)
    np.testing.assert_array_equal(counts, [[7, 0, 0, 0, 0, 0]])
    assert events["exc_spikes"] >= 7


def test_initial_state_is_drawn_from_its_own_keys() -> None:
    config = preset("paper")
    state = initial_state(config, 784)
    start = uniform(presentation_key(0, "start", 0), 784 * 400).reshape(784, 400)
    np.testing.assert_array_equal(state.weights, 0.3 * (start + 0.01))
    assert state.delays.dtype == np.uint16
    assert (state.delays.min(), state.delays.max()) == (0, 100)
    assert 49 < state.delays.mean() < 51
    np.testing.assert_array_equal(state.theta_mv, np.full(400, 20.0))
    again = initial_state(replace(config, seed=1), 784)
    assert not np.array_equal(again.delays, state.delays)


def test_no_queries_at_all() -> None:
    config = small()
    counts, events = count_spikes(
        initial_state(config, INPUTS), np.zeros((0, INPUTS), np.uint32), np.zeros(0, np.uint64), config
    )
    assert counts.shape == (0, NEURONS)
    assert not any(events.values())


def test_errors_say_what_and_the_remedy() -> None:
    config = small()
    state = initial_state(config, INPUTS)
    with pytest.raises(ConfigError, match=r"^preset 'loihi' has no conductance network; use the preset paper$"):
        initial_state(preset("loihi"), INPUTS)
    with pytest.raises(ConfigError, match=r"^network.dt_ms is 1.0, but must be below .* 1.0 ms; lower it$"):
        initial_state(small(dt_ms=1.0), INPUTS)
    with pytest.raises(InputError, match=r"^rates have 9 inputs, but the network has 14; .*settings$"):
        train_presentation(state, np.zeros(9, np.uint32), 1, config)
    with pytest.raises(InputError, match=r"^rates have 9 inputs, but the network has 14; .*settings$"):
        count_spikes(state, np.zeros((1, 9), np.uint32), np.zeros(1, np.uint64), config)
    state.theta_mv = np.zeros(NEURONS + 1)
    with pytest.raises(InputError, match=r"^weights \(14, 6\), delays \(14, 6\) and thresholds \(7,\) .* one model$"):
        train_presentation(state, some_rates(1)[0], 1, config)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Brian2's own, of pyparsing and others
@pytest.mark.parametrize("rule", ["triplet", "paper"])
def test_brian2_gives_the_same_spikes(rule: str) -> None:
    """The same input spikes to VPRSNN's network in Brian2; needs Brian2 (`make peers-test`) and a C compiler."""
    pytest.importorskip("brian2", reason="Brian2 is not installed: make peers-test")
    from benchmarks.peers.brian2_network import Brian2Network

    config = small(rule, neurons=20, steps=1500, rest_steps=500, delay_max_ms=10.0)
    state = initial_state(config, INPUTS)
    rates, key = some_rates(2, 8, 0.1), 5
    learning = Brian2Network(config, copy(state), learn=True, inputs="spikes")
    for image in rates:
        counts, _ = train_presentation(state, image, key, config)
        theirs, _ = learning.present_spikes(*np.nonzero(draw_spikes(image, key, config.network.steps)))
        np.testing.assert_array_equal(counts, theirs)
        assert counts.sum() > 5
        np.testing.assert_allclose(state.weights, learning.weights, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.theta_mv, learning.theta_mv, rtol=1e-12)
    frozen = Brian2Network(config, copy(state), learn=False, inputs="spikes")
    counts, _ = count_spikes(state, rates[:1], np.array([key], np.uint64), config)
    theirs, _ = frozen.present_spikes(*np.nonzero(draw_spikes(rates[0], key, config.network.steps)))
    np.testing.assert_array_equal(counts[0], theirs)
    assert counts.sum() > 5
