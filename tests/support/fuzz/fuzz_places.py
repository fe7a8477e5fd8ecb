"""Random place networks, each with the name (seed, start, network) that makes it again.

The networks of one start of Lava share their input spikes. Some could wrap their currents, and do: `FixedNetwork.check`
refuses those, but the arithmetic has to be equal there, too.

Used by engine and support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from support.lava.small_networks import random_bias

from lava_vpr.encoding import draw_trains
from lava_vpr.engine.inference.fixed import FixedNetwork, silent_steps
from lava_vpr.engine.random import presentation_keys
from lava_vpr.loihi import WEIGHT_LIMIT

NETWORKS_OF_START = 4
SILENT = silent_steps(1, False)
"""Silent steps of networks as small as these."""


def fused_of(start: int, numbers: Sequence[int]) -> int:
    """The network of a start that also runs as one fused Process, which takes a start of Lava of its own."""
    return numbers[start % len(numbers)]


class UncheckedNetwork(FixedNetwork):
    """Not refused by the Processes, whatever it overflows."""

    def check(self, *args: object, **kwargs: object) -> None:
        """Fine."""


@dataclass(frozen=True)
class PlaceInput:
    """Presentations: rates uint16 (n, inputs), keys uint64 (n,), their steps, and whether inputs spike regularly."""

    rates: NDArray[np.uint16]
    keys: NDArray[np.uint64]
    steps: int
    regular: bool

    @property
    def trains(self) -> NDArray[np.bool_]:
        """Input spikes of all presentations in a row, the silent steps included, bool (n (steps + 3), inputs)."""
        drawn = draw_trains(self.rates, self.keys, self.steps, self.steps + SILENT, regular=self.regular)
        return drawn.reshape(-1, self.rates.shape[1]).astype(bool)


def input_of(seed: int, start: int) -> PlaceInput:
    """Two or three presentations; every second start has so many inputs that excitation can wrap."""
    rng = np.random.default_rng([seed, start, 3])
    wide = start % 2 == 1
    n, inputs = int(rng.integers(2, 4)), int(rng.integers(1100, 1400) if wide else rng.integers(1, 60))
    steps = int(rng.integers(10, 24))
    most = rng.choice([2_000, 12_000, 65_535], n) if not wide else rng.choice([8_000, 65_535], n)
    rates = rng.integers(0, most[:, None] + 1, (n, inputs)).astype(np.uint16)
    if wide:
        rates[-1] = 65_535
    return PlaceInput(rates, presentation_keys(seed, "query", np.arange(n) + 10 * start), steps, start % 4 > 1)


def place_of(seed: int, start: int, number: int) -> UncheckedNetwork:
    """One network, whatever others run beside it."""
    given = input_of(seed, start)
    rng = np.random.default_rng([seed, start, number, 4])
    inputs, neurons = given.rates.shape[1], int(rng.integers(1, 17))
    signed = bool(rng.integers(2))
    bits = 1 + (NETWORKS_OF_START * start + number) % (8 - signed)
    inhibition, exponent = int(rng.integers(0, WEIGHT_LIMIT + 1)), int(rng.integers(0, 4))
    sparse = rng.choice([0.1, 0.5, 1.0])
    if number == 1:  # the most inhibition
        inhibition, exponent = WEIGHT_LIMIT, 7
    if number == 2 and inputs > 500:  # excitation that wraps
        signed, bits, sparse = False, 8, 1.0
    if number == 3 and inputs > 500:  # what wraps below, with the inhibition
        signed, bits, sparse, inhibition, exponent = True, 7, 1.0, WEIGHT_LIMIT, 7
    weights = rng.integers(0, 1 << bits, (inputs, neurons))
    highest = 0.8 if number == 3 else rng.choice([0.0, 0.1, 0.8])
    weights[rng.random(weights.shape) < highest] = (1 << bits) - 1
    weights[rng.random(weights.shape) >= sparse] = 0
    if signed:
        weights = weights * np.where(rng.random(weights.shape) < rng.choice([0.02, 0.4, 0.98]), -1, 1)
    mean = abs(float((weights * (given.rates.mean(axis=0) / 65_536)[:, None]).sum(axis=0).mean()))
    threshold = int(np.clip(mean * rng.choice([0.1, 1.0, 5.0]), 1, 131_071))
    decay = int(rng.choice([0, 137, 4095, 4096, rng.integers(300), rng.integers(4096)]))
    own = UncheckedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=threshold,
        inhibition=inhibition,
        inhibition_exponent=exponent,
        decay=decay,
        steps=given.steps,
        regular=given.regular,
    )
    return replace(own, bias=random_bias(rng, own))
