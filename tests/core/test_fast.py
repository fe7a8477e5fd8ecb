"""Preset ``fast``: what its settings do to rates and weights, and that what they leave alone stays as it was."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support.common.small_models import encoded, small_model

from lava_vpr.backends.deployed import BundleBackend
from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.interface import query_presentations
from lava_vpr.bench.sweep.points import mean
from lava_vpr.config import LifNetwork, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.compression.compression import requantised
from lava_vpr.deploy.mapping.limits import DEVIATIONS
from lava_vpr.encoding import query_rates, rates16, strongest
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import MEAN_WEIGHT, distinctive, equalise, pruned
from lava_vpr.errors import ConfigError
from lava_vpr.loihi import HOST_SPIKES
from lava_vpr.model import Model, assemble, content
from lava_vpr.training.loop import train

RESPONSES = arrays(np.float32, (3, 12), elements=st.floats(0, 4, width=32))
WEIGHTS = arrays(np.float32, (12, 4), elements=st.floats(0, 2, width=32))


def small_fast() -> Model:
    """Preset ``fast``, quickly trained on made-up places."""
    config = update(preset("fast"), {"stretch": 4, "learning": {"steps": 80, "epochs": 5}})
    return train([encoded(8)], config, jobs=2)


def test_the_defaults_change_nothing() -> None:
    rng = np.random.default_rng(0)
    activity, learned = rng.random((4, 1568)).astype(np.float32), rng.random((60, 5)).astype(np.float32)
    assert np.array_equal(query_rates(activity, preset("loihi")), rates16(activity, 20.0))
    assert np.array_equal(distinctive(learned, LifNetwork()), equalise(learned))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(RESPONSES, st.integers(0, 14))
def test_the_strongest_inputs_stay(activity: np.ndarray, count: int) -> None:
    result = strongest(activity, count)
    if count in (0, 12, 13, 14):
        assert np.array_equal(result, activity)
        return
    for row, kept in zip(activity, result, strict=True):
        least = sorted(row.tolist(), reverse=True)[count - 1]
        assert kept.tolist() == [value if value >= least else 0.0 for value in row.tolist()]


def test_a_query_brings_as_many_spikes_from_fewer_inputs() -> None:
    config, activity = preset("fast"), np.random.default_rng(0).random((5, 1568)).astype(np.float32)
    rates = query_rates(activity, config)
    assert (np.count_nonzero(rates, axis=1) == config.encoder.query_inputs).all()
    assert rates.sum(axis=1) / 65536 == pytest.approx(config.encoder.query_spikes, rel=1e-3)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(WEIGHTS, st.sampled_from([0.0, 0.5, 1.5]), st.sampled_from([0.0, 0.3, 0.8]))
def test_what_is_common_goes_and_then_the_smallest(learned: np.ndarray, common: float, prune: float) -> None:
    """Against the rule, one weight after another."""
    network = LifNetwork(common=common, prune=prune)
    learned = learned + np.eye(12, 4, dtype=np.float32) * 3  # so that every neuron has something of its own
    weights = equalise(learned)
    expected = np.zeros_like(weights)
    for i, row in enumerate(weights):
        for k, weight in enumerate(row):
            expected[i, k] = max(0.0, weight - common * sum(row) / len(row))
    for k in range(4):
        for i in sorted(range(12), key=lambda i: expected[i, k])[: round(prune * 12)]:
            expected[i, k] = 0.0
    result = distinctive(learned, network)
    kept = np.linalg.norm(expected, axis=0)
    assert np.allclose(result / np.linalg.norm(result, axis=0), expected / kept, atol=1e-9)
    assert np.allclose(np.linalg.norm(result, axis=0), np.linalg.norm(result[:, 0]))
    assert result.mean() == pytest.approx(MEAN_WEIGHT)


def test_nothing_of_its_own_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"network\.common 1 takes every weight off: all neurons"):
        distinctive(np.ones((6, 3), np.float32), LifNetwork(common=1.0))
    with pytest.raises(ConfigError, match=r"network\.prune is 1\.0, but must be in \[0, 1\)"):
        LifNetwork(prune=1.0)
    with pytest.raises(ConfigError, match=r"share of pruned weights is 1\.5"):
        pruned(np.ones((2, 2)), 1.5)


def test_models_from_before_these_settings_load() -> None:
    model = small_model()
    header, held = content(model)
    for section, name in (
        ("encoder", "query_inputs"),
        ("network", "common"),
        ("network", "prune"),
    ):
        del header["config"][section][name]
    loaded = assemble(Path("before.lvpr"), json.loads(json.dumps(header)), dict(held))
    assert loaded.config == model.config
    assert np.array_equal(query_rates(model.activity, loaded.config), query_rates(model.activity, model.config))


def test_quantised_anew_it_stays_the_same_and_prunes() -> None:
    model = small_fast()
    again = requantised(model)
    assert isinstance(model.network, FixedNetwork)
    assert isinstance(again.network, FixedNetwork)
    assert np.array_equal(again.network.weights, model.network.weights)
    assert np.array_equal(again.responses, model.responses)
    held = np.count_nonzero(model.network.weights, axis=0)
    less = requantised(dataclasses.replace(model, config=update(model.config, {"network": {"prune": 0.95}})))
    assert isinstance(less.network, FixedNetwork)
    left = np.count_nonzero(less.network.weights, axis=0)
    assert (left <= 1568 - round(0.95 * 1568)).all()
    assert (left < held).all()


def test_a_bundle_spikes_as_the_host_does() -> None:
    model = requantised(small_fast(), shift=0)
    queries = encoded(8, noise=0.3)
    shown = query_presentations(model, queries, 3)
    host, _ = HostBackend().count_spikes(model, shown)
    simulated, _ = BundleBackend().count_spikes(model, shown)
    assert host.any()
    assert np.array_equal(simulated, host)


def test_the_host_can_send_its_spikes() -> None:
    spikes = preset("fast").encoder.query_spikes
    assert spikes + DEVIATIONS * spikes**0.5 <= HOST_SPIKES
    assert len(plan_of(requantised(small_fast(), shift=0), KAPOHO_BAY).cores) == 1


def test_a_query_has_the_same_rates_in_any_batch() -> None:
    activity = np.random.default_rng(1).random((70, 1568)).astype(np.float32)
    together = query_rates(activity, preset("fast"))
    assert np.array_equal(together, np.concatenate([query_rates(row[None], preset("fast")) for row in activity]))


@pytest.mark.data
@pytest.mark.usefixtures("data_root")
def test_it_keeps_its_promise_on_real_images() -> None:
    """Nordland, five sections, seed 0, with the function that prints the benchmark; energy and time are modelled."""
    from benchmarks.fast import case, measure
    from benchmarks.nordland import SECTIONS

    found = mean([measure(case(section, preset("fast")))[0] for section in SECTIONS])
    assert found.metrics.recall_at_1 >= 0.85
    assert found.metrics.auc >= 0.83
    assert found.microjoules <= 1.0
    assert found.milliseconds <= 0.11
