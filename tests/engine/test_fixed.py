"""The integer network against a literal version, and its limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.literal.integers import present_fixed

from lava_vpr.encoding import draw_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork, count_spikes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.errors import NetworkLimitError


def random_network(seed: int, **changes: int) -> FixedNetwork:
    rng = np.random.default_rng(seed)
    bits = int(rng.integers(1, 9))
    inputs, neurons = int(rng.integers(1, 40)), int(rng.integers(1, 12))
    weights = rng.integers(0, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < rng.random())
    network = FixedNetwork(
        weights=weights.astype(np.uint8),
        bits=bits,
        shift=int(rng.integers(0, 6)),
        threshold=int(rng.integers(1, 60)),
        inhibition=int(rng.integers(0, 256)),
        inhibition_exponent=int(rng.integers(0, 10)),
        decay=int(rng.integers(0, 4097)),
        steps=int(rng.integers(1, 40)),
    )
    return dataclasses.replace(network, **changes)


def compare(network: FixedNetwork, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed + 1)
    rates = rng.integers(0, 40000, (2, network.inputs)).astype(np.uint16)
    keys = presentation_keys(seed, "query", np.arange(2))
    counts, events, film = count_spikes(network, rates, keys, raster=True)
    total = 0
    for image in range(2):
        spikes = draw_spikes(rates[image], int(keys[image]), network.steps)
        expected = present_fixed(network, spikes)
        assert np.array_equal(film[image], expected)
        assert np.array_equal(counts[image], expected.sum(axis=0))
        total += int(spikes.sum())
    assert events["input_spikes"] == total
    assert events["exc_spikes"] == events["inh_spikes"] == counts.sum()
    return counts


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**31))
def test_equals_the_literal_network(seed: int) -> None:
    compare(random_network(seed), seed)


def test_random_networks_spike_and_wrap_often_enough_to_mean_something() -> None:
    spiked = sum(bool(compare(random_network(seed), seed).any()) for seed in range(20))
    assert spiked >= 10
    # Enough lateral inhibition to pass 2^23 in u: the wrap of Lava's current is part of the arithmetic.
    wrapping = random_network(12, inhibition=255, inhibition_exponent=9, threshold=1)
    assert wrapping.lateral * (wrapping.neurons - 1) > 131_072
    assert compare(wrapping, 12).sum() > 20


def test_32_bit_accumulator_takes_over_where_16_bits_would_overflow() -> None:
    network = FixedNetwork(np.full((500, 2), 255, np.uint8), 8, 5, 2000, 5, 0, 100, 6)
    rates = np.full((1, 500), 40_000, np.uint16)
    keys = presentation_keys(0, "query", np.arange(1))
    spikes = draw_spikes(rates[0], int(keys[0]), network.steps)
    assert 255 * spikes.sum(axis=1).min() > 1 << 15
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    assert counts.any()
    assert np.array_equal(film[0], present_fixed(network, spikes))


def test_events_count_nonzero_synapses() -> None:
    rng = np.random.default_rng(0)
    weights = (rng.random((20, 4)) < 0.5).astype(np.uint8)
    network = FixedNetwork(weights, 1, 0, 3, 2, 0, 137, 25)
    rates = rng.integers(1000, 30000, (3, 20)).astype(np.uint16)
    keys = presentation_keys(0, "query", np.arange(3))
    _, events, _ = count_spikes(network, rates, keys)
    spikes = np.concatenate([draw_spikes(r, int(k), 25) for r, k in zip(rates, keys, strict=True)])
    fired = events["exc_spikes"]
    assert fired > 0
    assert events["synaptic_operations"] == int((spikes @ np.count_nonzero(weights, axis=1)).sum()) + fired + 3 * fired
    assert events["synaptic_operations_dense"] == int(spikes.sum()) * 4 + fired + 4 * fired
    assert events["messages"] == int(spikes.sum()) + 2 * fired
    assert events["steps"] == 3 * 28
    assert events["neuron_updates"] == 3 * 4 * 27 + fired


def test_threads_batches_and_order_do_not_matter() -> None:
    network = random_network(12, steps=50, threshold=5)
    rates = np.random.default_rng(1).integers(0, 20000, (65, network.inputs)).astype(np.uint16)
    ids = np.arange(65)
    keys = presentation_keys(0, "query", ids)
    whole, events, _ = count_spikes(network, rates, keys)
    assert whole.any()
    two, two_events, _ = count_spikes(network, rates, keys, threads=2)
    assert np.array_equal(whole, two)
    assert events == two_events
    singles = np.concatenate([count_spikes(network, rates[i : i + 1], keys[i : i + 1])[0] for i in ids])
    assert np.array_equal(whole, singles)
    order = np.random.default_rng(2).permutation(65)
    assert np.array_equal(count_spikes(network, rates[order], keys[order])[0], whole[order])
    empty, _, _ = count_spikes(network, rates[:0], keys[:0])
    assert empty.shape == (0, network.neurons)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inhibition": 255, "inhibition_exponent": 7}, r"can reach 163,200, but Loihi's .* at most 5 neurons"),
        ({"inhibition_exponent": 8}, r"inhibition_exponent 8 does not fit 0\.\.7"),
        ({"shift": 8}, r"shift 8 does not fit 0\.\.7"),
        ({"bits": 9}, "use 1 to 8 bits"),
        ({"threshold": 1 << 17}, "threshold 131072 does not fit"),
        ({"steps": 0}, "a presentation of 0 steps holds no input"),
        ({"inhibition": 256}, "inhibition mantissa 256 does not fit"),
    ],
)
def test_limits_are_refused(changes: dict, message: str) -> None:
    network = FixedNetwork(np.ones((5, 6), np.uint8), 3, 0, 87, 87, 0, 137, 5)
    with pytest.raises(NetworkLimitError, match=message):
        dataclasses.replace(network, **changes).check()


def test_excitation_that_could_overflow_is_refused() -> None:
    with pytest.raises(NetworkLimitError, match="weights of one neuron sum to 204,000"):
        FixedNetwork(np.full((800, 1), 255, np.uint8), 8, 0, 87, 87, 0, 137, 5).check()
