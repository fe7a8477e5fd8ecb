"""From float weights to integers: scale, unit and limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from lava_vpr.config import LifNetwork
from lava_vpr.engine.inference.quantise import MEAN_WEIGHT, equalise, most_neurons, quantise
from lava_vpr.errors import ConfigError, NetworkLimitError


def learned(neurons: int = 100, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.random((784, neurons)).astype(np.float32)


def test_equalise_gives_equal_norms_and_the_wanted_mean() -> None:
    weights = equalise(learned() * np.linspace(0.5, 2, 100, dtype=np.float32))
    norms = np.linalg.norm(weights, axis=0)
    assert np.allclose(norms, norms[0])
    assert weights.mean() == pytest.approx(MEAN_WEIGHT)
    with pytest.raises(ConfigError, match="nothing was learned"):
        equalise(np.zeros((4, 2), np.float32))


@pytest.mark.parametrize("bits", range(1, 9))
def test_every_width_keeps_threshold_and_drive_in_proportion(bits: int) -> None:
    weights = equalise(learned())
    network = quantise(weights, LifNetwork(weight_bits=bits), 6.0)
    assert network.weights.max() == (1 << bits) - 1
    # In float, a neuron at the mean is driven by 0.69 a step and fires above 10: the integers keep that ratio.
    drive = network.weights.mean() * 6.0 / (1 << network.shift)
    assert network.threshold / drive == pytest.approx(10 / 0.69, rel=0.1)
    assert network.lateral == pytest.approx(network.threshold, abs=2)
    assert network.threshold >= 20
    assert 99 * network.lateral < 1 << 15
    if network.shift:  # no finer than is of use, unless it costs no shift
        assert network.threshold <= 256
        assert 99 * network.lateral << network.shift >= 1 << 15
    assert network.decay == round(4096 / 30)


def test_joined_networks_use_their_own_inhibition_and_overflow_is_refused() -> None:
    weights = equalise(learned(500))
    joined = quantise(weights, LifNetwork(), 6.0, joined=True)
    assert joined.lateral == pytest.approx(joined.threshold / 2, abs=2)
    with pytest.raises(NetworkLimitError, match="lateral inhibition of 500 neurons"):
        quantise(weights, dataclasses.replace(LifNetwork(), inhibition=600.0), 6.0)
    big = quantise(weights[:, :20], LifNetwork(inhibition=60.0), 6.0)
    assert big.inhibition_exponent > 0
    assert big.lateral == pytest.approx(60 / 10 * big.threshold, rel=0.02)


@pytest.mark.parametrize(
    ("neurons", "limit", "least"), [(100, 1 << 15, 129), (500, 1 << 15, 64), (1000, 1 << 15, 32), (5000, 1 << 17, 16)]
)
def test_the_unit_follows_the_number_of_neurons(neurons: int, limit: int, least: int) -> None:
    """Up to 1000 neurons the inhibition fits Loihi 1's accumulator; beyond, Loihi 2's current."""
    weights = np.tile(equalise(learned(50)), neurons // 50)
    network = quantise(weights, LifNetwork(), 20.0, joined=neurons > 100)
    assert (neurons - 1) * network.lateral < limit
    assert network.threshold >= least


def test_what_is_refused_at_once_could_not_have_fitted() -> None:
    most = most_neurons(10.0, 5.0)
    assert 10_000 < most < 20_000
    weights = np.tile(equalise(learned(10)), -(-most // 10) + 1)
    with pytest.raises(NetworkLimitError, match="lateral inhibition"):
        quantise(weights, LifNetwork(), 20.0, joined=True)
