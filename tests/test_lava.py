"""The host engine against Lava's own library: the same network wired from its LIFReset and Dense, spike for spike."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lava_vpr.encoding import draw_spikes
from lava_vpr.engine.fixed import SILENT_STEPS, FixedNetwork, count_spikes
from lava_vpr.engine.random import presentation_keys

IMAGES, STEPS = 3, 60


@pytest.mark.parametrize(("bits", "shift", "threshold"), [(1, 0, 12), (3, 0, 60), (3, 1, 30), (8, 5, 60)])
def test_every_spike_equals_lavas_library(bits: int, shift: int, threshold: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(bits)
    weights = (rng.integers(0, 1 << bits, (60, 12)) * (rng.random((60, 12)) < 0.6)).astype(np.uint8)
    network = FixedNetwork(weights, bits, shift, threshold, min(255, threshold), 0, 137, STEPS)
    network.check()
    rates = rng.integers(0, 12_000, (IMAGES, 60)).astype(np.uint16)
    keys = presentation_keys(0, "query", np.arange(IMAGES))
    counts, _, film = count_spikes(network, rates, keys, raster=True)
    spikes = np.zeros((IMAGES, STEPS + SILENT_STEPS, 60), bool)
    for image in range(IMAGES):
        spikes[image, :STEPS] = draw_spikes(rates[image], int(keys[image]), STEPS)
    np.savez(
        tmp_path / "in.npz",
        weights=weights,
        spikes=spikes,
        bits=bits,
        shift=shift,
        threshold=threshold,
        lateral=network.lateral,
        decay=network.decay,
    )
    script = Path(__file__).with_name("lava_network.py")
    # A child process with a time limit: an error inside Lava can hang the process that runs it.
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(script), "in.npz", "out.npz"],
        cwd=tmp_path,
        timeout=120,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0
    raster = np.load(tmp_path / "out.npz")["raster"]
    assert counts.sum() > 30
    assert (counts > 0).sum() > 6
    assert np.array_equal(film, raster)
