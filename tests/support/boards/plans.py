"""Small and random networks, hand-made plans, shrunken boards, and what holds of every plan; for the tests of
registers, costs and the partition.

Used by bench, deploy and support."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.boards.plan import CorePlan, Load, Needs, Plan, PopulationPart
from lava_vpr.deploy.registers.core_images import HostTables, core_images, host_tables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.loihi import CORE_SYNAPSE_WORDS, LOIHI_1_WEIGHT_BITS

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
