"""Random small networks, each with the numbers that make it again: general ones, and place networks.

A general network, (seed, group, block), has inputs to LIF, and LIF to itself. Lava's library has one du, dv, threshold,
weight format and sign for a whole Process, so the networks of a group share those, and run as blocks of one population
side by side; blocks differ in all else. Place networks, (seed, start, network), of one start of Lava share their input
spikes. Some could wrap their currents, and do: `FixedNetwork.check` refuses those, but the arithmetic has to be equal
there, too.

Used by engine and support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from support.lava.small_networks import random_bias

from lava_vpr.engine.general.lif import LifParameters, SignMode
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses
from lava_vpr.engine.inference.fixed import FixedNetwork, silent_steps
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.loihi import THRESHOLD_LIMIT, WEIGHT_LIMIT

GROUPS_OF_START, BLOCKS_OF_GROUP = 4, 25
"""Measured: more groups in fewer starts take no less time, fewer in more starts take longer."""

KINDS = ("ours", "library")
"""By whose Processes Lava runs a network."""

MODES: tuple[SignMode, ...] = ("null", "mixed", "excitatory", "inhibitory")
INPUTS_MOST, NEURONS_MOST = 12, 8
"""With these no current leaves 32 bits: where sums do, Lava's own arithmetic is numpy's, and nobody's specification."""


@dataclass(frozen=True)
class Format:
    """Of all weights of one Dense."""

    bits: int
    exponent: int
    sign: SignMode


@dataclass(frozen=True)
class Settings:
    """What the networks of a group share."""

    du: int
    dv: int
    vth: int
    forward: Format
    back: Format


@dataclass(frozen=True)
class Block:
    """One network, its name, and its input spikes, bool (steps, inputs)."""

    name: str
    network: GeneralNetwork
    train: NDArray[np.bool_]


def steps_of(seed: int, group: int) -> tuple[int, ...]:
    """After how many steps the states of this group are looked at; the last is the end. Equal for one start of Lava."""
    rng = np.random.default_rng([seed, group // GROUPS_OF_START, 0])
    end = int(rng.integers(30, 61))
    return (*sorted(int(x) for x in rng.choice(np.arange(2, end), 2, replace=False)), end)


def _decay(rng: np.random.Generator) -> int:
    """0, 1, 4095, a slow one or any."""
    return int(rng.choice([0, 1, 4094, 4095, rng.integers(300), rng.integers(300), *rng.integers(0, 4096, 3)]))


def _format(rng: np.random.Generator) -> Format:
    return Format(int(rng.integers(1, 9)), int(rng.integers(-7, 8)), MODES[int(rng.integers(4))])


def at_the_edge(group: int) -> bool:
    """Whether the currents of this group meet exactly +-2^23, and wrap there or not."""
    return group % 8 == 3


def settings_of(seed: int, group: int) -> Settings:
    """What all networks of a group share."""
    rng = np.random.default_rng([seed, group, 1])
    if at_the_edge(group):
        forward, back = Format(int(rng.integers(1, 9)), 7, "mixed"), Format(int(rng.integers(1, 9)), -7, "inhibitory")
        return Settings(4095, _decay(rng), int(rng.integers(THRESHOLD_LIMIT)), forward, back)
    vth = int(rng.choice([0, 1, THRESHOLD_LIMIT - 1, *(THRESHOLD_LIMIT ** rng.random(6)).astype(int)]))
    return Settings(_decay(rng), _decay(rng), min(vth, THRESHOLD_LIMIT - 1), _format(rng), _format(rng))


def _weights(rng: np.random.Generator, shape: tuple[int, int], sign: SignMode) -> NDArray[np.int64]:
    """Whole weights of that sign, some 0, some of the largest."""
    size = rng.integers(0, 256, shape)
    size[rng.random(shape) < rng.choice([0.0, 0.2, 0.7])] = 0
    size[rng.random(shape) < rng.choice([0.0, 0.1, 0.6])] = 255
    if rng.random() < 0.2:  # sums that meet thresholds and the ends of u exactly
        size = 128 * rng.integers(0, 2, shape)
    if sign == "inhibitory":
        return -size
    if sign == "mixed":
        size = np.where(rng.random(shape) < rng.choice([0.1, 0.5, 0.9]), -size, size)
        size[rng.random(shape) < rng.choice([0.0, 0.1, 0.5])] = -256
    return size


def block_of(seed: int, group: int, block: int) -> Block:
    """One network, whatever others run beside it."""
    own, steps = settings_of(seed, group), steps_of(seed, group)[-1]
    rng = np.random.default_rng([seed, group, block, 2])
    inputs, n = int(rng.integers(1, INPUTS_MOST + 1)), int(rng.integers(1, NEURONS_MOST + 1))
    train = rng.random((steps, inputs)) < rng.choice([0.0, 1.0, *rng.random(8)])
    mantissa, exponent = rng.integers(-4096, 4096, n), rng.integers(-7, 8, n)
    mantissa[rng.random(n) < 0.1] = 4095
    mantissa[rng.random(n) < 0.1] = -4096
    mantissa[rng.random(n) < rng.choice([0.0, 0.5, 1.0])] = 0
    population = Population(np.full(n, own.vth), mantissa, exponent, LifParameters(own.du, own.dv))
    synapses = [
        Synapses(source, 0, _weights(rng, (pre, n), form.sign), form.bits, form.exponent, form.sign)
        for source, pre, form in ((INPUTS, inputs, own.forward), (0, n, own.back))
    ]
    if at_the_edge(group):
        weights = rng.choice([0, 128, -256], (inputs, n), p=[0.1, 0.6, 0.3])
        synapses = [replace(synapses[0], weights=weights), replace(synapses[1], weights=np.zeros((n, n), np.int64))]
    return Block(f"general {seed} {group} {block}", GeneralNetwork(inputs, (population,), tuple(synapses)), train)


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
