"""The host engine against Lava's own library: the same network wired from its LIFReset and Dense, spike for spike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.lava.small_networks import random_bias

from lava_vpr.encoding import draw_trains
from lava_vpr.engine.inference.fixed import FixedNetwork, count_spikes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.isolated.runner import run_isolated

IMAGES, STEPS = 3, 60


def through_lava(cases: dict[str, tuple[FixedNetwork, NDArray[np.uint8]]]) -> dict[str, NDArray[np.int64]]:
    """The rasters (n, interval, neurons) that Lava's library makes of each network and its input spikes (.., inputs).

    Nothing of this project runs there: spikes come from a RingBuffer and go into one.
    """
    options: dict[str, dict[str, int]] = {}
    arrays: dict[str, NDArray[Any]] = {}
    for case, (network, spikes) in cases.items():
        mantissas, exponent = network.bias_registers
        options[case] = network.scalars | {"bias_exponent": exponent}
        arrays |= {f"{case}_weights": network.weights, f"{case}_spikes": spikes, f"{case}_mantissas": mantissas}
    return run_isolated("support.lava.process_targets:present_each", arrays, options, timeout=240)


@pytest.mark.slow
@pytest.mark.lava
def test_every_spike_equals_lavas_library() -> None:
    cases, films = {}, {}
    for bits, signed, exponent in ((1, False, 0), (1, True, 0), (3, True, 1), (7, True, 3), (8, False, 4)):
        rng = np.random.default_rng(bits)
        weights = rng.integers(0, 1 << bits, (60, 12)) * (rng.random((60, 12)) < 0.6)
        threshold = (4 if signed else 12) << (bits - 1)
        if signed:
            weights = weights * rng.choice([-1, 1], weights.shape, p=[0.3, 0.7])
        network = FixedNetwork(
            weights=weights.astype(np.int16),
            bias=np.zeros(12, np.int32),
            bits=bits,
            signed=signed,
            threshold=threshold,
            inhibition=min(255, threshold),
            inhibition_exponent=exponent,
            decay=137,
            steps=STEPS,
        )
        network = replace(network, bias=random_bias(rng, network))
        network.check()
        rates = rng.integers(0, 12_000, (IMAGES, 60)).astype(np.uint16)
        keys = presentation_keys(0, "query", np.arange(IMAGES))
        counts, _, film = count_spikes(network, rates, keys, raster=True)
        assert counts.sum() > 30
        assert (counts > 0).sum() > 6
        name = f"{bits} bits, {'signed' if signed else 'unsigned'}"
        films[name] = film
        cases[name] = network, draw_trains(rates, keys, STEPS, network.interval)
    rasters = through_lava(cases)
    assert len(rasters) == 5
    for name, film in films.items():
        assert np.array_equal(film, rasters[name]), name
