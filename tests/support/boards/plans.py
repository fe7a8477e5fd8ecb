"""Small networks and hand-made plans for the tests of registers and costs.

Used by bench, deploy and support.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Plan, PopulationPart
from lava_vpr.deploy.registers.core_images import HostTables, core_images, host_tables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.encoding import draw_trains
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.random import presentation_keys
from lava_vpr.loihi import LOIHI_1_WEIGHT_BITS

RATES = tuple[NDArray[np.uint16], NDArray[np.uint64]]

NEEDS, LOAD = Needs(0, 0, 0, 0, 0, 0, 0), Load(0, 0, 0, 0, 0, 0, 0)


def fewest(bits: int) -> int:
    """Bits of a stored weight that hold so many."""
    return next(stored for stored in LOIHI_1_WEIGHT_BITS if stored >= bits)


def simple_plan(network: FixedNetwork, cores: int, seed: int = 0, chips: int = 2) -> Plan:
    """Equal parts of exc, inhibitory neurons away from theirs, input compartments on two cores, formats by chance."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(0, network.neurons, cores + 1).astype(int)
    inh_edges = np.linspace(0, network.inhibitory, cores + 1).astype(int)
    positions = [(k % chips, 3 * (k // chips) + 1) for k in range(2 * cores)]
    found = []
    for k, (first, last) in enumerate(pairwise(edges)):
        own = int(last - first)
        parts = [PopulationPart("exc", int(first), own, 0), PopulationPart("counters", int(first), own, own)]
        begin, end = inh_edges[(k + 1) % cores :][:2]
        parts.append(PopulationPart("inh", int(begin), int(end - begin), 2 * own))
        dense = rng.random(network.inputs) < rng.choice([0.0, 0.5, 1.0])
        chip, core = positions[k]
        found.append(CorePlan(chip, core, tuple(p for p in parts if p.size), dense, NEEDS, LOAD))
    if network.input_compartments:
        half = network.inputs // 2
        last_core = found.pop()
        at = sum(part.size for part in last_core.parts)
        found.append(
            replace(last_core, parts=(*last_core.parts, PopulationPart("inputs", 0, network.inputs - half, at)))
        )
        if half:
            chip, core = positions[cores]
            empty = np.zeros(network.inputs, bool)
            parts_ = (PopulationPart("inputs", network.inputs - half, half, 0),)
            found.append(CorePlan(chip, core, parts_, empty, NEEDS, LOAD))
    found = sorted((core for core in found if core.parts), key=lambda core: (core.chip, core.core))
    weight_bits, inhibition_bits = fewest(KAPOHO_BAY.stored_bits(network)), fewest(network.inhibition.bit_length() + 1)
    return Plan(network, KAPOHO_BAY, tuple(found), weight_bits, inhibition_bits, None, 0.0)


def random_network(seed: int, **changes: Any) -> FixedNetwork:
    """A small network that Loihi 1 can run, with what `changes` says; every other one is signed, and has biases."""
    rng = np.random.default_rng(seed)
    signed = bool(changes.pop("signed", rng.integers(0, 2)))
    bits = int(changes.pop("bits", rng.integers(1, 8)))
    inputs, neurons = changes.pop("size", (int(rng.integers(1, 40)), int(rng.integers(1, 24))))
    weights = rng.integers(0, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < rng.random())
    mean = max(1.0, float(weights.sum(axis=0).mean()) * rng.uniform(0.1, 0.6))
    if signed:
        weights *= rng.choice([-1, 1, 1, 1], weights.shape)
    bias_input = bool(rng.integers(0, 2))
    made = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=int(np.clip(mean, 1, 100000)),
        inhibition=int(rng.choice([0, 1, 10, 60, 100, 127])),
        inhibition_exponent=int(rng.integers(0, 3)),
        decay=int(rng.choice([0, 130, 2000, 4095])),
        steps=int(rng.integers(1, 40)),
        regular=bool(rng.integers(0, 2)) or bool(changes.get("bias_input", bias_input)),
        bias_input=bias_input,
    )
    made = replace(made, **changes)
    return replace(made, bias=random_biases(made, rng)) if signed and "bias" not in changes else made


def random_biases(network: FixedNetwork, rng: np.random.Generator) -> NDArray[np.int32]:
    """Biases of either sign, some of them 0, with which no neuron spikes by itself."""
    exponent = int(rng.integers(0, 3))
    highest = min(4095, network.highest_bias >> exponent)
    mantissas = rng.integers(-min(4095, highest + 50), highest + 1, network.neurons)
    return (mantissas * (rng.random(network.neurons) < 0.7) << exponent).astype(np.int32)


def chips_of(plan: Plan, images: Any = None, tables: HostTables | None = None, **changes: Any) -> Chips:
    """Chips that hold ``plan``, or other images or tables instead."""
    network = plan.network
    settings = {name: getattr(network, name) for name in ("steps", "silent_steps", "regular", "bias_input")} | changes
    return Chips.of(images or core_images(plan), tables or host_tables(plan), **settings)


def pictures(network: FixedNetwork, n: int, seed: int) -> RATES:
    rates = np.random.default_rng(seed + 1).integers(0, 40000, (n, network.inputs)).astype(np.uint16)
    return rates, presentation_keys(seed, "query", np.arange(n))


def busy_plan(**changes: Any) -> Plan:
    """Five bits, 30 inputs, 20 neurons, 4 cores with exc on two chips, much activity."""
    wanted = {"size": (30, 20), "bits": 5, "signed": False, "inhibition": 20, "steps": 30, "decay": 130} | changes
    return simple_plan(random_network(3, **wanted), 4, 5)


def trains_of(network: FixedNetwork, n: int, seed: int) -> Trains:
    """Every spike of ``n`` presentations, by the host's engine."""
    rates, keys = pictures(network, n, seed)
    _, _, film = count_spikes(network, rates, keys, raster=True)
    inputs = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
    return Trains(film, inputs, inhibitory_spikes(network, film))
