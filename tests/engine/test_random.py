"""Random numbers and the spikes drawn from them, their statistics; spikes of inputs that integrate a bias."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from lava_vpr.engine import random
from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import LEVEL, bias_input_spikes, biases, schedule, start_membranes
from lava_vpr.engine.random import presentation_key, presentation_keys
from lava_vpr.engine.rates import draw_spikes, rates16

INPUTS = 784
STEPS = 350
_MASK = (1 << 64) - 1


def key(role: str = "query", image: int = 3, epoch: int = 0, seed: int = 0) -> int:
    return random.presentation_key(seed, role, image, epoch)


def test_compiled_and_python_mix_agree() -> None:
    for x in (0, 1, 2**63, 2**64 - 1, 0x123456789ABCDEF):
        assert int(random.mix(np.uint64(x))) == random._mix(x)


@pytest.mark.parametrize("role", random.ROLES)
def test_keys_of_many_images_are_those_of_each(role: str) -> None:
    images = np.array([0, 1, 499, -1, 2**63 - 1, -(2**63), *np.random.default_rng(0).integers(-(2**63), 2**63 - 1, 50)])
    for seed, epoch in ((0, 0), (7, 3), (2**63 - 1, 1)):
        keys = random.presentation_keys(seed, role, images, epoch)
        assert keys.dtype == np.uint64
        assert keys.tolist() == [random.presentation_key(seed, role, int(i), epoch) for i in images]
    assert random.presentation_keys(0, role, images[:0]).shape == (0,)


def literal_image_key(rates: np.ndarray) -> int:
    """`random.image_keys` of one image, in Python's integers."""
    words = (random._mix(int(random.GOLDEN) * ((j << 32) + r) & _MASK) for j, r in enumerate(rates.tolist()) if r)
    return sum(words) & _MASK


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32])
def test_an_image_key_is_the_defined_sum(dtype: type) -> None:
    rng = np.random.default_rng(0)
    most = np.iinfo(dtype).max
    rates = rng.integers(0, most, (20, INPUTS), endpoint=True).astype(dtype) * (rng.random((20, INPUTS)) < 0.4)
    rates[0], rates[1] = 0, most
    for width in (INPUTS, 1, 0):
        keys = random.image_keys(rates[:, :width])
        assert keys.dtype == np.uint64
        assert keys.tolist() == [literal_image_key(row[:width]) for row in rates]
    assert random.image_keys(rates)[0] == 0
    assert random.image_keys(rates[:0]).shape == (0,)


def test_an_image_key_sees_rates_alone() -> None:
    """Not how wide they are stored, nor where the image stands; but which input has which rate."""
    rng = np.random.default_rng(1)
    rates = rng.integers(0, 3, (300, 40)).astype(np.uint16)
    keys = random.image_keys(rates)
    assert np.array_equal(random.image_keys(rates.astype(np.uint32)), keys)
    assert np.array_equal(random.image_keys(np.pad(rates, ((0, 0), (0, 9)))), keys)
    assert np.array_equal(random.image_keys(rates[::-1]), keys[::-1])
    assert len(set(keys.tolist())) == len(np.unique(rates, axis=0))
    one = np.tile(rng.integers(1, 60_000, 40).astype(np.uint16), (81, 1))
    one[np.arange(40), np.arange(40)] += 1
    one[np.arange(40, 80), np.arange(40)] = 0
    assert len(set(random.image_keys(one).tolist())) == 81
    swapped = one[80][np.r_[1, 0, 2:40]]
    assert random.image_keys(swapped[None])[0] != random.image_keys(one[80:])[0]


def test_a_draw_depends_on_its_own_coordinates_only() -> None:
    whole = random.draws(key(), STEPS, INPUTS)
    assert np.array_equal(whole[:7, :5], random.draws(key(), 7, 5))
    wide = random.draws(key(), 8, 5, bits=32)
    # Two 32-bit draws are the halves of the same hash that gives four 16-bit ones.
    assert np.array_equal(wide[0] & 0xFFFF, random.draws(key(), 1, 5)[0])


def test_keys_keep_roles_seeds_epochs_and_images_apart() -> None:
    combinations = list(itertools.product((0, 1, 2), ("train", "response", "query"), range(50), range(6)))
    keys = {random.presentation_key(s, r, i, e) for s, r, i, e in combinations}
    assert len(keys) == len(combinations)
    with pytest.raises(ValueError, match="role is 'test'"):
        random.presentation_key(0, "test", 0)


@pytest.mark.parametrize("unit", [np.uint16, np.uint32])
@pytest.mark.parametrize("steps", [1, 2, 30, 301])
@pytest.mark.parametrize("with_rate", [0, 1, 2, 5, 784])
def test_kernel_draws_the_defined_spikes(with_rate: int, steps: int, unit: type[np.integer]) -> None:
    rng, most = np.random.default_rng(with_rate), np.iinfo(unit).max
    rates = np.zeros(INPUTS, unit)
    rates[rng.choice(INPUTS, with_rate, replace=False)] = rng.integers(1, most, with_rate, unit, endpoint=True)
    rates[np.flatnonzero(rates)[:1]] = most
    expected = draw_spikes(rates, key(), steps)
    starts, members = poisson_spikes(rates, np.uint64(key()), steps)
    assert starts.tolist() == [0, *expected.sum(axis=1).cumsum()]
    assert members.tolist() == np.nonzero(expected)[1].tolist()


def test_rate_and_inter_spike_intervals_are_those_of_a_bernoulli_process() -> None:
    p = 0.02
    rates = np.full(INPUTS, round(p * 65536), np.uint16)
    spikes = np.concatenate([draw_spikes(rates, key(image=i), STEPS) for i in range(4)])
    n = spikes.size
    assert abs(spikes.sum() - n * p) < 4 * np.sqrt(n * p * (1 - p))
    intervals = np.concatenate([np.diff(np.flatnonzero(column)) for column in spikes.T])
    edges = np.arange(1, 100)
    observed = np.array([(intervals == k).sum() for k in edges])
    # Within a finite record short intervals fit more often: weigh each by the positions it can take.
    expected = p**2 * (1 - p) ** (edges - 1) * (len(spikes) - edges) * INPUTS
    assert stats.chisquare(observed, expected * observed.sum() / expected.sum()).pvalue > 1e-3


def test_draws_are_uniform_and_uncorrelated() -> None:
    values = random.draws(key(), 4000, 64).astype(np.float64) / 65536
    assert stats.kstest(values.ravel()[::7], "uniform").pvalue > 1e-3
    limit = 5 / np.sqrt(len(values))
    across_inputs = np.corrcoef(values.T) - np.eye(64)
    assert np.abs(across_inputs).max() < limit
    for lag in (1, 2, 3, 4, 8):
        r = np.corrcoef(values[:-lag].ravel(), values[lag:].ravel())[0, 1]
        assert abs(r) < 5 / np.sqrt(values.size)


@pytest.mark.parametrize(
    "other",
    [{"image": 4}, {"role": "response"}, {"role": "train"}, {"seed": 1}, {"role": "train", "epoch": 1}, {"image": -1}],
)
def test_images_roles_seeds_and_epochs_share_no_noise(other: dict) -> None:
    a = random.draws(key(), STEPS, INPUTS).ravel().astype(np.float64)
    b = random.draws(key(**other), STEPS, INPUTS).ravel().astype(np.float64)
    assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(a.size)


def test_expected_spikes_per_step_are_the_same_for_every_image() -> None:
    rng = np.random.default_rng(0)
    activity = (rng.random((3, INPUTS)) ** np.array([[1], [4], [9]])).astype(np.float32)
    activity[2, 5:] = 0
    rates = rates16(activity, 6.0)
    assert np.allclose(rates[:2].sum(axis=1) / 65536, 6.0, atol=0.02)
    assert rates[2].max() == 65535  # five inputs cannot bring six spikes a step: they saturate
    assert not rates16(np.zeros((1, INPUTS), np.float32), 6.0).any()


EVERY_RATE = np.arange(1 << 16).astype(np.uint16)


def test_biases_fit_the_registers_with_the_smallest_exponent() -> None:
    mantissa, exponent = biases(EVERY_RATE)
    assert mantissa.min() == 0
    assert mantissa.max() == 4095
    assert exponent.min() == 0
    assert exponent.max() == 7
    assert (mantissa[exponent > 0] >= 2048).all()
    bias = mantissa << exponent
    assert bias[0] == 0
    assert bias[1] > 0
    assert (np.diff(bias) >= 0).all()


def test_an_interval_is_the_nearest_whole_number() -> None:
    r = EVERY_RATE[1:].astype(np.int64)
    bias = np.left_shift(*biases(EVERY_RATE[1:]))
    exact = 2.0 * r * LEVEL / ((1 << 17) - r)
    lost = np.maximum(1 / exact, 2.0**-11)  # share of the bias that its whole mantissa of 12 bits may lose
    late = LEVEL // bias + 1 - 65536 / r
    assert (late > -0.5).all()
    assert (late <= 0.5 + 65536 / r * lost / (1 - lost)).all()
    usual = (r > 1000) & (r < 7000)
    assert np.abs(late[usual]).max() < 0.55


@pytest.mark.parametrize("rate", [0, 300, 836, 2000, 21_845, 32_768, 65_535])
def test_the_mean_count_is_the_rate(rate: int) -> None:
    steps, inputs = 350, 4000
    key = presentation_key(0, "query", rate)
    trains = bias_input_spikes(np.full(inputs, rate, np.uint16), key, steps)
    mean = trains.sum(axis=0).mean()
    assert mean == pytest.approx(steps * rate / 65_536, rel=0.02)
    if rate <= 2000:  # of the rates that images give, no step has more than its share
        assert np.abs(trains.mean(axis=1) - rate / 65_536).max() < 0.02
    for train in trains.T[:50]:
        assert len(set(np.diff(np.flatnonzero(train)).tolist())) <= 1


def test_phases_differ_between_keys_and_inputs() -> None:
    keys = presentation_keys(3, "query", np.arange(6))
    drawn = np.array([start_membranes(int(key), 1500) for key in keys])
    assert drawn.min() >= 0
    assert drawn.max() < LEVEL
    for row in drawn:
        assert len(np.unique(row)) > 1480
        assert row.mean() == pytest.approx(LEVEL / 2, rel=0.05)
        assert row.std() == pytest.approx(LEVEL / 12**0.5, rel=0.05)
    correlation = np.corrcoef(drawn) - np.eye(6)
    assert np.abs(correlation).max() < 0.1
    assert np.array_equal(start_membranes(int(keys[0]), 40), drawn[0, :40])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    rates=st.lists(st.one_of(st.integers(0, 65_535), st.sampled_from([0, 1, 65_535])), min_size=1, max_size=12),
    image=st.integers(0, 10_000),
    steps=st.integers(1, 300),
)
def test_the_compiled_schedule_is_the_definition(rates: list[int], image: int, steps: int) -> None:
    values, key = np.array(rates, np.uint16), presentation_key(1, "query", image)
    starts, members = schedule(np.left_shift(*biases(values)), np.uint64(key), steps)
    expected = bias_input_spikes(values, key, steps)
    assert starts[0] == 0
    assert starts[-1] == len(members) == expected.sum()
    for step in range(steps):
        assert members[starts[step] : starts[step + 1]].tolist() == np.flatnonzero(expected[step]).tolist()
