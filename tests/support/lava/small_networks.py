"""Random place networks with numbers of the size that trained ones have, for the tests of Processes.

Used by deploy, processes and support.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.neuron_bias import bias_registers
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT

SMALL_LIMITS = {"FAN_IN": 4, "DIRECT": 3}
"""`limits` with which five neurons need leaves and relays."""


@contextmanager
def limits(**numbers: int) -> Iterator[None]:
    """`fixed.FAN_IN` and `fixed.DIRECT` as given, for every network that is made and run meanwhile."""
    with ExitStack() as stack:
        for name, number in numbers.items():
            stack.enter_context(mock.patch.object(fixed, name, number))
        yield


def random_bias(rng: np.random.Generator, network: FixedNetwork) -> NDArray[np.int32]:
    """Biases of both signs that ``network`` may have."""
    most = min(network.highest_bias, ((1 << BIAS_BITS) - 1) << BIAS_EXPONENT_LIMIT)
    mantissas, exponent = bias_registers(rng.integers(-most, most + 1, network.neurons))
    return (mantissas << exponent).astype(np.int32)


def random_network(bits: int, seed: int = 0, **changes: Any) -> FixedNetwork:
    """Spikes now and then, with numbers of the size that trained networks have."""
    rng = np.random.default_rng(100 * seed + bits)
    inputs, neurons, signed = int(rng.integers(40, 60)), int(rng.integers(5, 12)), bool(changes.get("signed"))
    weights = rng.integers(0, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < 0.8)
    threshold = max(2, int(weights.sum(axis=0).mean() * (0.25 if signed else 0.5)))
    if signed:
        weights = weights * rng.choice([-1, 1], weights.shape, p=[0.3, 0.7])
    inhibition, exponent = int(threshold * rng.uniform(0.3, 1.2)), 0
    while inhibition > 255:
        inhibition, exponent = inhibition // 2, exponent + 1
    decay, steps = int(rng.integers(60, 400)), int(rng.integers(30, 60))
    network = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=threshold,
        inhibition=inhibition,
        inhibition_exponent=exponent,
        decay=decay,
        steps=steps,
    )
    network = replace(network, **changes)
    return network if "bias" in changes else replace(network, bias=random_bias(rng, network))
