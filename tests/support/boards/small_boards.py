"""Random networks and shrunken boards, and what holds of every plan; for the tests of the partition.

Used by bench and deploy.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.boards.plan import CorePlan, Plan
from lava_vpr.deploy.registers.core_images import core_images, host_tables
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.loihi import CORE_SYNAPSE_WORDS

LIMITS = ("compartments", "axons_in", "axons_out", "synapse_words", "profiles", "thresholds", "formats")
ORDER = ["exc", "counters", "inh", "inputs"].index


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


def tiny(*, synapse_words: int = CORE_SYNAPSE_WORDS, **limits: int) -> Board:
    """Kapoho Bay as one chip of four cores without counters, with smaller limits."""
    limits = {"chips": 1, "cores": 4, "counters": False, **limits}
    return replace(KAPOHO_BAY, memory=PackedRows(synapse_words), **limits)  # type: ignore[arg-type]


def words(synapses: int, bits: int) -> int:
    """Words of a row, block by block."""
    total = 0
    while synapses > 0:
        block = min(synapses, 64)
        total += -(-(block * bits + 10) // 64)
        synapses -= block
    return total


def listened(made: FixedNetwork, inh: int) -> list[tuple[str, int]]:
    """Whom inhibitory neuron ``inh`` listens to."""
    if made.leaves and inh == made.leaves:
        return [("inh", leaf) for leaf in range(made.leaves)]
    first = fixed.FAN_IN * inh
    last = min(made.neurons, first + fixed.FAN_IN) if made.leaves else made.neurons
    return [("exc", neuron) for neuron in range(first, last)]


def numbers(core: CorePlan, population: str) -> list[int]:
    """The neurons of ``population`` on ``core``."""
    return [
        i for part in core.parts if part.population == population for i in range(part.first, part.first + part.size)
    ]


def literal_needs(plan: Plan, core: CorePlan) -> dict[str, int]:
    """What a core takes, axon by axon and row by row, by the contract of plans alone."""
    made, board = plan.network, plan.board
    exc, inh, inputs = (numbers(core, name) for name in ("exc", "inh", "inputs"))
    counters = exc if board.counters else []
    assert numbers(core, "counters") == counters  # beside their neurons
    with_exc = [other for other in plan.cores if numbers(other, "exc")]
    index = min((bits for bits in board.memory.index_bits if len(exc) - 1 < 1 << bits), default=0)
    rows: list[tuple[object, int]] = []  # of each input axon the format and the words
    for row, weights in enumerate(made.weights):
        count, dense = int(np.count_nonzero(weights[exc])), bool(core.dense_inputs[row])
        if count:
            stored = plan.weight_bits + (0 if dense else index)
            rows.append((("inputs", dense), words(len(exc) if dense else count, stored)))
    if exc and made.inhibition:
        rows.append(("root", words(len(exc), plan.inhibition_bits + index)))
    rows += [("counters", 1)] * len(counters)
    rows += [("inh", 1) for number in inh for _ in listened(made, number)]
    rows += [("relays", 1)] * (len(inputs) if made.relayed else 0)
    of_root = len(with_exc) * bool(made.inhibition)
    axons_out = 2 * len(exc) + sum(of_root if number == made.inhibitory - 1 else 1 for number in inh)
    axons_out += sum(bool(made.weights[one, numbers(other, "exc")].any()) for one in inputs for other in with_exc)
    populations, compartments = (exc, counters, inh, inputs), len(exc) + len(counters) + len(inh) + len(inputs)
    profiles, formats = sum(map(bool, populations)), len({form for form, _ in rows})
    needs = (compartments, len(rows), axons_out, sum(size for _, size in rows), profiles, profiles, formats)
    return dict(zip(LIMITS, needs, strict=True))


def check_plan(plan: Plan) -> None:
    """Every neuron stands once, every need equals its second count, and every limit holds."""
    made, board = plan.network, plan.board
    sizes = {
        "exc": made.neurons,
        "counters": made.neurons * board.counters,
        "inh": made.inhibitory,
        "inputs": made.input_compartments,
    }
    for name, size in sizes.items():
        assert sorted(i for core in plan.cores for i in numbers(core, name)) == list(range(size))
    where = [(core.chip, core.core) for core in plan.cores]
    assert where == sorted(set(where))
    assert all(0 <= chip < board.chips and 0 <= core < board.cores for chip, core in where)
    for core in plan.cores:
        assert core.parts
        assert [part.population for part in core.parts] == sorted((part.population for part in core.parts), key=ORDER)
        assert [part.compartment for part in core.parts] == list(
            itertools.accumulate([0, *(part.size for part in core.parts[:-1])])
        )
        counted, limits = literal_needs(plan, core), board.as_json()
        for name in LIMITS:
            need, limit = getattr(core.needs, name), limits[name]
            assert (need is None) == (limit is None)
            assert limit is None or need == counted[name], name
            assert limit is None or 0 <= need <= (board.memory.capacity if name == "synapse_words" else limit), name


def check_images(plan: Plan) -> None:
    """Needs are what the core's registers and memory take."""
    for core, image in zip(plan.cores, core_images(plan), strict=True):
        used = [own for own in image.registers["synapseFmt"] if own is not None]
        registers = (image.registers["cxProfileCfg"], image.registers["vthProfileCfg"], used)
        taken = (image.compartments, image.axons_in, image.axons_out, image.synapses, *registers)
        assert [getattr(core.needs, name) for name in LIMITS] == [len(own) for own in taken]
    host_tables(plan)


def parts_of(total: int, cores: int) -> Iterator[tuple[int, ...]]:
    if cores == 1:
        yield (total,)
        return
    for first in range(total + 1):
        for rest in parts_of(total - first, cores - 1):
            yield first, *rest
