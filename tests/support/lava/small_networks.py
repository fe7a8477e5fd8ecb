"""Random place networks with numbers of the size that trained ones have, for the tests of Processes.

Used by engine and processes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lava_vpr.engine.inference.fixed import FixedNetwork


def random_network(bits: int, seed: int = 0, **changes: int) -> FixedNetwork:
    """Spikes now and then, with numbers of the size that trained networks have."""
    rng = np.random.default_rng(100 * seed + bits)
    inputs, neurons = int(rng.integers(40, 60)), int(rng.integers(5, 12))
    weights = rng.integers(0, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < 0.8)
    threshold = int(weights.sum(axis=0).mean() * 0.5)
    shift = min(int(rng.integers(0, 4)), max(0, threshold // 8).bit_length() - 1)
    inhibition, exponent = int((threshold >> shift) * rng.uniform(0.3, 1.2)), 0
    while inhibition > 255:
        inhibition, exponent = inhibition // 2, exponent + 1
    decay, steps = int(rng.integers(60, 400)), int(rng.integers(30, 60))
    network = FixedNetwork(
        weights.astype(np.uint8), bits, shift, threshold >> shift, inhibition, exponent, decay, steps
    )
    return replace(network, **changes)
