"""The host engine against Lava's own library: the same network wired from its LIFReset and Dense, spike for spike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.nordland import encoded, learn, part
from lava_vpr.config import preset
from lava_vpr.encoding import draw_trains, rates16
from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork, count_spikes
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.isolated.runner import run_isolated

IMAGES, STEPS = 3, 60


def through_lava(cases: dict[str, tuple[FixedNetwork, NDArray[np.uint8]]]) -> dict[str, NDArray[np.int64]]:
    """The rasters (n, steps + 3, neurons) that Lava's library makes of each network and its input spikes (.., inputs).

    Nothing of this project runs there: spikes come from a RingBuffer and go into one.
    """
    names = ("bits", "shift", "threshold", "lateral", "decay")
    options = {case: {name: int(getattr(network, name)) for name in names} for case, (network, _) in cases.items()}
    arrays: dict[str, NDArray[Any]] = {}
    for case, (network, spikes) in cases.items():
        arrays |= {f"{case}_weights": network.weights, f"{case}_spikes": spikes}
    return run_isolated("support.lava.lava_network:present_each", arrays, options, timeout=240)


def test_every_spike_equals_lavas_library() -> None:
    cases, films = {}, {}
    for bits, shift, threshold in ((1, 0, 12), (3, 0, 60), (3, 1, 30), (8, 5, 60)):
        rng = np.random.default_rng(bits)
        weights = (rng.integers(0, 1 << bits, (60, 12)) * (rng.random((60, 12)) < 0.6)).astype(np.uint8)
        network = FixedNetwork(weights, bits, shift, threshold, min(255, threshold), 0, 137, STEPS)
        network.check()
        rates = rng.integers(0, 12_000, (IMAGES, 60)).astype(np.uint16)
        keys = presentation_keys(0, "query", np.arange(IMAGES))
        counts, _, film = count_spikes(network, rates, keys, raster=True)
        assert counts.sum() > 30
        assert (counts > 0).sum() > 6
        name = f"{bits} bits, shift {shift}"
        films[name] = film
        cases[name] = network, draw_trains(rates, keys, STEPS, STEPS + SILENT_STEPS)
    rasters = through_lava(cases)
    assert len(rasters) == 4
    for name, film in films.items():
        assert np.array_equal(film, rasters[name]), name


@pytest.mark.data
def test_the_trained_network_on_real_queries_equals_lavas_library(data_root: Path) -> None:
    config = preset("loihi")
    network = learn((0, 100), config).network
    assert isinstance(network, FixedNetwork)
    queries = part(encoded("winter", config.encoder), slice(0, 4))
    rates = rates16(queries.activity, config.encoder.query_spikes)
    keys = presentation_keys(0, "query", image_keys(rates))
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    assert (counts.sum(axis=1) > 10).all()
    spikes = draw_trains(rates, keys, network.steps, network.steps + SILENT_STEPS)
    assert np.array_equal(film, through_lava({"real": (network, spikes)})["real"])
