"""Preset ``fast``: what its settings do to rates and weights, and that what they leave alone stays as it was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from support.common.small_models import encoded

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import LifNetwork, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.compression import requantised
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.mapping.sizing import DEVIATIONS
from lava_vpr.engine.inference.quantise import distinctive, unit_norm
from lava_vpr.engine.rates import query_rates, rates16, training_rates
from lava_vpr.loihi import HOST_SPIKES
from lava_vpr.model import Model
from lava_vpr.training.loop import train

WEIGHTS = arrays(np.float32, (12, 4), elements=st.floats(0, 2, width=32))


def small_fast() -> Model:
    """Preset ``fast``, quickly trained on made-up places."""
    config = update(preset("fast"), {"stretch": 4, "learning": {"steps": 80, "epochs": 5}})
    return train([encoded(8, config.encoder.inputs)], config, pool=Pool(2))


def test_what_is_not_asked_for_changes_nothing() -> None:
    rng = np.random.default_rng(0)
    activity, learned = rng.random((4, 2048)).astype(np.float32), rng.random((60, 5)).astype(np.float32)
    config = preset("loihi")
    assert np.array_equal(query_rates(activity, config), rates16(activity, 20.0, config.encoder.query_inputs))
    assert np.array_equal(distinctive(learned, LifNetwork(signed=False)), unit_norm(learned))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.sampled_from([1, 7, 12, 300, 2048, 9000]), st.integers(0, 14), st.booleans())
def test_rates_equal_the_literal_version(seed: int, inputs: int, count: int, alike: bool) -> None:
    activity = np.random.default_rng(seed).random((3, inputs)).astype(np.float32) * 4
    activity = np.round(activity) if alike else activity
    activity[2] = 0
    kept = activity
    if 0 < count < inputs:
        least = np.sort(activity, axis=1)[:, -count, None]
        kept = np.where(activity >= least, activity, np.float32(0))
    total = kept.sum(axis=1, keepdims=True, dtype=np.float64)
    share = np.divide(kept, total, out=np.zeros(kept.shape), where=total > 0)
    literal = np.minimum(np.round(share * (14.0 * 65536.0)), 65535.0).astype(np.uint16)
    assert np.array_equal(rates16(activity, 14.0, count), literal)


def test_a_query_brings_as_many_spikes_from_fewer_inputs() -> None:
    config, activity = preset("fast"), np.random.default_rng(0).random((5, 3072)).astype(np.float32)
    rates = query_rates(activity, config)
    assert (np.count_nonzero(rates, axis=1) == config.encoder.query_inputs).all()
    assert rates.sum(axis=1) / 65536 == pytest.approx(config.encoder.query_spikes, rel=1e-3)


@pytest.mark.parametrize("name", ["loihi", "fast", "accurate"])
def test_a_front_end_of_eight_orientations_learns_with_twelve_spikes(name: str) -> None:
    config = update(preset(name), {"encoder": {"kind": "frontend"}})
    rates = training_rates(np.random.default_rng(0).random((3, 2048)).astype(np.float32), config)
    assert rates.sum(axis=1) / 65536 == pytest.approx(12, rel=1e-3)
    assert preset(name).encoder.learning_spikes == 1.5 * preset(name).encoder.orientations


@settings(max_examples=30, deadline=None, derandomize=True)
@given(WEIGHTS, st.booleans(), st.sampled_from([0.0, 0.3, 0.8]))
def test_what_is_common_goes_and_then_the_smallest(learned: np.ndarray, signed: bool, prune: float) -> None:
    """Against the rule, one weight after another."""
    learned = learned + np.eye(12, 4, dtype=np.float32) * 3  # so that every neuron has something of its own
    weights = learned.astype(np.float64) / np.linalg.norm(learned.astype(np.float64), axis=0)
    expected = np.zeros_like(weights)
    for i, row in enumerate(weights):
        for k, weight in enumerate(row):
            expected[i, k] = weight - (sum(row) / len(row) if signed else 0.0)
    result = distinctive(learned, LifNetwork(signed=signed, prune=prune))
    for k in range(4):
        sizes = sorted(abs(expected[:, k]))
        kept = result[:, k] != 0
        assert kept.sum() <= 12 - round(prune * 12)
        assert abs(expected[kept, k]).min() >= sizes[round(prune * 12)] - 1e-9
        scale = np.linalg.norm(expected[kept, k])
        assert np.allclose(result[kept, k], expected[kept, k] / scale, atol=1e-9)
    assert np.allclose(np.linalg.norm(result, axis=0), 1.0)


def test_the_host_can_send_its_spikes() -> None:
    spikes = preset("fast").encoder.query_spikes
    assert spikes + DEVIATIONS * spikes**0.5 <= HOST_SPIKES
    assert len(plan_of(requantised(small_fast()), KAPOHO_BAY).cores) == 1


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.usefixtures("data_root")
def test_it_keeps_its_promise_on_real_images() -> None:
    """Nordland, five sections, seed 0, with the function that computes the results; energy and time are modelled."""
    from benchmarks.recall import TABLES
    from benchmarks.results.rows import measure

    row = TABLES["fast"][0]
    found = [measure(row, section, 0) for section in row.sections]
    recall, _, auc = np.mean([one["network"] for one in found], axis=0)
    microjoules, milliseconds = np.mean([one["costs"] for one in found], axis=0)
    assert recall >= 93.5
    assert auc >= 93
    assert microjoules <= 1.2
    assert milliseconds <= 0.3  # 0.12 of it is the embedded program's work
