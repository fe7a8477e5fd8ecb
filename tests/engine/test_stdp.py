"""Training against a literal version of the same equations, and its invariants; places without a neuron get one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.config import Config, StdpLearning, preset
from lava_vpr.configfile import update
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.learning import stdp
from lava_vpr.engine.learning.recruiting import Thresholds, key_again, recruit, rounds, unpaired
from lava_vpr.engine.random import image_keys, presentation_key
from lava_vpr.engine.rates import draw_spikes
from lava_vpr.model import Stretch
from lava_vpr.training.trainers import StretchTrainer, rule_of


def train_presentation(
    weights: NDArray[np.float32],
    theta: NDArray[np.float32],
    spikes: NDArray[np.bool_],
    learning: StdpLearning,
    gain: float,
    trace_table: NDArray[np.float32],
    *,
    eta: float,
    target: float,
    theta_plus: float,
) -> NDArray[np.int64]:
    """One training presentation in scalar float32, step by step; changes ``weights`` and ``theta``; returns counts."""
    f = np.float32
    inputs, n = weights.shape
    for i in range(n):
        total = f(0)
        for j in range(inputs):
            total = f(total + weights[j, i])
        factor = f(f(f(learning.mean_weight) * f(inputs)) / total)
        for j in range(inputs):
            weights[j, i] = f(weights[j, i] * factor)
    keep = f(1.0 - 1.0 / learning.tau_membrane)
    v = [f(0)] * n
    last = [-1] * inputs
    held = [0] * n
    history: list[list[int]] = []
    counts = np.zeros(n, np.int64)
    for t in range(len(spikes)):
        on = [int(j) for j in np.flatnonzero(spikes[t])]
        for j in on:
            last[j] = t
        earlier = history[t - 2] if t >= 2 else []
        now = []
        for i in range(n):
            drive = f(0)
            for j in on:
                drive = f(drive + weights[j, i])
            drive = f(drive * f(gain))
            if earlier:
                drive = f(drive - f(learning.inhibition))
                if i in earlier:  # given back
                    drive = f(drive + f(learning.inhibition))
            x = max(f(f(v[i] * keep) + drive), f(learning.floor))
            if held[i] > 0:
                x, held[i] = f(0), held[i] - 1
            v[i] = x
            if x > theta[i]:
                now.append(i)
        for i in now:
            v[i] = f(0)
            held[i] = learning.hold_steps
            theta[i] = f(theta[i] + f(theta_plus))
            counts[i] += 1
            for j in range(inputs):
                x = trace_table[t - last[j]] if last[j] >= 0 else f(0)
                change = f(f(eta) * f(x - f(target)))
                if learning.mu:
                    change = f(change * f(f(f(learning.w_max) - weights[j, i]) ** f(learning.mu)))
                weights[j, i] = min(max(f(weights[j, i] + change), f(0)), f(learning.w_max))
        history.append(now)
    return counts


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
    state, phases = stdp.initial_state(30, 6, learning, 3.0, 1, 0), stdp.phases(learning, 30, 3.0)
    literal_weights, literal_theta = state.weights.copy(), state.theta.copy()
    gain = learning.drive / (learning.mean_weight * 3.0)
    rng = np.random.default_rng(0)
    spiked = [0, 0]
    for epoch in range(4):
        consolidating = epoch >= 2
        if epoch == 2:
            stdp.scale_thresholds(state.theta, learning.consolidation_threshold)
            literal_theta *= np.float32(learning.consolidation_threshold)
        tau = learning.consolidation_tau_trace if consolidating else learning.tau_trace
        share = learning.consolidation_x_target if consolidating else learning.x_target
        load = 3.0 / 30 * tau
        rates = rng.integers(0, 13000, 30).astype(np.uint16)
        counts, events = stdp.present(state, phases[consolidating], rates, epoch)
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
    return stdp.present(state, stdp.phases(learning, len(weights), 3.0)[0], rates, 6)[0]


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
    state, phase = stdp.initial_state(100, 4, learning, 12.0, 0, 0), stdp.phases(learning, 100, 12.0)[0]
    rates = np.zeros(100, np.uint16)
    rates[:20] = round(12 / 20 * 65536 * 0.999)
    for epoch in range(3):
        counts, _ = stdp.present(state, phase, rates, epoch)
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
    a, b = (stdp.initial_state(20, 5, learning, 3.0, 0, stretch).weights for stretch in (0, 1))
    assert not np.array_equal(a, b)
    assert 0.003 <= a.min() < a.max() < 0.303


PLACES = 3


def counts(*rows: list[int]) -> NDArray[np.int64]:
    return np.array(rows, np.int64)


@pytest.mark.parametrize(
    ("shown", "places", "neurons"),
    [
        (counts([5, 0, 0], [0, 5, 0], [0, 0, 5]), [], []),
        (counts([5, 1, 0], [0, 0, 9], [0, 0, 4]), [2], [1]),  # two neurons share a place, a third holds two
        (counts([5, 5, 0], [0, 0, 0], [0, 0, 4]), [1], [1]),  # of equals the first has the place
        (counts([0, 0, 0], [0, 0, 0], [0, 0, 0]), [0, 1, 2], [0, 1, 2]),
        (counts([3, 3, 0], [3, 0, 0], [0, 3, 0]), [1, 2], [1, 2]),  # equal counts: a neuron's place is the first
    ],
)
def test_who_is_without(shown: NDArray[np.int64], places: list[int], neurons: list[int]) -> None:
    assert unpaired(shown) == (places, neurons)


def test_of_more_neurons_than_places_the_strongest_has_the_place() -> None:
    assert unpaired(counts([2, 3, 0, 1], [0, 0, 0, 0])) == ([1], [0, 2, 3])


def test_a_place_is_learned_by_who_spikes_most_and_by_nobody_else() -> None:
    theta = np.array([7.0, 8.0, 9.0, 10.0], np.float32)
    seen: list[tuple[int, int, list[float]]] = []

    def show(place: int, times: int) -> NDArray[np.int64]:
        seen.append((place, times, theta.tolist()))
        return np.where(theta < 100, [0, 2, 0, 5], 0)

    shown = counts([9, 0, 0, 0], [0, 0, 0, 0], [0, 0, 9, 0], [0, 0, 0, 0])
    assert recruit(Thresholds(theta, 1.0, 100.0), shown, 2, show)
    held = 100.0
    assert seen == [
        (1, 1, [held, 1.0, held, 1.0]),
        (1, 2, [held, held, held, 1.0]),
        (3, 1, [held, 1.0, held, held]),
        (3, 2, [held, 1.0, held, held]),
    ]
    assert theta.tolist() == [7.0, 8.0, 9.0, 10.0]


def test_a_place_that_nobody_spikes_for_stays_without() -> None:
    theta = np.ones(2, np.float32)
    seen: list[int] = []

    def show(place: int, times: int) -> NDArray[np.int64]:
        seen.append(place)
        return np.array([0, 0 if place == 0 else 3])

    assert recruit(Thresholds(theta, 1.0, 100.0), counts([0, 0], [0, 0]), 3, show)
    assert seen == [0, 1, 1, 1]


def test_a_stop_is_told() -> None:
    theta = np.ones(1, np.float32)
    assert not recruit(Thresholds(theta, 1.0, 100.0), counts([0]), 1, lambda place, times: None)


def test_as_often_as_the_second_phase_shows_all() -> None:
    assert rounds(StdpLearning()) == 4
    assert rounds(StdpLearning(epochs=1)) == 0
    assert rounds(StdpLearning(recruit=False)) == 0


def test_every_time_has_noise_of_its_own() -> None:
    assert key_again(5, 0) == 5
    assert len({key_again(key, times) for key in (5, 6) for times in range(4)}) == 8


def config(**learning: object) -> Config:
    return update(preset("loihi"), {"learning": {"epochs": 4, "competition_epochs": 2, "steps": 100, **learning}})


@pytest.mark.parametrize("arithmetic", ["float", "integer"])
def test_neurons_that_have_a_place_learn_nothing_more(arithmetic: str) -> None:
    settings = config(arithmetic=arithmetic)
    trainer: StretchTrainer = rule_of(settings).trainer(
        settings, Stretch(0, PLACES, 0, PLACES), 0, np.zeros((0, 0), np.float32)
    )
    inputs = settings.encoder.inputs
    rates = np.zeros((PLACES, inputs), np.uint16)
    for place, row in enumerate(rates):
        row[place::PLACES] = round(65536 * 12 * PLACES / inputs)
    keys = image_keys(rates)
    trainer.begin_epoch(2)
    thresholds = trainer.thresholds()

    def show(place: int, times: int) -> NDArray[np.int32]:
        return trainer.present(rates[place], presentation_key(0, "train", int(keys[place]), times), place, 2)

    before, theta = trainer.state()["weights"].copy(), thresholds.theta.copy()
    assert recruit(thresholds, counts([9, 0, 0], [0, 9, 0], [0, 0, 0]), 3, show)
    after = trainer.state()["weights"]
    first, second = (
        weights / np.linalg.norm(weights, axis=0) for weights in (before.astype(float), after.astype(float))
    )
    turned = 1 - (first * second).sum(axis=0)
    assert turned[:2].max() < 0.002, "more than normalising changes, which rounds"
    assert turned[2] > 0.05
    own = after[:, 2].astype(float)
    assert own[2::PLACES].mean() > 1.5 * own[0::PLACES].mean()
    assert np.array_equal(thresholds.theta, theta)
