"""Random networks, partitioned: every limit holds, counted from the bundle's bytes; every spike is the engine's.

Of `lava_vpr.deploy` only the bundle reader and the boards' limits count: words are read bit by bit.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.lava.small_networks import limits

from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.bundle.deployment import contents
from lava_vpr.deploy.bundle.folder import ReadBundle, sealed
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import NetworkLimitError
from lava_vpr.model import Model, Stretch

SEEDS = 5000
"""Most that are tried to find as many as fit."""

WEIGHT_BITS = (0, 1, 2, 3, 4, 5, 6, 8)
Row = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Compartments of a row's synapses, and the currents they bring, in units of u."""
INDEX_BITS = (0, 6, 7, 8, 9, 10, 11, 12)


def random_network(rng: np.random.Generator, large: bool) -> FixedNetwork:
    """A network of any size, density, width and input mode, with signs and biases or without."""
    inputs = int(rng.integers(1, 1600 if large else 90))
    neurons = int(rng.integers(1, 260 if large else 40))
    signed = bool(rng.random() < 0.5)
    bits = int(rng.integers(1, 9 - signed))
    density = rng.choice([0.0, 0.05, 0.3, 0.6, 1.0], p=[0.02, 0.18, 0.3, 0.3, 0.2])
    weights = rng.integers(1, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < density)
    weights = (weights * np.minimum(1, 28_000 / np.maximum(1, weights.sum(axis=0)))).astype(np.int16)
    if signed:
        weights *= rng.choice([-1, 1], weights.shape, p=[0.3, 0.7]).astype(np.int16)
    mode = rng.choice(3)
    network = FixedNetwork(
        weights=weights,
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=int(rng.integers(1, max(2, int(weights.sum(axis=0).max()) // 12 + 2))),
        inhibition=int(rng.integers(1, 128)) >> int(rng.integers(0, 8)),
        inhibition_exponent=int(rng.integers(0, 5)),
        decay=int(rng.choice([0, 137, 1000, 4095])),
        steps=int(rng.integers(1, 40)),
        regular=bool(mode > 0),
        bias_input=bool(mode > 1),
    )
    if rng.random() < 0.5:
        return network
    exponent = int(rng.integers(0, 8))
    mantissas = rng.integers(-4095, 1 + min(4095, network.highest_bias >> exponent), neurons)
    return replace(network, bias=(mantissas << exponent).astype(np.int32))


def random_board(rng: np.random.Generator, network: FixedNetwork) -> Board:
    """Kapoho Bay, as it is or with cores so small that the network takes several."""
    if rng.random() < 0.3:
        return KAPOHO_BAY
    least = network.inputs + network.neurons + 1
    return replace(
        KAPOHO_BAY,
        cores=int(rng.choice([2, 4, 16, 128])),
        compartments=int(rng.integers(2, 200)),
        axons_in=int(rng.integers(least, 3 * least)),
        axons_out=int(rng.integers(4, 400)),
        memory=PackedRows(int(rng.integers(network.inputs + 2 * network.neurons + 4, 9 * least))),
    )


def model_of(network: FixedNetwork) -> Model:
    """A model around a random network: what deployment needs of it."""
    rng = np.random.default_rng(network.inputs)
    trains = "regular" if network.regular else "poisson"
    way = {"input_mode": "bias" if network.bias_input else "injected", "trains": trains}
    encoder = {"kind": "pixels", "query_spikes": 5.0}
    return Model(
        config=update(preset("loihi"), {"encoder": encoder, "network": way}),
        network=network,
        learned=np.zeros((0, 0), np.float32),
        responses=np.zeros((network.neurons, 2), np.int32),
        stretches=(Stretch(0, 2, 0, network.neurons),),
        place_indices=np.arange(2),
        place_names=("a", "b"),
        route_images=2,
        labels=np.arange(2),
        patches=np.zeros((2, 28, 28), np.uint8),
        activity=rng.random((2, network.inputs)).astype(np.float32),
        thumbnails=np.zeros((2, 48, 64, 3), np.uint8),
        training={},
    )


@dataclass
class Core:
    """A core as its bytes say."""

    chip: int
    number: int
    registers: dict[str, Any]
    compartments: NDArray[np.int32]
    words: NDArray[np.uint64]
    axons_in: NDArray[np.int32]
    axons_out: NDArray[np.int32]

    @cached_property
    def rows(self) -> list[Row]:
        """Every axon's (compartment, current in units of u), bit by bit."""
        axons = list(map(tuple, self.axons_in.tolist()))
        known = {axon: self._row(*axon, self.registers["synapseFmt"]) for axon in set(axons)}
        return [known[axon] for axon in axons]

    def _row(self, first: int, words: int, synapses: int, formats: Any) -> Row:
        at, end, position = first, first + words, 0
        blocks: list[Row] = [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
        while at < end:
            head = int(self.words[at])
            form = formats[head & 15]
            count = (head >> 4 & 63) + 1
            weight, index = WEIGHT_BITS[form["wgtBits"]], INDEX_BITS[form["idxBits"]]
            length = -(-(10 + count * (weight + index)) // 64)
            bits = np.unpackbits(self.words[at : at + length].astype("<u8").view(np.uint8), bitorder="little")
            fields = bits[10 : 10 + count * (weight + index)].reshape(count, weight + index).astype(np.int64)
            targets = fields[:, :index] @ (1 << np.arange(index)) if index else position + np.arange(count)
            sizes = fields[:, index:] @ (1 << np.arange(weight))
            assert form["fanoutType"] == 1, "a weight has no sign of its own"
            sizes = sizes - (fields[:, -1] << weight)  # two's complement
            position += count
            shift = 9 - weight + 6 + form["wgtExp"]
            currents = sizes << shift if shift >= 0 else sizes >> -shift
            blocks.append((targets, currents))
            at += length
        assert at == end, "a row does not end where its axon says"
        assert position == synapses, "a row has other synapses than its axon says"
        targets, amounts = (np.concatenate(arrays) for arrays in zip(*blocks, strict=True))
        assert len(set(targets.tolist())) == synapses, "two synapses of a row lead to one compartment"
        return targets, amounts


def core_folders(bundle: ReadBundle) -> list[str]:
    """The folders of a bundle's cores, sorted."""
    return sorted({name.rpartition("/")[0] for name in bundle.files if name.startswith("cores/")})


def cores_of(bundle: ReadBundle) -> list[Core]:
    """Every core of a bundle."""
    made = []
    for folder in core_folders(bundle):
        chip, number = (int(part[4:]) for part in folder.removeprefix("cores/").split("-"))
        names = ("compartments", "synapses", "axons_in", "axons_out")
        arrays = [bundle.array(f"{folder}/{name}.npy") for name in names]
        made.append(Core(chip, number, bundle.json(f"{folder}/registers.json"), *arrays))
    return made


def violations(cores: list[Core], board: Board) -> list[str]:
    """Every limit that a bundle's content exceeds."""
    found = []

    def need(what: str, value: int, limit: int | None) -> None:
        if limit is not None and value > limit:
            found.append(f"{what}: {value} > {limit}")

    numbers = {(core.chip, core.number) for core in cores}
    if len(numbers) < len(cores):
        found.append("two cores with one number")
    for core in cores:
        name = f"chip {core.chip} core {core.number}"
        if not (0 <= core.chip < board.chips and 0 <= core.number < board.cores):
            found.append(f"{name}: not on the board")
        need(f"{name} compartments", len(core.compartments), board.compartments)
        need(f"{name} input axons", len(core.axons_in), board.axons_in)
        need(f"{name} output axons", len(core.axons_out), board.axons_out)
        spans = sorted({(first, words) for first, words, _ in core.axons_in.tolist()})
        need(f"{name} words", max((a + b for a, b in spans), default=0), board.memory.words)
        need(f"{name} words stored", len(core.words), board.memory.words)
        for (one, size), (two, _) in itertools.pairwise(spans):
            if one + size > two:
                found.append(f"{name}: rows overlap at word {two}")
        used = [(i, own) for i, own in enumerate(core.registers["synapseFmt"]) if own]
        need(f"{name} formats", len(used), board.formats)
        for number, own in used:
            if number == 0 or WEIGHT_BITS[own["wgtBits"]] not in board.weight_bits or abs(own["wgtExp"]) > 7:
                found.append(f"{name}: format {number} cannot be")
        need(f"{name} profiles", len(core.registers["cxProfileCfg"]), board.profiles)
        need(f"{name} thresholds", len(core.registers["vthProfileCfg"]), board.thresholds)
        for own in core.registers["cxProfileCfg"]:
            if not (0 <= own["decayU"] < 4096 and 0 <= own["decayV"] < 4096 and own["refractDelay"] >= 1):
                found.append(f"{name}: decays {own}")
        for own in core.registers["vthProfileCfg"]:
            if not 0 < own["vth"] < 1 << 17:
                found.append(f"{name}: threshold {own}")
        received = np.zeros((2, len(core.compartments)), np.int64)
        for targets, currents in core.rows:
            received[0, targets] += np.maximum(currents, 0)
            received[1, targets] += np.maximum(-currents, 0)
        need(f"{name} received", int(received.max(initial=0)) >> 6, board.input_limit - 1)
        for source, chip, number, axon in core.axons_out.tolist():
            target = next((other for other in cores if (other.chip, other.number) == (chip, number)), None)
            if not 0 <= source < len(core.compartments) or target is None or not 0 <= axon < len(target.axons_in):
                found.append(f"{name}: an axon leads to chip {chip} core {number} axon {axon}, which is not there")
    return found


Ways = dict[tuple[str, str], NDArray[np.int64]]
"""Currents of a spike, in units of u, from the members of one population to those of another, by both names."""


def matrices(cores: list[Core], bundle: ReadBundle, inputs: int) -> Ways:
    """Currents followed from axon to axon; spikes that the host sends are of the population ``injected``."""
    by_number = {(core.chip, core.number): core for core in cores}
    names = ("exc", "counters", "inh", "inputs")
    tables = {name: bundle.array(f"host/{name}.npy") for name in ("injection", *names)}
    whose = {(core.chip, core.number): [("", -1)] * len(core.compartments) for core in cores}
    for name in names:
        for number, (chip, core_number, compartment) in enumerate(tables[name].tolist()):
            assert whose[chip, core_number][compartment] == ("", -1), "two in one compartment"
            whose[chip, core_number][compartment] = (name, number)
    sizes = {"injected": inputs} | {name: len(tables[name]) for name in names}
    found = {(a, b): np.zeros((sizes[a], sizes[b]), np.int64) for a in sizes for b in names}

    def follow(source: str, number: int, chip: int, core: int, axon: int) -> None:
        for target, current in zip(*by_number[chip, core].rows[axon], strict=True):
            population, member = whose[chip, core][target]
            assert member >= 0 or current == 0, "a synapse leads to nobody"
            if current:
                found[source, population][number, member] += current

    for source, chip, core, axon in tables["injection"].tolist():
        follow("injected", source, chip, core, axon)
    for core in cores:
        for compartment, chip, number, axon in core.axons_out.tolist():
            follow(*whose[core.chip, core.number][compartment], chip, number, axon)
    return found


def wanted_ways(network: FixedNetwork) -> Ways:
    """What `matrices` are to be, but for those that are all 0."""
    to_exc = network.weights.astype(np.int64) << 6
    root = network.inhibitory - 1
    listens = np.zeros((network.neurons, network.inhibitory), np.int64)
    takes = np.zeros((network.inhibitory, network.neurons), np.int64)
    takes[root] = -64 * network.lateral
    for neuron in range(network.neurons):
        listens[neuron, neuron // fixed.FAN_IN if network.leaves else root] = 128
    counted = 128 * np.eye(network.neurons, dtype=np.int64)
    found = {("exc", "inh"): listens, ("exc", "counters"): counted, ("inh", "exc"): takes}
    if network.leaves:
        found["inh", "inh"] = 128 * (np.arange(root + 1)[:, None] < root) * (np.arange(root + 1) == root)
    if network.relayed:
        found["injected", "inputs"] = 128 * np.eye(network.inputs, dtype=np.int64)
    return found | {("inputs" if network.input_compartments else "injected", "exc"): to_exc}


def in_memory(network: FixedNetwork, board: Board, **options: Any) -> ReadBundle:
    """The bundle of a network, which never is on a disk.

    Raises:
        NetworkLimitError: it does not fit.
    """
    manifest, files, _ = contents(model_of(network), board, picture=False, **options)
    return ReadBundle(Path("memory"), sealed(manifest, files), files)


def fitting(wanted: int, start: int) -> Iterator[tuple[str, FixedNetwork, Board, ReadBundle]]:
    """Random networks, on random boards, that fit, until there are as many as wanted: name, network, board, bundle."""
    found = 0
    for seed in range(start, start + SEEDS):
        rng = np.random.default_rng(seed)
        network = random_network(rng, large=seed % 8 == 0)
        board = random_board(rng, network)
        try:
            yield f"seed {seed}", network, board, in_memory(network, board, dense_rows=bool(seed % 2))
        except NetworkLimitError:
            continue
        found += 1
        if found == wanted:
            return
    raise AssertionError(f"only {found} of {wanted} fit")


def partitioned(wanted: int, start: int) -> Counter[str]:
    """Count and follow what the cores of networks hold; of how many networks what is true."""
    seen: Counter[str] = Counter()
    for name, network, board, bundle in fitting(wanted, start):
        cores = cores_of(bundle)
        assert violations(cores, board) == [], name
        expected = wanted_ways(network)
        for ways, found in matrices(cores, bundle, network.inputs).items():
            assert np.array_equal(found, expected.get(ways, 0 * found)), f"{name}: {ways}"
        is_true = {
            "several": len(cores) > 1,
            "chips": len({core.chip for core in cores}) > 1,
            "bias inputs": network.bias_input,
            "signed": network.signed,
            "biases": network.bias.any(),
            "relayed": network.relayed,
            "leaves": network.leaves > 0,
        }
        seen.update(what for what, true in is_true.items() if true)
    print(f"{wanted} networks, {seen['several']} of several cores")
    return seen


SMALL = {"FAN_IN": 16, "DIRECT": 8}
"""Few neurons are many: there are leaves and relays."""


@pytest.mark.parametrize(
    ("wanted", "start", "small", "least"),
    [
        pytest.param(40, 100, {}, {"several": 9, "chips": 1, "bias inputs": 6, "signed": 9, "biases": 9}, id="forty"),
        pytest.param(20, 300, SMALL, {"relayed": 4, "leaves": 6}, id="twenty with leaves and relays"),
        pytest.param(
            *(1000, 10_000, {}, {"several": 201, "chips": 6, "bias inputs": 101}),
            id="a thousand",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_every_limit_holds_of_random_networks(
    wanted: int, start: int, small: dict[str, int], least: dict[str, int]
) -> None:
    """Among them are at ``least`` so many of each kind."""
    with limits(**small):
        seen = partitioned(wanted, start=start)
    assert {kind: number for kind, number in least.items() if seen[kind] < number} == {}


@pytest.mark.parametrize(
    ("wanted", "start", "small", "enough"),
    [
        pytest.param(10, 50_000, {}, (100, 0), id="ten"),
        pytest.param(10, 70_000, SMALL, (100, 0), id="ten with leaves and relays"),
        pytest.param(80, 60_000, {}, (1000, 10), id="eighty", marks=pytest.mark.slow),
    ],
)
def test_every_spike_of_random_networks(
    wanted: int, start: int, small: dict[str, int], enough: tuple[int, int]
) -> None:
    """The bundle's simulation is the engine's; ``enough`` spikes of exc, and networks that took several cores."""
    spikes, several = 0, 0
    with limits(**small):
        for name, network, _, bundle in fitting(wanted, start):
            model = model_of(network)
            shown = Presentations(query_rates(model.activity, model.config), 1)
            host = HostBackend().trains(model, shown)
            exc, inh, inputs = TARGETS[bundle.target].player(bundle)(shown.rates, shown.keys)
            for found, expected in ((exc, host.exc), (inputs, host.inputs), (inh, host.inh)):
                assert np.array_equal(found, expected), name
            spikes += int(exc.sum())
            several += len(core_folders(bundle)) > 1
    print(f"{wanted} networks, {spikes} spikes")
    assert spikes > enough[0]
    assert several > enough[1]


def test_a_violation_is_seen() -> None:
    """The independent count must be able to fail: one word too many, one threshold too high."""
    bundle = in_memory(random_network(np.random.default_rng(5), large=False), KAPOHO_BAY)
    cores = cores_of(bundle)
    assert violations(cores, KAPOHO_BAY) == []
    cores[0].registers["vthProfileCfg"][0]["vth"] = 1 << 17
    cores[0].registers["cxProfileCfg"] *= 40
    texts = " ".join(violations(cores, KAPOHO_BAY))
    assert "threshold" in texts
    assert "profiles" in texts
