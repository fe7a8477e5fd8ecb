"""The host engine against Lava's own library: the same network wired from its LIFReset and Dense, spike for spike."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.nordland import encoded, part
from benchmarks.recall import learn
from lava_vpr.config import preset
from lava_vpr.encoding import draw_spikes, rates16
from lava_vpr.engine.fixed import SILENT_STEPS, FixedNetwork, count_spikes
from lava_vpr.engine.random import presentation_keys

IMAGES, STEPS = 3, 60


def through_lava(network: FixedNetwork, spikes: NDArray[np.bool_], folder: Path) -> NDArray[np.int64]:
    """The raster (n, steps + 3, neurons) that Lava's library makes of input ``spikes`` (n, steps + 3, inputs).

    In a child process with a time limit: an error inside Lava can hang the process that runs it.
    """
    np.savez(
        folder / "in.npz",
        weights=network.weights,
        spikes=spikes,
        bits=network.bits,
        shift=network.shift,
        threshold=network.threshold,
        lateral=network.lateral,
        decay=network.decay,
    )
    script = Path(__file__).with_name("lava_network.py")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(script), "in.npz", "out.npz"],
        cwd=folder,
        timeout=240,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0
    return np.asarray(np.load(folder / "out.npz")["raster"])


def input_spikes(rates: NDArray[np.uint16], keys: NDArray[np.uint64], steps: int) -> NDArray[np.bool_]:
    """Input spikes of presentations in turn, the silent steps included, bool (n, steps + 3, inputs)."""
    spikes = np.zeros((len(rates), steps + SILENT_STEPS, rates.shape[1]), bool)
    for image, (own, key) in enumerate(zip(rates, keys, strict=True)):
        spikes[image, :steps] = draw_spikes(own, int(key), steps)
    return spikes


@pytest.mark.parametrize(("bits", "shift", "threshold"), [(1, 0, 12), (3, 0, 60), (3, 1, 30), (8, 5, 60)])
def test_every_spike_equals_lavas_library(bits: int, shift: int, threshold: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(bits)
    weights = (rng.integers(0, 1 << bits, (60, 12)) * (rng.random((60, 12)) < 0.6)).astype(np.uint8)
    network = FixedNetwork(weights, bits, shift, threshold, min(255, threshold), 0, 137, STEPS)
    network.check()
    rates = rng.integers(0, 12_000, (IMAGES, 60)).astype(np.uint16)
    keys = presentation_keys(0, "query", np.arange(IMAGES))
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    assert counts.sum() > 30
    assert (counts > 0).sum() > 6
    assert np.array_equal(film, through_lava(network, input_spikes(rates, keys, STEPS), tmp_path))


@pytest.mark.data
def test_the_trained_network_on_real_queries_equals_lavas_library(data_root: Path, tmp_path: Path) -> None:
    config = preset("loihi")
    network = learn((0, 100), config).network
    assert isinstance(network, FixedNetwork)
    queries = part(encoded("winter", config.encoder), slice(0, 4))
    rates, keys = rates16(queries.activity, config.encoder.query_spikes), presentation_keys(0, "query", queries.indices)
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    assert (counts.sum(axis=1) > 10).all()
    assert np.array_equal(film, through_lava(network, input_spikes(rates, keys, network.steps), tmp_path))
