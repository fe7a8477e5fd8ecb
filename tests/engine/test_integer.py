"""Learning in integers against a literal version of the same equations, and its invariants."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from support.literal import integers

from lava_vpr.config import StdpLearning, integer_config, preset
from lava_vpr.configfile import update
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.learning import integer, integer_kernels, stdp
from lava_vpr.engine.learning.integer import IntegerLearning, WeightRule
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.engine.random import presentation_key
from lava_vpr.engine.rates import draw_spikes
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.loihi import PRODUCT_EXPONENTS, PRODUCT_MANTISSAS
from lava_vpr.model import Stretch
from lava_vpr.training.trainers import StdpTrainer

INPUTS, NEURONS = 24, 5
USUAL = IntegerLearning(
    rule=WeightRule(((6, -6), (1, -7)), 15, 0, 20.0),
    inhibition=240,
    neurons=LifParameters(dv=205, floor=-480, hold_steps=1, theta_plus=32),
    weight_sum=13 * INPUTS,
    steps=60,
)


def changed(**changes: object) -> IntegerLearning:
    """`USUAL` with other settings, those of its neurons and of its rule included."""
    rule, neurons = (
        {k: v for k, v in changes.items() if k in {f.name for f in dataclasses.fields(kind)}}
        for kind in (WeightRule, LifParameters)
    )
    rest = {k: v for k, v in changes.items() if k not in rule and k not in neurons}
    return dataclasses.replace(
        USUAL,
        rule=dataclasses.replace(USUAL.rule, **rule),
        neurons=dataclasses.replace(USUAL.neurons, **neurons),
        **rest,
    )


@pytest.mark.parametrize(
    "learning",
    [
        USUAL,
        changed(late_theta=True),
        changed(regular=True),
        changed(theta_plus=0, hold_steps=0, floor=None),
        changed(hold_steps=3, dv=0, inhibition=0),
        changed(mu=1, products=((7, -2), (-3, -5)), target=30),
        changed(mu=2, products=((5, -1),), target=30),
        changed(products=((-8, -5), (7, 2), (3, -7)), target=60, tau=3.5),
        changed(products=((7, 8), (7, 8)), target=80),
        changed(weight_sum=0, inhibition=500),
        changed(floor=-1, weight_sum=40 * INPUTS, steps=33),
    ],
)
def test_equals_the_literal_version(learning: IntegerLearning) -> None:
    learning.check()
    rng = np.random.default_rng(1)
    state = PlasticState(rng.integers(0, 60, (INPUTS, NEURONS)).astype(np.uint8), np.full(NEURONS, 240, np.int32))
    start = state.weights.copy()
    fired = 0
    for k in range(3):
        key = presentation_key(3, "train", k)
        rates = rng.integers(0, 16_000, INPUTS).astype(np.uint16)
        spikes = (bias_input_spikes if learning.regular else draw_spikes)(rates, key, learning.steps)
        expected = integers.present(state.weights, state.theta, spikes, learning, key)
        traces = np.zeros(INPUTS, np.uint8)
        counts, events, raster = integer.present(state, learning, rates, key, traces=traces, raster=True)
        for found, wanted in zip((state.weights, state.theta, traces, raster), expected, strict=True):
            assert np.array_equal(found, wanted)
        assert np.array_equal(counts, raster.sum(axis=0, dtype=np.int64))
        assert events.tolist() == [int(spikes.sum()), int(counts.sum())]
        fired += int(counts.sum())
    assert fired > 10
    assert not np.array_equal(state.weights, start)


@given(st.lists(st.sampled_from(PRODUCT_MANTISSAS), min_size=1, max_size=3), st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_weight_change_equals_the_literal_one(mantissas: list[int], data: st.DataObject) -> None:
    exponents = data.draw(st.lists(st.sampled_from(PRODUCT_EXPONENTS), min_size=3, max_size=3))
    mu, target = data.draw(st.integers(0, 2)), data.draw(st.integers(0, 127))
    draw = data.draw(st.integers(0, 2**53 - 1))
    products = tuple(zip(mantissas, exponents, strict=False))
    rule = WeightRule(products, target, mu, 20.0)
    literal = dataclasses.replace(rule, products=tuple((int(m), int(s) - 7) for m, s in rule.table()))
    w = np.repeat(np.array([0, 1, 100, 254, 255], np.uint8), 4)
    x = np.tile(np.array([0, 1, 60, 127], np.uint8), 5)
    weights = w[:, None].copy()
    integer_kernels.learn_column(weights, 0, x, rule.table(), target, mu, np.uint64(draw))
    expected = [integers.learned(int(a), int(b), literal, draw * 2.0**-53) for a, b in zip(w, x, strict=True)]
    assert weights[:, 0].tolist() == expected


def test_rounding_of_traces_is_unbiased() -> None:
    rule, rng = WeightRule(((1, 0),), 0, 0, 20.0), np.random.default_rng(0)
    whole, fraction = rule.decay()
    draws = rng.integers(0, 1 << 53, 4000).astype(np.uint64)
    total = np.zeros(128)
    for draw in draws:
        x = np.arange(128).astype(np.uint8)
        integer_kernels.decay_traces(x, whole, fraction, draw)
        total += x
    exact = np.exp(-1 / 20) * np.arange(128)
    assert np.abs(total / len(draws) - exact).max() < 4 * 0.5 / np.sqrt(len(draws))


def test_rounding_of_weights_is_unbiased() -> None:
    rule, rng = WeightRule(((3, -5),), 25, 0, 20.0), np.random.default_rng(0)
    x = np.arange(128).astype(np.uint8)
    draws = rng.integers(0, 1 << 53, 4000).astype(np.uint64)
    total = np.zeros(128)
    for draw in draws:
        weights = np.full((128, 1), 100, np.uint8)
        integer_kernels.learn_column(weights, 0, x, rule.table(), 25, 0, draw)
        total += weights[:, 0]
    exact = 100 + 3 / 32 * (np.arange(128) - 25)
    assert np.abs(total / len(draws) - exact).max() < 4 * 0.5 / np.sqrt(len(draws))


def test_normalised_sums_are_near_the_target_and_weights_in_range() -> None:
    rng = np.random.default_rng(0)
    weights = rng.integers(0, 30, (400, 6)).astype(np.uint8)
    weights[:, 4] = 0
    weights[:, 5] = 0
    weights[7, 5] = 3  # alone it cannot reach the sum
    for key in range(20):
        integer.normalise(weights, 5000, key)
        sums = weights.sum(axis=0, dtype=np.int64)
        assert np.abs(sums[:4] - 5000).max() < 4 * 0.5 * np.sqrt(400)
        assert sums[4] == 0
        assert weights[7, 5] == 255
    means = []
    for key in range(200):
        weights = np.full((10, 1), 7, np.uint8)
        weights[0] = 10
        integer.normalise(weights, 100, key)
        means.append(weights[:, 0].astype(float))
    exact = np.array([10] + [7] * 9) * 100 / 73
    assert np.abs(np.mean(means, axis=0) - exact).max() < 4 * 0.5 / np.sqrt(200)


@given(st.floats(0, 7 * 256.0))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_products_sum_to_the_rate(rate: float) -> None:
    found = integer.products(rate)
    assert sum(mantissa * 2.0**exponent for mantissa, exponent in found) == round(rate * 128) / 128
    assert all(1 <= mantissa <= 7 and exponent in PRODUCT_EXPONENTS for mantissa, exponent in found)


def test_traces_given_go_on_and_the_default_starts_at_zero() -> None:
    rates, key = np.zeros(INPUTS, np.uint16), 5
    for traces, nonzero in ((np.full(INPUTS, 127, np.uint8), True), (np.zeros(INPUTS, np.uint8), False)):
        state = PlasticState(np.full((INPUTS, NEURONS), 10, np.uint8), np.full(NEURONS, 50, np.int32))
        integer.present(state, USUAL, rates, key, traces=traces)
        assert traces.any() == nonzero
        assert traces.max() < 127


def test_a_drawn_number_below_the_fraction_rounds_up() -> None:
    whole, fraction = WeightRule(((1, 0),), 0, 0, 20.0).decay()
    for draw, up in ((int(fraction[100]) - 1, 1), (int(fraction[100]), 0)):
        x = np.array([100], np.uint8)
        integer_kernels.decay_traces(x, whole, fraction, np.uint64(draw))
        assert x[0] == whole[100] + up


@pytest.mark.parametrize(
    ("learning", "text"),
    [
        (changed(products=((8, 0),)), "mantissas -8..7"),
        (changed(products=((1, -8),)), "exponents -7..8"),
        (changed(mu=3), "mu 3 is no sum of products"),
        (changed(target=128), "no 7-bit trace"),
        (changed(tau=0.5), r"decays within 0\.5 steps"),
        (changed(dv=5000), "dv is 5000"),
        (changed(floor=5), "floor is 5"),
        (changed(inhibition=1 << 17), "inhibition is 131,072 while learning, but .*; lower learning.inhibition"),
    ],
)
def test_what_the_chip_cannot_hold_is_refused(learning: IntegerLearning, text: str) -> None:
    with pytest.raises(NetworkLimitError, match=text):
        learning.check()


def test_settings_without_an_integer_form_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"mu is 0\.5"):
        integer.phases(StdpLearning(mu=0.5), 784, 12.0)
    with pytest.raises(NetworkLimitError, match="no 7-bit trace"):
        integer.phases(StdpLearning(x_target=50.0), 784, 12.0)


def test_phases_are_the_float_settings_in_integers() -> None:
    learning = StdpLearning()
    competition, consolidation = integer.phases(learning, 784, 12.0)
    assert competition.regular
    assert not integer.phases(StdpLearning(trains="poisson"), 784, 12.0)[0].regular
    per_unit = integer.unit(learning, 12.0)
    assert competition.inhibition == pytest.approx(learning.inhibition * per_unit, rel=1 / 256)
    assert competition.neurons.theta_plus == round(learning.theta_plus * per_unit)
    assert consolidation.neurons.theta_plus == 0
    # A weight at rest, an input that has just spiked: the float change, in units of 2 / 255.
    weights = np.full((1, 1), 100, np.uint8)
    x = np.full(1, 127, np.uint8)
    rule = competition.rule
    integer_kernels.learn_column(weights, 0, x, rule.table(), rule.target, rule.mu, np.uint64(1 << 52))
    mean = learning.x_target * integer.mean_trace(784, 12.0, learning.tau_trace)
    assert weights[0, 0] - 100 == pytest.approx(learning.eta * (1 - mean) * 255 / 2, abs=1)


def test_a_stretch_learns_what_it_is_shown() -> None:
    config = update(preset("loihi"), {"learning": {"arithmetic": "integer"}})
    trainer, inputs = StdpTrainer(config, Stretch(0, 4, 0, 4), 0), config.encoder.inputs
    weights, theta = trainer.state().values()
    rates = np.zeros(inputs, np.uint16)
    rates[: inputs // 5] = round(12 / (inputs // 5) * 65536 * 0.999)
    for epoch in range(3):
        trainer.begin_epoch(epoch)
        counts = trainer.present(rates, epoch, 0, epoch)
    winner = int(counts.argmax())
    assert weights[: inputs // 5, winner].mean() > 5 * weights[inputs // 5 :, winner].mean()
    before, last = theta.copy(), integer_config(config, "a test").learning.competing
    trainer.begin_epoch(last)
    assert np.array_equal(theta, before >> 1)
    assert trainer.present(rates, 9, 0, last).any()
    assert np.array_equal(theta, before >> 1)


@pytest.mark.parametrize("module", [integer, stdp])
def test_thresholds_are_scaled_once_where_the_phase_changes(module: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    arithmetic = "integer" if module is integer else "float"
    config = update(preset("loihi"), {"learning": {"arithmetic": arithmetic, "competition_epochs": 2}})
    trainer, scaled, phases = StdpTrainer(config, Stretch(0, 4, 0, 4), 0), [], []
    monkeypatch.setattr(module, "scale_thresholds", lambda theta, by: scaled.append((epoch, by)))
    monkeypatch.setattr(module, "present", lambda state, phase, *_: (phases.append(phase),))
    for epoch in range(4):
        trainer.begin_epoch(epoch)
        trainer.present(np.zeros(config.encoder.inputs, np.uint16), epoch, 0, epoch)
    assert scaled == [(2, config.learning.consolidation_threshold)]
    assert [phase is trainer._phases[1] for phase in phases] == [False, False, True, True]
