"""Small networks and hand-made plans for the tests of registers and costs.

Used by deploy.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Part, Plan
from lava_vpr.deploy.registers.core_images import HostTables, core_images, host_tables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.encoding import draw_trains
from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork, count_spikes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.trains import Trains
from lava_vpr.loihi import LOIHI_1_WEIGHT_BITS

RATES = tuple[NDArray[np.uint16], NDArray[np.uint64]]

NEEDS, LOAD = Needs(0, 0, 0, 0, 0, 0, 0), Load(0, 0, 0, 0, 0, 0, 0)


def fewest(value: int) -> int:
    """Bits of a stored weight that hold ``value``."""
    return next(bits for bits in LOIHI_1_WEIGHT_BITS if value >> bits == 0)


def simple_plan(network: FixedNetwork, cores: int, seed: int = 0, chips: int = 2) -> Plan:
    """Equal parts of exc, first relays away from their neurons, inputs on two cores, formats by chance."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(0, network.neurons, cores + 1).astype(int)
    positions = [(k % chips, 3 * (k // chips) + 1) for k in range(2 * cores)]
    found = []
    for k, (first, last) in enumerate(pairwise(edges)):
        parts = [Part("exc", int(first), int(last - first), 0)]
        if not (cores > 2 and k < 2):  # the relays of the first two cores stand on the third
            begin = 0 if cores > 2 and k == 2 else int(first)
            parts.append(Part("inh", begin, int(last) - begin, parts[0].size))
        dense = rng.random(network.inputs) < rng.choice([0.0, 0.5, 1.0])
        chip, core = positions[k]
        found.append(
            CorePlan(chip, core, tuple(p for p in parts if p.size), dense, bool(rng.random() < 0.5), NEEDS, LOAD)
        )
    if network.bias_input:
        half = network.inputs // 2
        last_core = found.pop()
        at = sum(part.size for part in last_core.parts)
        found.append(replace(last_core, parts=(*last_core.parts, Part("inputs", 0, network.inputs - half, at))))
        if half:
            chip, core = positions[cores]
            empty = np.zeros(network.inputs, bool)
            parts_ = (Part("inputs", network.inputs - half, half, 0),)
            found.append(CorePlan(chip, core, parts_, empty, False, NEEDS, LOAD))
    found = sorted((core for core in found if core.parts), key=lambda core: (core.chip, core.core))
    lateral = fewest(network.inhibition) if network.inhibition else 1
    return Plan(network, KAPOHO_BAY, tuple(found), fewest((1 << network.bits) - 1), lateral, None, 0.0)


def random_network(seed: int, **changes: Any) -> FixedNetwork:
    """A small network that Loihi 1 can run, with what `changes` says."""
    rng = np.random.default_rng(seed)
    bits = int(changes.pop("bits", rng.integers(1, 9)))
    inputs, neurons = changes.pop("size", (int(rng.integers(1, 40)), int(rng.integers(1, 24))))
    weights = rng.integers(0, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < rng.random())
    mean = max(1.0, float(weights.sum(axis=0).mean()) * rng.uniform(0.1, 0.6))
    made = FixedNetwork(
        weights=weights.astype(np.uint8),
        bits=bits,
        shift=0,
        threshold=int(np.clip(mean, 1, 100000)),
        inhibition=int(rng.choice([0, 1, 10, 60, 100, 255])),
        inhibition_exponent=int(rng.integers(0, 3)),
        decay=int(rng.choice([0, 130, 2000, 4095])),
        steps=int(rng.integers(1, 40)),
        bias_input=bool(rng.integers(0, 2)),
    )
    return replace(made, **changes)


def small_plan(**changes: Any) -> Plan:
    """Three neurons, two inputs: neurons 0 and 1 with all relays on one core, neuron 2 on another chip."""
    weights = np.array([[5, 6, 0], [0, 7, 0]], np.uint8)
    network = replace(FixedNetwork(weights, 3, 0, 9, 10, 1, 130, 20), **changes)
    dense = np.array([True, False])
    parts = [Part("exc", 0, 2, 0), Part("inh", 0, 3, 2)]
    if network.bias_input:
        parts.append(Part("inputs", 0, 2, 5))
    return Plan(
        network,
        KAPOHO_BAY,
        (
            CorePlan(0, 4, tuple(parts), dense, False, NEEDS, LOAD),
            CorePlan(1, 0, (Part("exc", 2, 1, 0),), dense, False, NEEDS, LOAD),
        ),
        3,
        4,
        None,
        0.0,
    )


def chips_of(plan: Plan, images: Any = None, tables: HostTables | None = None, **changes: Any) -> Chips:
    """Chips that hold ``plan``, or other images or tables instead."""
    network = plan.network
    settings = {"steps": network.steps, "silent_steps": SILENT_STEPS, "bias_input": network.bias_input} | changes
    return Chips.of(images or core_images(plan), tables or host_tables(plan), **settings)


def pictures(network: FixedNetwork, n: int, seed: int) -> RATES:
    rates = np.random.default_rng(seed + 1).integers(0, 40000, (n, network.inputs)).astype(np.uint16)
    return rates, presentation_keys(seed, "query", np.arange(n))


def busy_plan(**changes: Any) -> Plan:
    """Five bits, 30 inputs, 20 neurons, 4 cores with exc on two chips, much activity."""
    network = random_network(3, **({"size": (30, 20), "bits": 5, "inhibition": 20, "steps": 30} | changes))
    return simple_plan(network, 4, 5)


def trains_of(network: FixedNetwork, n: int, seed: int) -> Trains:
    """Every spike of ``n`` presentations, by the host's engine."""
    rates, keys = pictures(network, n, seed)
    _, _, film = count_spikes(network, rates, keys, raster=True)
    bias_input = network.bias_input
    return Trains(film, draw_trains(rates, keys, network.steps, film.shape[1], bias_input=bias_input))
