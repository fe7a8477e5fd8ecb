"""Random small networks, each with the name (seed, group, block) that makes it again: inputs to LIF, and LIF to itself.

Lava's library has one du, dv, threshold, weight format and sign for a whole Process, so the networks of a group share
those, and run as blocks of one population side by side; blocks differ in all else.

Used by engine and support.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters, SignMode
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Recording, Synapses
from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT, STATE_LIMIT, THRESHOLD_LIMIT

GROUPS_OF_START, BLOCKS_OF_GROUP = 4, 25
"""Measured: more groups in fewer starts take no less time, fewer in more starts take longer."""

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


def events_of(network: GeneralNetwork, recording: Recording) -> dict[str, bool]:
    """What happened to the first population in a recorded run: u beyond 24 bits, v beyond its ends, a spike."""
    population = network.populations[0]
    constants = population.parameters.constants
    u, v, drive = (film[0].astype(np.int64) for film in (recording.film_u, recording.film_v, recording.film_drive))

    def decayed(x: NDArray[np.int64], keep: int) -> NDArray[np.int64]:
        """Of the step before."""
        before = np.concatenate([np.zeros_like(x[:1]), x[:-1]])
        if population.reset_interval:
            before[:: population.reset_interval] = 0
        return np.sign(before) * (np.abs(before) * keep >> DECAY_BITS)

    current = decayed(u, constants.keep_u) + (drive << INPUT_SHIFT)
    membrane = decayed(v, constants.keep_v) + u + population.bias
    return {
        "exactly 2^23": bool((np.abs(current) == STATE_LIMIT).any()),
        "wrapped": bool(((current > STATE_LIMIT) | (current <= -STATE_LIMIT)).any()),
        "saturated": bool((np.abs(membrane) >= STATE_LIMIT).any()),
        "spiked": bool(recording.spikes[0].any()),
    }
