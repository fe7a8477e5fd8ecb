"""Random networks and shrunken boards, and what holds of every plan; for the tests of the partition.

Used by bench and deploy.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.registers.core_images import core_images, host_tables
from lava_vpr.engine.inference.fixed import FixedNetwork

LIMITS = ("compartments", "axons_in", "axons_out", "synapse_words", "profiles", "thresholds", "formats")


def network(
    neurons: int,
    inputs: int,
    *,
    bits: int = 3,
    share: float = 0.42,
    inhibition: int = 44,
    signed: bool = False,
    bias_input: bool = False,
    seed: int = 0,
) -> FixedNetwork:
    """Random weights, ``share`` of them not 0, half of them below 0 if ``signed``."""
    rng = np.random.default_rng(seed)
    weights = rng.integers(1, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < share)
    if signed:
        weights *= rng.choice([-1, 1], weights.shape)
    return FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=87,
        inhibition=inhibition,
        inhibition_exponent=0,
        decay=137,
        steps=61,
        regular=bias_input,
        bias_input=bias_input,
    )


def even(made: FixedNetwork, spikes: float = 20.0) -> np.ndarray:
    return np.full(made.inputs, spikes / made.inputs)


def tiny(**limits: int) -> Board:
    """Kapoho Bay as one chip of four cores, with smaller limits."""
    return replace(KAPOHO_BAY, **{"chips": 1, "cores": 4, **limits})  # type: ignore[arg-type]


def words(synapses: int, bits: int) -> int:
    """Words of a row, block by block."""
    total = 0
    while synapses > 0:
        block = min(synapses, 64)
        total += -(-(block * bits + 10) // 64)
        synapses -= block
    return total


def check_plan(plan: Plan) -> None:
    """Every neuron stands once, every need is what the core's image holds, and every limit holds."""
    made, board = plan.network, plan.board
    sizes = {"exc": made.neurons, "inh": made.inhibitory, "inputs": made.input_compartments}
    for name, size in sizes.items():
        parts = [part for core in plan.cores for part in core.parts if part.population == name]
        assert sorted(i for part in parts for i in range(part.first, part.first + part.size)) == list(range(size))
    numbers = [(core.chip, core.core) for core in plan.cores]
    assert numbers == sorted(set(numbers))
    assert all(0 <= chip < board.chips and 0 <= core < board.cores for chip, core in numbers)
    for core in plan.cores:
        assert [part.compartment for part in core.parts] == list(
            itertools.accumulate([0, *(part.size for part in core.parts[:-1])])
        )
        for name in LIMITS:
            need, limit = getattr(core.needs, name), getattr(board, name)
            assert (need is None) == (limit is None)
            assert limit is None or 0 <= need <= limit, name


def check_images(plan: Plan) -> None:
    """Needs are what the core's registers and memory take."""
    for core, image in zip(plan.cores, core_images(plan), strict=True):
        used = [own for own in image.registers["synapseFmt"] if own is not None]
        assert core.needs.compartments == len(image.compartments)
        assert core.needs.axons_in == len(image.axons_in)
        assert core.needs.axons_out == len(image.axons_out)
        assert core.needs.synapse_words == len(image.synapses)
        assert core.needs.profiles == len(image.registers["cxProfileCfg"])
        assert core.needs.thresholds == len(image.registers["vthProfileCfg"])
        assert core.needs.formats == len(used)
    host_tables(plan)


def parts_of(total: int, cores: int) -> Iterator[tuple[int, ...]]:
    if cores == 1:
        yield (total,)
        return
    for first in range(total + 1):
        for rest in parts_of(total - first, cores - 1):
            yield first, *rest
