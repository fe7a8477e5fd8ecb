"""Training against a literal version of the same equations, and its invariants."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.literal.floats import train_presentation

from lava_vpr.config import StdpLearning
from lava_vpr.encoding import draw_spikes
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.learning import stdp


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"hold_steps": 0},
        {"hold_steps": 3},
        {"mu": 1.0},
        {"inhibition": 0.0},
        {"floor": -1.0},
        {"w_max": 0.4},
        {"drive": 1.5},
        {"trains": "poisson"},
    ],
)
def test_equals_the_literal_version(changes: dict) -> None:
    learning = dataclasses.replace(StdpLearning(steps=120, threshold=2.0, competition_epochs=2), **changes)
    state = stdp.initial_state(30, 6, learning, seed=1)
    literal_weights, literal_theta = state.weights.copy(), state.theta.copy()
    trainer = stdp.Trainer(state, learning, spikes_per_step=3.0)
    gain = learning.drive / (learning.mean_weight * 3.0)
    rng = np.random.default_rng(0)
    spiked = [0, 0]
    for epoch in range(4):
        trainer.begin_epoch(epoch)
        consolidating = epoch >= 2
        if epoch == 2:
            literal_theta *= np.float32(learning.consolidation_threshold)
        tau = learning.consolidation_tau_trace if consolidating else learning.tau_trace
        share = learning.consolidation_x_target if consolidating else learning.x_target
        load = 3.0 / 30 * tau
        rates = rng.integers(0, 13000, 30).astype(np.uint16)
        counts, events = trainer.present(rates, epoch)
        spikes_of = bias_input_spikes if learning.trains == "regular" else draw_spikes
        spikes = spikes_of(rates, epoch, learning.steps)
        expected = train_presentation(
            literal_weights,
            literal_theta,
            spikes,
            learning,
            gain,
            stdp.trace_table(learning.steps, tau),
            eta=learning.consolidation_eta if consolidating else learning.eta,
            target=share * load / (1 + load),
            theta_plus=0.0 if consolidating else learning.theta_plus,
        )
        assert np.array_equal(counts, expected)
        if learning.mu:  # the power function may differ in its last bit
            assert np.allclose(state.weights, literal_weights, rtol=1e-6, atol=1e-7)
        else:
            assert np.array_equal(state.weights, literal_weights)
        assert np.array_equal(state.theta, literal_theta)
        assert events.tolist() == [int(spikes.sum()), int(counts.sum())]
        spiked[consolidating] += int(counts.sum())
    assert min(spiked) > 5


def counts_of(weights: np.ndarray, inhibition: float) -> np.ndarray:
    """Spike counts of neurons that do not learn, int32 (neurons,)."""
    learning = StdpLearning(steps=120, threshold=2.0, eta=0.0, theta_plus=0.0, inhibition=inhibition)
    state = stdp.PlasticState(weights.astype(np.float32), np.full(weights.shape[1], 2, np.float32))
    rates = np.random.default_rng(5).integers(0, 13000, len(weights)).astype(np.uint16)
    return stdp.Trainer(state, learning, 3.0).present(rates, 6)[0]


def test_inhibition_comes_once_a_step_and_spares_those_that_spiked() -> None:
    weights = np.random.default_rng(1).random((30, 3))
    few = counts_of(weights, 3.0)
    assert (few > 1).sum() > 1
    assert (few < counts_of(weights, 0.0)).any()
    # Twice the neurons, pair by pair equal: two spikes in a step take no more than one, and neither takes from either.
    assert np.array_equal(counts_of(np.repeat(weights, 2, axis=1), 3.0), np.repeat(few, 2))
    alone = counts_of(weights[:, :1], 3.0)
    assert alone[0] > 3
    assert np.array_equal(alone, counts_of(weights[:, :1], 0.0))


def test_mean_trace_is_the_mean_of_a_trace_that_spikes_set_to_one() -> None:
    inputs, tot, tau = 50, 3.0, 12.0
    decay, x, total = np.exp(-1 / tau), np.zeros(inputs), 0.0
    spikes = draw_spikes(np.full(inputs, round(tot / inputs * 65536), np.uint16), 7, 20_000)
    for row in spikes:
        x = np.where(row, 1.0, x * decay)
        total += x.mean()
    assert stdp.mean_trace(inputs, tot, tau) == pytest.approx(
        total / len(spikes), rel=0.1
    )  # the formula is for continuous time


def test_learning_pulls_weights_to_what_was_shown() -> None:
    learning = StdpLearning()
    state = stdp.initial_state(100, 4, learning, seed=0)
    trainer = stdp.Trainer(state, learning, spikes_per_step=12.0)
    rates = np.zeros(100, np.uint16)
    rates[:20] = round(12 / 20 * 65536 * 0.999)
    for epoch in range(3):
        counts, _ = trainer.present(rates, epoch)
    winner = int(counts.argmax())
    stdp.normalise(state.weights, learning.mean_weight)
    assert state.weights[:20, winner].mean() > 5 * state.weights[20:, winner].mean()


def test_normalise_gives_every_neuron_the_same_mean() -> None:
    weights = np.random.default_rng(0).random((50, 7)).astype(np.float32)
    weights[:, 3] = 0
    stdp.normalise(weights, 0.1)
    assert np.allclose(np.delete(weights, 3, axis=1).mean(axis=0), 0.1, rtol=1e-5)
    assert not weights[:, 3].any()


def test_trace_decays_exponentially() -> None:
    table = stdp.trace_table(100, 20.0)
    assert np.allclose(table, np.exp(-np.arange(101) / 20.0), rtol=1e-6)


def test_stretches_start_from_weights_of_their_own() -> None:
    learning = StdpLearning()
    a, b = (stdp.initial_state(20, 5, learning, 0, stretch).weights for stretch in (0, 1))
    assert not np.array_equal(a, b)
    assert 0.003 <= a.min() < a.max() < 0.303
