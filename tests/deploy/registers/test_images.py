"""Register images of plans: what stands where, and the network that comes back out of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards.plans import LOAD, NEEDS, even, network, random_network, simple_plan

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Plan, PopulationPart
from lava_vpr.deploy.bundle import core_files
from lava_vpr.deploy.bundle.folder import ReadBundle, array_bytes
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.deploy.registers.core_images import (
    CoreImage,
    HostTables,
    core_images,
    host_tables,
)
from lava_vpr.deploy.registers.synapses import lateral_synapse
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import BundleError, NetworkLimitError
from lava_vpr.loihi import LOIHI_1_WEIGHT_BITS


def small_plan(**changes: Any) -> Plan:
    """Three neurons, two inputs: neurons 0 and 1 with the inhibitory one on one core, neuron 2 on another chip."""
    weights = np.array([[5, 6, 0], [0, 7, 0]], np.int16)
    network = replace(FixedNetwork(weights, np.zeros(3, np.int32), 3, False, 9, 10, 1, 130, 20), **changes)
    dense = np.array([True, False])
    parts = [PopulationPart("exc", 0, 2, 0), PopulationPart("counters", 0, 2, 2), PopulationPart("inh", 0, 1, 4)]
    if network.bias_input:
        parts.append(PopulationPart("inputs", 0, 2, 5))
    return Plan(
        network,
        KAPOHO_BAY,
        (
            CorePlan(0, 4, tuple(parts), dense, NEEDS, LOAD),
            CorePlan(1, 0, (PopulationPart("exc", 2, 1, 0), PopulationPart("counters", 2, 1, 1)), dense, NEEDS, LOAD),
        ),
        4,
        5,
        None,
        0.0,
    )


def scalars_of(network: FixedNetwork) -> dict[str, int]:
    """What a manifest tells."""
    numbers = {"inputs": network.inputs, "neurons": network.neurons, "silent_steps": network.silent_steps}
    return numbers | network.scalars


def network_of(images: Sequence[CoreImage], tables: HostTables, told: dict[str, int]) -> FixedNetwork:
    """What a bundle for Kapoho Bay is opened as that holds these images, tables and numbers."""
    manifest = {"target": "kapoho-bay", "network": told}
    return core_files.network(ReadBundle(Path("b"), manifest, core_files.files_of(images, tables)))


def equal(a: FixedNetwork, b: FixedNetwork) -> bool:
    arrays = ((a.weights, b.weights), (a.bias, b.bias))
    return all(one.dtype == other.dtype and np.array_equal(one, other) for one, other in arrays) and (
        scalars_of(a) == scalars_of(b)
    )


@pytest.mark.parametrize("small", [False, True])
@pytest.mark.parametrize("seed", range(24))
def test_the_network_comes_back_out_of_its_images(seed: int, small: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if small:  # so that there are leaves and relays
        monkeypatch.setattr(fixed, "FAN_IN", 5)
        monkeypatch.setattr(fixed, "DIRECT", 4)
    network = random_network(seed)
    plan = simple_plan(network, 1 + seed % 6, seed)
    images = [replace(i, registers=json.loads(json.dumps(i.registers))) for i in core_images(plan)]
    assert equal(network_of(images[::-1], host_tables(plan), scalars_of(network)), network)


def test_a_small_network_word_by_word() -> None:
    one, two = core_images(small_plan())
    # Format ids: 1 inputs dense, 2 inputs sparse, 3 of the root, 4 to the counters, 5 to the root.
    index = 6
    words = [
        1 | 1 << 4 | 5 << 10 | 6 << 14,
        2 | 0 << 4 | 1 << 10 | 7 << 10 + index,
        3 | 1 << 4 | 0 << 10 | 22 << 16 | 1 << 21 | 22 << 27,
        *(4 | 0 << 4 | counter << 10 | 2 << 10 + index for counter in (2, 3)),
        *(5 | 0 << 4 | 4 << 10 | 2 << 10 + index for _ in range(3)),
    ]
    assert one.synapses.tolist() == words
    assert one.axons_in.tolist() == [[0, 1, 2], [1, 1, 1], [2, 1, 2], *([row, 1, 1] for row in range(3, 8))]
    # A lone neuron without input: the root's row, and its counter's.
    assert two.synapses.tolist() == [1 | 0 << 4 | 0 << 10 | 22 << 16, 2 | 0 << 4 | 1 << 10 | 2 << 16]
    assert two.axons_in.tolist() == [[0, 1, 1], [1, 1, 1]]
    assert one.axons_out.tolist() == [
        [0, 0, 4, 5],
        [0, 0, 4, 3],
        [1, 0, 4, 6],
        [1, 0, 4, 4],
        [4, 0, 4, 2],
        [4, 1, 0, 0],
    ]
    assert two.axons_out.tolist() == [[0, 0, 4, 7], [0, 1, 0, 1]]
    assert one.compartments.tolist() == [[0, 0, 0, 0]] * 2 + [[1, 1, 0, 0]] * 2 + [[2, 2, 0, 0]]
    registers = one.registers
    assert [(p["decayU"], p["decayV"], p["refractDelay"]) for p in registers["cxProfileCfg"]] == [
        (4095, 130, 1),
        (4095, 0, 1),
        (4095, 4095, 1),
    ]
    assert registers["vthProfileCfg"] == [{"vth": 9}, {"vth": 131071}, {"vth": 1}]
    shown = [None if f is None else (f["wgtBits"], f["idxBits"], f["wgtExp"]) for f in registers["synapseFmt"]]
    # Of the root: mantissa -10 2^1; its 5 bits are the upper ones of 8 and sign.
    assert shown == [None, (4, 0, -5), (4, 1, -5), (5, 1, -3), (3, 1, -6), (3, 1, -6)]
    assert registers["dendriteSharedCfg"] == {"posVmLimit": 7, "negVmLimit": 23}
    assert registers["numUpdates"]["numUpdates"] == 2
    types = {name: getattr(one, name).dtype.name for name in ("compartments", "synapses", "axons_in", "axons_out")}
    assert types == {"compartments": "int32", "synapses": "uint64", "axons_in": "int32", "axons_out": "int32"}


def test_signs_and_biases_of_a_small_network() -> None:
    weights = np.array([[-3, 2, 0], [0, -1, 0]], np.int16)
    bias = np.array([18, -8190, 0], np.int32)
    plan = replace(small_plan(weights=weights, bias=bias, bits=2, signed=True), weight_bits=3)
    one, two = core_images(plan)
    # Two's complement in 3 bits, one of which is the sign.
    assert one.synapses[:2].tolist() == [1 | 1 << 4 | 5 << 10 | 2 << 13, 2 | 0 << 4 | 1 << 10 | 7 << 16]
    shown = [(f["wgtBits"], f["wgtExp"], f["fanoutType"]) for f in one.registers["synapseFmt"][1:3]]
    assert shown == [(3, -6, 1), (3, -6, 1)]  # -3 2^6 in the register's 9 bits, which is worth that 2^-6
    # Profile, threshold, mantissa and the one exponent of all.
    assert one.compartments.tolist() == [[0, 0, 9, 1], [0, 0, -4095, 1], *[[1, 1, 0, 0]] * 2, [2, 2, 0, 0]]
    assert two.compartments.tolist() == [[0, 0, 0, 1], [1, 1, 0, 0]]
    told = scalars_of(plan.network)
    assert equal(network_of((one, two), host_tables(plan), told), plan.network)
    wide = replace(plan, weight_bits=8)  # more bits than it needs
    assert [f["wgtExp"] for f in core_images(wide)[0].registers["synapseFmt"][1:3]] == [-1, -1]
    assert equal(network_of(core_images(wide), host_tables(wide), told), plan.network)


def test_leaves_and_relays_word_by_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fixed, "FAN_IN", 2)
    monkeypatch.setattr(fixed, "DIRECT", 2)
    nothing = small_plan()
    assert (nothing.network.leaves, nothing.network.input_compartments) == (2, 2)
    one = replace(
        nothing.cores[0],
        parts=(PopulationPart("exc", 0, 3, 0), PopulationPart("counters", 0, 3, 3), PopulationPart("inh", 2, 1, 6)),
    )
    two = replace(nothing.cores[1], parts=(PopulationPart("inh", 0, 2, 0), PopulationPart("inputs", 0, 2, 2)))
    plan = replace(nothing, cores=(one, two))
    first, second = core_images(plan)
    # To exc: input 0 dense, input 1 sparse, the root; to the counters; then leaf 0 and leaf 1 to the root.
    assert first.axons_in[:, 2].tolist() == [3, 1, 3, *[1] * 5]
    assert (first.synapses[-5:] >> np.uint64(10)).tolist() == [target | 2 << 6 for target in (3, 4, 5, 6, 6)]
    # Neurons 0 and 1 to leaf 0, neuron 2 to leaf 1, then the inputs to their relays.
    assert (second.synapses >> np.uint64(10)).tolist() == [target | 2 << 6 for target in (0, 0, 1, 2, 3)]
    to_leaves = [[0, 1, 0, 0], [0, 0, 4, 3], [1, 1, 0, 1], [1, 0, 4, 4]]
    assert first.axons_out.tolist() == [*to_leaves, [2, 1, 0, 2], [2, 0, 4, 5], [6, 0, 4, 2]]
    assert second.axons_out.tolist() == [[0, 0, 4, 6], [1, 0, 4, 7], [2, 0, 4, 0], [3, 0, 4, 1]]
    profiles = [(p["decayU"], p["decayV"]) for p in second.registers["cxProfileCfg"]]
    assert (profiles, second.registers["vthProfileCfg"]) == ([(4095, 4095)] * 2, [{"vth": 1}] * 2)
    tables = host_tables(plan)
    assert tables.injection.tolist() == [[0, 1, 0, 3], [1, 1, 0, 4]]
    assert tables.inputs.tolist() == [[1, 0, 2], [1, 0, 3]]
    assert tables.inh.tolist() == [[1, 0, 0], [1, 0, 1], [0, 4, 6]]
    assert tables.counters.tolist() == [[0, 4, 3], [0, 4, 4], [0, 4, 5]]


@pytest.mark.parametrize(("bits", "widths"), [(1, {2, 3, 5}), (5, {3, 5, 6}), (6, {8}), (7, {8})])
@pytest.mark.parametrize("relayed", [False, True])
def test_where_weights_take_8_bits_no_format_has_fewer(bits: int, widths: set[int], relayed: bool) -> None:
    """Those of the inhibitory neuron, the counters and the relays, too: such a bundle needs no other width."""
    neurons = 1100 if relayed else 12
    made = network(neurons, 8, bits=bits, signed=True)
    plan = partition(made, KAPOHO_BAY, even(made, 1.0))
    forms = [form for image in core_images(plan) for form in image.registers["synapseFmt"] if form is not None]
    assert made.relayed == relayed
    found = {(0, *LOIHI_1_WEIGHT_BITS)[form["wgtBits"]] for form in forms}
    assert found == widths
    assert plan.inhibition_bits == (8 if bits > 5 else 5)


def test_tables_of_a_small_network() -> None:
    tables = host_tables(small_plan())
    assert tables.injection.tolist() == [[0, 0, 4, 0], [1, 0, 4, 1]]
    assert tables.exc.tolist() == [[0, 4, 0], [0, 4, 1], [1, 0, 0]]
    assert tables.counters.tolist() == [[0, 4, 2], [0, 4, 3], [1, 0, 1]]
    assert tables.inh.tolist() == [[0, 4, 4]]
    assert tables.inputs.shape == (0, 3)
    plan = small_plan(regular=True, bias_input=True)
    tables, image = host_tables(plan), core_images(plan)[0]
    assert tables.injection.shape == (0, 4)
    assert tables.inputs.tolist() == [[0, 4, 5], [0, 4, 6]]
    assert image.axons_out[-2:].tolist() == [[5, 0, 4, 0], [6, 0, 4, 1]]
    assert image.registers["cxProfileCfg"][3]["decayV"] == 0
    assert image.registers["vthProfileCfg"][3]["vth"] == 8000


def test_without_inhibition_there_is_a_root_without_axons() -> None:
    one, two = core_images(small_plan(inhibition=0))
    assert (len(one.axons_in), len(two.axons_in), len(two.synapses)) == (7, 1, 1)
    assert one.axons_out[:, 0].tolist() == [0, 0, 1, 1]


def test_lateral_weights() -> None:
    def of(inhibition: int, exponent: int, bits: int) -> tuple[int, int]:
        network = random_network(0, inhibition=inhibition, inhibition_exponent=exponent)
        weight, e = lateral_synapse(network, bits)
        assert -(weight << 9 - bits) * 2.0**e == network.lateral
        return weight, e

    assert of(10, 0, 5) == (-10, -4)
    assert of(160, 2, 5) == (-10, 2)
    assert of(160, 2, 8) == (-80, 2)
    assert of(127, 0, 8) == (-127, -1)
    for inhibition, exponent, bits in ((11, 0, 4), (127, 7, 6), (255, 0, 8), (128, 9, 2)):
        with pytest.raises(NetworkLimitError, match=rf"{inhibition << exponent} does not fit a synapse of {bits} bits"):
            of(inhibition, exponent, bits)


def test_what_loihi_1_cannot_do_is_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"decay 4096 does not fit 0\.\.4095; raise"):
        core_images(small_plan(decay=4096))


@pytest.mark.parametrize("bias_input", [False, True])
def test_one_wrong_number_is_refused_or_is_another_network(bias_input: bool) -> None:
    network = random_network(3, signed=True, bias_input=bias_input, size=(30, 20), bits=5, inhibition=60, decay=130)
    manifest = {"target": "kapoho-bay", "network": scalars_of(network)}
    sound = ReadBundle(Path("b"), manifest, core_files.network_files(simple_plan(network, 4, 5)))
    rng, refused = np.random.default_rng(0), dict[str, str]()
    names = [name for name in sound.files if name.endswith(".npy") and sound.array(name).size]
    for name in names * 4:
        array = sound.array(name)
        array.flat[rng.integers(array.size)] ^= array.dtype.type(1 << int(rng.integers(8 * array.itemsize - 1)))
        try:
            found = core_files.network(ReadBundle(Path("b"), manifest, sound.files | {name: array_bytes(array)}))
            assert np.array_equal(found.weights, network.weights) != np.array_equal(found.bias, network.bias)
        except BundleError as error:
            refused[name] = str(error)
    assert refused.keys() == {*names}
    assert all(text.isprintable() and "deploy the model again" in text for text in refused.values())
