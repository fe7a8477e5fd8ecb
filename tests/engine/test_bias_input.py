"""Inputs that integrate a bias: their trains by every definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lava_vpr.engine.inference.biases import LEVEL, bias_input_spikes, biases, schedule, start_membranes
from lava_vpr.engine.random import presentation_key, presentation_keys

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
