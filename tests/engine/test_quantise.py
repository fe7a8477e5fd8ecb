"""From float weights to integers: scale, unit, bias and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import (
    biases_of,
    check_steps,
    distinctive,
    integer_weights,
    mantissa_of,
    mean_drives,
    own_drives,
    pruned,
    quantise,
)
from lava_vpr.engine.inference.surroundings import Shown
from lava_vpr.errors import ConfigError, NetworkLimitError

PLACES, INPUTS = 12, 300
UNSIGNED = LifNetwork(signed=False, trains="poisson")


def images(seed: int, n: int = PLACES) -> NDArray[np.float64]:
    """Activity of places, each with inputs of its own beside what all share, (n, inputs)."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.random((n, INPUTS)) ** 6 + rng.random(INPUTS) ** 2)


def rates(activity: NDArray[np.float64]) -> NDArray[np.uint16]:
    return np.round(activity / activity.sum(axis=1, keepdims=True) * 20 * 65536).astype(np.uint16)


def learned() -> NDArray[np.float32]:
    return images(0).T.astype(np.float32)


def whole(traverses: int = 1) -> tuple[Shown, ...]:
    """One stretch of all neurons, its places seen in several traverses."""
    seen = [rates(images(0) + 0.3 * images(k)) for k in range(traverses)]
    return (Shown(np.concatenate(seen), slice(0, PLACES)),)


def equal(a: FixedNetwork, b: FixedNetwork) -> bool:
    same = np.array_equal(a.weights, b.weights) and np.array_equal(a.bias, b.bias)
    return same and a.scalars == b.scalars


def made(settings: LifNetwork, shown: Sequence[Shown] | None = None) -> FixedNetwork:
    return quantise(distinctive(learned(), settings), settings, whole() if shown is None else shown)


def drives(weights: NDArray[np.int16], shown: Sequence[Shown]) -> tuple[list[Fraction], list[Fraction]]:
    """Of each neuron, what its best reference brings it, and what all references do on average; exactly."""
    own = [Fraction(-(10**9))] * weights.shape[1]
    total = [Fraction(0)] * weights.shape[1]
    for part in shown:
        for image in part.rates.tolist():
            for i in range(weights.shape[1]):
                drive = Fraction(sum(r * int(k) for r, k in zip(image, weights[:, i], strict=True)), 1 << 16)
                total[i] += drive
                if part.neurons.start <= i < part.neurons.stop:
                    own[i] = max(own[i], drive)
    return own, [one / sum(len(part.rates) for part in shown) for one in total]


def test_signed_weights_are_what_all_neurons_do_not_share() -> None:
    given = learned()
    given[:, 5] = 0
    found = distinctive(given, LifNetwork())
    others = [i for i in range(PLACES) if i != 5]
    units = np.stack([given[:, i] / np.linalg.norm(given[:, i].astype(float)) for i in others], axis=1)
    differences = units - units.mean(axis=1, keepdims=True)
    assert np.allclose(found[:, others], differences / np.linalg.norm(differences, axis=0), atol=1e-7)
    assert not found[:, 5].any()  # what has learned nothing stays silent, and counts for no mean
    assert found.min() < 0 < found.max()


@pytest.mark.parametrize(
    ("given", "settings", "message"),
    [
        (np.zeros((4, 2)), LifNetwork(), "all weights are 0: nothing was learned; check learning.eta and"),
        (np.zeros((4, 2)), UNSIGNED, "nothing was learned"),
        (np.ones((4, 3)), LifNetwork(), "all neurons have learned the same, .*; show other places"),
        (np.array([[0.1], [0.7]]) * [1, 1, 0], LifNetwork(), "all neurons have learned the same"),
        (np.ones((4, 3)), replace(UNSIGNED, prune=0.99), "pruning 0.99 of every neuron's weights leaves none"),
    ],
)
def test_what_leaves_no_weight_is_refused(given: NDArray[np.float64], settings: LifNetwork, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        distinctive(given.astype(np.float32), settings)


def test_the_smallest_magnitudes_are_pruned() -> None:
    given = np.array([[3.0, -0.1], [-1.0, 5.0], [2.0, 2.0], [-4.0, -2.0]])
    assert pruned(given, 0.0) is given
    assert pruned(given, 0.5).tolist() == [[3, 0], [0, 5], [0, 0], [-4, -2]]  # of equal ones the first
    assert given[0, 1] == -0.1
    for share in (-0.1, 1.0, float("nan")):
        with pytest.raises(ConfigError, match=r"must be in \[0, 1\); choose a smaller one"):
            pruned(given, share)


@pytest.mark.parametrize("bits", range(1, 9))
def test_the_largest_weights_take_all_bits(bits: int) -> None:
    weights = np.concatenate([np.linspace(-1, 1, 2001), [30.0]])[:, None]
    found = integer_weights(weights, bits)
    top = (1 << bits) - 1
    assert found.dtype == np.int16
    assert found.max() == -found.min() == top
    assert np.abs(found[:-1, 0] - weights[:-1, 0] * top).max() <= 0.51  # the one that is far out is cut
    few = np.zeros((5000, 1))
    few[3] = 0.2  # of so few the percentile is 0
    assert integer_weights(few, bits)[3, 0] == top


def test_drives_are_exact() -> None:
    weights = integer_weights(distinctive(learned(), LifNetwork()), 5)
    shown = (Shown(rates(images(0)[:5]), slice(0, 5)), Shown(rates(images(0)[5:]), slice(5, PLACES)))
    own, mean = drives(weights, shown)
    assert own_drives(weights, shown).tolist() == [float(one) for one in own]
    assert mean_drives(weights, shown) == pytest.approx([float(one) for one in mean], rel=1e-15)


@pytest.mark.parametrize("traverses", [1, 3])
@pytest.mark.parametrize("signed", [False, True])
def test_threshold_and_inhibition_are_in_units_of_a_neurons_own_drive(signed: bool, traverses: int) -> None:
    settings = LifNetwork(signed=signed, weight_bits=6, threshold=2.5, inhibition=0.9, tau_membrane=30, steps=32)
    shown = whole(traverses)
    network = made(settings, shown)
    own, mean = drives(network.weights, shown)
    unit = sum(a - (b if signed else 0) for a, b in zip(own, mean, strict=True)) / PLACES
    assert network.threshold == pytest.approx(float(2.5 * unit), abs=0.51)
    assert network.lateral == pytest.approx(float(0.9 * unit), rel=1 / 127, abs=0.51)
    assert (network.bits, network.signed, network.decay) == (6, signed, round(4096 / 30))
    assert (network.steps, network.interval, network.regular, network.bias_input) == (29, 32, True, False)
    assert (network.weights.min() < 0) == signed
    assert network.weights.max() == 63


def test_settings_of_inputs_are_those_of_the_network() -> None:
    for trains, mode, found in (
        ("poisson", "injected", (False, False)),
        ("regular", "injected", (True, False)),
        ("regular", "bias", (True, True)),
    ):
        network = made(LifNetwork(trains=trains, input_mode=mode))
        assert (network.regular, network.bias_input) == found
    with pytest.raises(
        ConfigError, match=r"network\.trains is 'poisson', but must be regular where input_mode is bias"
    ):
        LifNetwork(trains="poisson", input_mode="bias")


def test_the_order_of_references_does_not_matter() -> None:
    (part,) = whole(3)
    for settings in (LifNetwork(), UNSIGNED):
        network = made(settings, (part,))
        for seed in range(3):
            order = np.random.default_rng(seed).permutation(len(part.rates))
            assert equal(made(settings, (Shown(part.rates[order], part.neurons),)), network)


def test_each_stretch_is_measured_by_its_own_references() -> None:
    network = made(LifNetwork(weight_bits=6))
    apart = (Shown(rates(images(0)[:5]), slice(0, 5)), Shown(rates(images(0)[5:]), slice(5, PLACES)))
    assert np.allclose(made(LifNetwork(weight_bits=6), apart).threshold, network.threshold, rtol=0.1)
    # Neurons that are shown the places of others only are driven less by the best of them.
    strange = (Shown(apart[0].rates, apart[1].neurons), Shown(apart[1].rates, apart[0].neurons))
    weights = network.weights
    assert (own_drives(weights, strange) < own_drives(weights, apart)).all()


@pytest.mark.parametrize("tau", [12.0, 4000.0])
def test_biases_take_the_mean_drive_off(tau: float) -> None:
    settings = LifNetwork(weight_bits=7, tau_membrane=tau, threshold=10)
    network = made(settings)
    _, mean = drives(network.weights, whole())
    _, exponent = bias_registers(network.bias)
    wanted = np.array([float(-64 * one) for one in mean])
    assert network.bias.any()
    capped = wanted > network.safe_bias
    step = 1 << exponent
    assert np.abs(network.bias - wanted)[~capped].max() < step + 0.5
    assert (network.bias[capped] > network.safe_bias - step).all()
    assert (network.bias <= network.safe_bias).all()
    assert capped.any() == (tau > 1000)
    assert not made(replace(settings, signed=False)).bias.any()


def test_biases_are_capped_by_registers() -> None:
    assert biases_of(np.array([1e6, -1e6, 0.0]), 10**9).tolist() == [-(4095 << 7), 4095 << 7, 0]
    assert biases_of(np.array([-1.0, -2.0, 0.5]), 100).tolist() == [64, 100, -32]
    # One exponent for all: the large one takes low bits off the small ones, towards 0.
    assert biases_of(np.array([1000.0, 0.75, -0.9]), 10**9).tolist() == [-64_000, -48, 48]


def test_neurons_that_learned_nothing_stay_silent_and_count_for_nothing() -> None:
    given = learned()
    given[:, [2, 7]] = 0
    for settings in (LifNetwork(), UNSIGNED):
        network = quantise(distinctive(given, settings), settings, whole())
        assert not network.weights[:, [2, 7]].any()
        assert not network.bias[[2, 7]].any()
        own, mean = drives(network.weights, whole())
        lived = [i for i in range(PLACES) if i not in (2, 7)]
        unit = sum(own[i] - (mean[i] if settings.signed else 0) for i in lived) / len(lived)
        assert network.threshold == pytest.approx(float(settings.threshold * unit), abs=0.51)


def test_places_that_drive_no_neuron_are_refused() -> None:
    with pytest.raises(
        ConfigError,
        match=r"no neuron is driven by its own place: all reference images are alike, .*; give images of diff",
    ):
        made(UNSIGNED, (Shown(np.zeros((PLACES, INPUTS), np.uint16), slice(0, PLACES)),))
    same = np.tile(rates(images(0))[:1], (PLACES, 1))  # every place looks alike: none brings more than the mean
    with pytest.raises(ConfigError, match="no neuron is driven by its own place"):
        made(LifNetwork(), (Shown(same, slice(0, PLACES)),))


def test_what_registers_cannot_hold_is_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"lower network\.threshold"):
        made(LifNetwork(threshold=10_000.0))
    with pytest.raises(
        NetworkLimitError, match=r"inhibition_exponent \d+ does not fit 0\.\.7; lower network.inhibition"
    ):
        made(LifNetwork(inhibition=10_000.0))
    assert made(LifNetwork(inhibition=0.0)).inhibition == 0
    assert made(LifNetwork(threshold=1e-6)).threshold == 1


def test_a_mantissa_takes_the_least_exponent() -> None:
    assert mantissa_of(127.4) == (127, 0)
    assert mantissa_of(127.6) == (64, 1)
    assert mantissa_of(0.0) == (0, 0)
    assert mantissa_of(255.4, 255) == (255, 0)
    assert mantissa_of(255.6, 255) == (128, 1)
    for value in (300.0, 3000.0, 32_000.0):
        mantissa, exponent = mantissa_of(value)
        assert mantissa << exponent == pytest.approx(value, rel=1 / 127)
        assert 64 <= mantissa <= 127


@pytest.mark.parametrize(
    ("neurons", "mode", "silent"), [(1, "injected", 3), (1025, "injected", 4), (4097, "injected", 5), (4097, "bias", 4)]
)
def test_silence_fits_the_presentation(neurons: int, mode: str, silent: int) -> None:
    assert check_steps(LifNetwork(input_mode=mode), neurons) == silent
    assert check_steps(LifNetwork(input_mode=mode, steps=8), neurons) == silent
    if silent > 3:
        with pytest.raises(
            ConfigError, match=f"steps is 4, but {neurons:,} neurons need {silent} silent ones; raise it"
        ):
            check_steps(LifNetwork(input_mode=mode, steps=4), neurons)


@pytest.mark.parametrize("steps", [0, 3, 60, 63, 65, 100, 65_537])
def test_presentations_are_powers_of_two(steps: int) -> None:
    with pytest.raises(ConfigError, match=f"network.steps is {steps}, but must be"):
        LifNetwork(steps=steps)


@pytest.mark.parametrize("bits", [0, 8, 9])
def test_a_sign_takes_a_bit(bits: int) -> None:
    with pytest.raises(ConfigError, match=rf"network.weight_bits is {bits}, but must be in \[1, 7\]"):
        LifNetwork(weight_bits=bits)
    assert LifNetwork(weight_bits=7).weight_bits == 7
    assert replace(UNSIGNED, weight_bits=8).weight_bits == 8
