"""Random place networks, each with the name (seed, start, network) that makes it again.

The networks of one start of Lava share their input spikes. Some could wrap their currents, and do: `FixedNetwork.check`
refuses those, but the arithmetic has to be equal there, too.

Used by engine and support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.encoding import draw_spikes
from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.loihi import WEIGHT_LIMIT

NETWORKS_OF_START = 4


def fused_of(start: int, numbers: Sequence[int]) -> int:
    """The network of a start that also runs as one fused Process, which takes a start of Lava of its own."""
    return numbers[start % len(numbers)]


class UncheckedNetwork(FixedNetwork):
    """Not refused by the Processes, whatever it overflows."""

    def check(self, *args: object, **kwargs: object) -> None:
        """Fine."""


@dataclass(frozen=True)
class PlaceInput:
    """Presentations: rates uint16 (n, inputs), keys uint64 (n,), and their steps."""

    rates: NDArray[np.uint16]
    keys: NDArray[np.uint64]
    steps: int

    @property
    def trains(self) -> NDArray[np.bool_]:
        """Input spikes of all presentations in a row, the silent steps included, bool (n (steps + 3), inputs)."""
        silence = np.zeros((SILENT_STEPS, self.rates.shape[1]), bool)
        drawn = [draw_spikes(rates, int(key), self.steps) for rates, key in zip(self.rates, self.keys, strict=True)]
        return np.concatenate([part for train in drawn for part in (train, silence)])


def input_of(seed: int, start: int) -> PlaceInput:
    """Two or three presentations; every second start has so many inputs that excitation can wrap."""
    rng = np.random.default_rng([seed, start, 3])
    wide = start % 2 == 1
    n, inputs = int(rng.integers(2, 4)), int(rng.integers(560, 800) if wide else rng.integers(1, 60))
    steps = int(rng.integers(10, 24))
    most = rng.choice([2_000, 12_000, 65_535], n) if not wide else rng.choice([8_000, 65_535], n)
    rates = rng.integers(0, most[:, None] + 1, (n, inputs)).astype(np.uint16)
    if wide:
        rates[-1] = 65_535
    return PlaceInput(rates, presentation_keys(seed, "query", np.arange(n) + 10 * start), steps)


def place_of(seed: int, start: int, number: int) -> UncheckedNetwork:
    """One network, whatever others run beside it."""
    given = input_of(seed, start)
    rng = np.random.default_rng([seed, start, number, 4])
    inputs, neurons = given.rates.shape[1], int(rng.integers(1, 17))
    bits, shift = 1 + (NETWORKS_OF_START * start + number) % 8, int(rng.integers(0, 8))
    inhibition, exponent = int(rng.integers(0, WEIGHT_LIMIT + 1)), int(rng.integers(0, 4))
    sparse = rng.choice([0.1, 0.5, 1.0])
    if number == 1:  # inhibition that wraps as soon as most spike together
        neurons, inhibition, exponent, shift = int(rng.integers(8, 17)), WEIGHT_LIMIT, 7, 0
    if number == 3:  # as much as wraps nothing
        neurons, inhibition, exponent = int(rng.integers(3, 6)), WEIGHT_LIMIT, 7
    if number == 2 and inputs > 500:  # excitation that does
        bits, shift, sparse = 8, 0, 1.0
    weights = rng.integers(0, 1 << bits, (inputs, neurons))
    weights[rng.random(weights.shape) < rng.choice([0.0, 0.1, 0.8])] = (1 << bits) - 1
    weights[rng.random(weights.shape) >= sparse] = 0
    mean = float((weights * (given.rates.mean(axis=0) / 65_536)[:, None]).sum(axis=0).mean()) / (1 << shift)
    threshold = int(np.clip(mean * rng.choice([0.1, 1.0, 5.0]), 1, 131_071))
    decay = int(rng.choice([0, 137, 4095, 4096, rng.integers(300), rng.integers(4096)]))
    return UncheckedNetwork(weights.astype(np.uint8), bits, shift, threshold, inhibition, exponent, decay, given.steps)
