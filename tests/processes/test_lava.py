"""The host engine against Lava's own library: the same network wired from its LIFReset and Dense, spike for spike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.nordland import encoded, learn, part
from lava_vpr.config import preset
from lava_vpr.encoding import draw_trains, rates16
from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork, count_spikes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.isolated.runner import run_isolated

IMAGES, STEPS = 3, 60


def through_lava(network: FixedNetwork, spikes: NDArray[np.uint8]) -> NDArray[np.int64]:
    """The raster (n, steps + 3, neurons) that Lava's library makes of input ``spikes`` (n, steps + 3, inputs).

    Nothing of this project runs there: spikes come from a RingBuffer and go into one.
    """
    options = {name: int(getattr(network, name)) for name in ("bits", "shift", "threshold", "lateral", "decay")}
    arrays = {"weights": network.weights, "spikes": spikes}
    return run_isolated("support.lava.lava_network:present", arrays, options, timeout=240)["raster"]


@pytest.mark.parametrize(("bits", "shift", "threshold"), [(1, 0, 12), (3, 0, 60), (3, 1, 30), (8, 5, 60)])
def test_every_spike_equals_lavas_library(bits: int, shift: int, threshold: int) -> None:
    rng = np.random.default_rng(bits)
    weights = (rng.integers(0, 1 << bits, (60, 12)) * (rng.random((60, 12)) < 0.6)).astype(np.uint8)
    network = FixedNetwork(weights, bits, shift, threshold, min(255, threshold), 0, 137, STEPS)
    network.check()
    rates = rng.integers(0, 12_000, (IMAGES, 60)).astype(np.uint16)
    keys = presentation_keys(0, "query", np.arange(IMAGES))
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    assert counts.sum() > 30
    assert (counts > 0).sum() > 6
    assert np.array_equal(film, through_lava(network, draw_trains(rates, keys, STEPS, STEPS + SILENT_STEPS)))


@pytest.mark.data
def test_the_trained_network_on_real_queries_equals_lavas_library(data_root: Path) -> None:
    config = preset("loihi")
    network = learn((0, 100), config).network
    assert isinstance(network, FixedNetwork)
    queries = part(encoded("winter", config.encoder), slice(0, 4))
    rates, keys = rates16(queries.activity, config.encoder.query_spikes), presentation_keys(0, "query", queries.indices)
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    assert (counts.sum(axis=1) > 10).all()
    assert np.array_equal(
        film, through_lava(network, draw_trains(rates, keys, network.steps, network.steps + SILENT_STEPS))
    )
