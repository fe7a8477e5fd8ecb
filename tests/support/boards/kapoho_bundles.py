"""Small bundles for Kapoho Bay, made of random networks, and what their programs are to answer.

Used by deploy.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from support.boards.host_programs import Made, write_bundle
from support.boards.plans import LOAD

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Needs, Plan, PopulationName, PopulationPart
from lava_vpr.deploy.bundle import core_files
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.loihi import HOST_SPIKES


def random_network(seed: int = 0, inputs: int = 30, neurons: int = 10, **changes: Any) -> FixedNetwork:
    """A network that spikes, with biases; a third of its weights are 0, a quarter of those of a signed one below."""
    rng = np.random.default_rng(seed)
    weights = rng.integers(1, 8, (inputs, neurons)) * (rng.random((inputs, neurons)) < 0.67)
    if changes.get("signed"):
        weights *= rng.choice([-1, 1, 1, 1], weights.shape)
    settings = {"bits": 3, "signed": False, "threshold": 90, "inhibition": 12, "inhibition_exponent": 0, "decay": 137}
    bias = rng.integers(-4095, 100, neurons).astype(np.int32) >> 4
    return FixedNetwork(weights.astype(np.int16), bias, **{**settings, "steps": 40, **changes})  # type: ignore[arg-type]


Place = tuple[PopulationName, int, int]
"""A population, its first neuron on a core, and how many."""


def with_counters(members: list[Place]) -> list[PopulationPart]:
    """The parts of a core whose excitatory neurons have their counters behind them."""
    parts, compartment = [], 0
    for population, first, size in members:
        for name in ("exc", "counters") if population == "exc" else (population,):
            parts.append(PopulationPart(name, first, size, compartment))  # type: ignore[arg-type]
            compartment += size
    return parts


def plan_by_hand(network: FixedNetwork, cores: dict[tuple[int, int], list[Place]], dense: float = 0.5) -> Plan:
    """Neurons where ``cores`` (chip, core) says, counters behind them; a part ``dense`` of the inputs' rows."""
    made = []
    for (chip, core), members in cores.items():
        parts = with_counters(members)
        compartment = sum(part.size for part in parts)
        rows = np.arange(network.inputs) % 8 < 8 * dense
        needs = Needs(compartment, None, None, None, None, None, None)
        made.append(CorePlan(chip, core, tuple(parts), rows, needs, LOAD))
    bits = network.inhibition.bit_length() + 1
    return Plan(network, KAPOHO_BAY, tuple(made), KAPOHO_BAY.stored_bits(network), bits, None, 0.0)


LAYOUTS: dict[str, dict[tuple[int, int], list[Place]]] = {
    "one core": {(0, 0): [("exc", 0, 10), ("inh", 0, 1), ("inputs", 0, 30)]},
    "two chips": {
        (0, 0): [("exc", 0, 4), ("inputs", 0, 9)],
        (0, 3): [("exc", 4, 1), ("inh", 0, 1), ("inputs", 9, 8)],
        (1, 1): [("exc", 5, 5), ("inputs", 17, 13)],
    },
    "apart": {
        (0, 1): [("exc", 0, 6)],
        (0, 2): [("exc", 6, 4)],
        (1, 0): [("inh", 0, 1)],
        (1, 5): [("inputs", 0, 30)],
    },
    "leaves": {
        (0, 1): [("exc", 0, 6), ("inh", 2, 2)],
        (0, 2): [("exc", 6, 4), ("inputs", 10, 20)],
        (1, 0): [("inh", 0, 2), ("inputs", 0, 10)],
    },
}
"""Ways to spread 10 neurons and 30 inputs; "apart" has a chip without exc, "leaves" is for three leaves and a root."""


def layout(name: str, network: FixedNetwork, dense: float = 0.5) -> Plan:
    """`LAYOUTS`, without input compartments where there are none."""
    cores = {
        core: [member for member in members if network.input_compartments or member[0] != "inputs"]
        for core, members in LAYOUTS[name].items()
    }
    return plan_by_hand(network, {core: members for core, members in cores.items() if members}, dense)


def make(folder: Path, plan: Plan, images: int = 5, traverses: int = 1, seed: int = 0) -> Made:
    """Write the bundle of ``plan`` with ``images`` random references of each of ``traverses``."""
    n, inputs = images * traverses, plan.network.inputs
    rates = (np.random.default_rng(seed + 1).random((n, inputs)) ** 3 * 20000).astype(np.uint16)
    shown, labels = (rates, presentation_keys(seed, "response", np.arange(n))), np.tile(np.arange(images), traverses)
    limits = {"host_spikes": HOST_SPIKES}
    files = core_files.network_files(plan)
    return write_bundle(folder / "bundle", "kapoho-bay", plan.network, files, shown, labels, limits=limits)
