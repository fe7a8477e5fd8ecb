"""What cores need of Loihi 1, as we plan it and as nengo-loihi's own code counts it.

    python -m benchmarks oracles.needs [--random N] [--no-real]      (`make oracles` sets it up)

Every core of every plan is described by the neurons on it and the weights that lead to them, nothing that we counted.
nengo-loihi (1.1.0, in an environment of its own) builds its own block of it and counts synapse bits, axons, formats,
decays and thresholds with the functions that it uses before it writes a board, and validates the core. Everything must
be equal. One difference is known and subtracted here: nengo-loihi lets populations share equal registers, of which we
write one each.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.places import learn, required
from benchmarks.program import Printed, program, python_of, run_elsewhere, verdict
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Plan
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.deploy.registers.core_images import CoreImage, core_images
from lava_vpr.deploy.registers.synapses import lateral_synapse
from lava_vpr.engine.inference.fixed import FAN_IN, FixedNetwork, bias_registers
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import WEIGHT_BITS, WORD_BITS
from lava_vpr.model import integer_model
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.training.measuring import expected_rates

PYTHON = python_of("nengo-loihi")
SCRIPT = Path(__file__).with_name("needs_in_nengo_loihi.py")
COUNTED = ("compartments", "axons_in", "axons_out", "synapse_bits", "profiles", "thresholds", "formats")


def problem(plan: Plan, core: CorePlan, image: CoreImage) -> dict[str, Any]:
    """A core as the oracle takes it; formats and compartments' registers are those of its ``image``."""
    network, inputs = plan.network, core.part("inputs")
    exc, counters, inh = core.part("exc"), core.part("counters"), core.part("inh")
    targets = [other.part("exc") for other in plan.cores if other.part("exc").size]
    leaves = min(network.leaves, inh.first + inh.size) - min(network.leaves, inh.first)
    root = inh.size - leaves
    out = [exc.size, exc.size, leaves]  # to their inhibitory neuron, to their counters, to the root
    out += [root] * len(targets) if network.lateral else []
    used = [network.weights[inputs.first : inputs.first + inputs.size, t.first : t.first + t.size] for t in targets]
    out += [int(weights.any(axis=1).sum()) for weights in used if inputs.size]
    heard = [heard_by(network, number) for number in range(inh.first, inh.first + inh.size)]
    taken, exponent = lateral_synapse(network, plan.inhibition_bits)
    profiles, compartments = image.registers["cxProfileCfg"], image.compartments
    return {
        "weights": network.weights[:, exc.first : exc.first + exc.size],
        "dense": core.dense_inputs,
        "bits": plan.weight_bits,
        "exponent": plan.weight_bits - WEIGHT_BITS - 1,
        "inhibition": taken if network.lateral and exc.size else 0,
        "inhibition_bits": plan.inhibition_bits,
        "inhibition_exponent": exponent,
        "to_inh": np.repeat(inh.compartment + np.arange(inh.size), np.array(heard, np.int64)),
        "to_counters": counters.compartment + np.arange(counters.size),
        "to_relays": inputs.compartment + np.arange(inputs.size if network.relayed else 0),
        "compartments": len(compartments),
        "decay_u": np.array([profiles[i]["decayU"] for i in compartments[:, 0]], np.int32),
        "decay_v": np.array([profiles[i]["decayV"] for i in compartments[:, 0]], np.int32),
        "threshold": np.array([image.registers["vthProfileCfg"][i]["vth"] for i in compartments[:, 1]], np.int32),
        "bias": compartments[:, 2] << compartments[:, 3],
        "axons_out": np.array(out, np.int64),
    }


def heard_by(network: FixedNetwork, inhibitory: int) -> int:
    """The number of neurons that an inhibitory one listens to: excitatory ones, or the leaves."""
    if inhibitory < network.leaves:
        return min(FAN_IN, network.neurons - inhibitory * FAN_IN)
    return network.leaves or network.neurons


def twins(entries: list[Any]) -> int:
    """How many registers hold what another one holds; None is an unused one."""
    held = [json.dumps(entry, sort_keys=True) for entry in entries if entry is not None]
    return len(held) - len(set(held))


def planned(core: CorePlan, image: CoreImage) -> dict[str, int | None]:
    """Our own count, without what nengo-loihi does not have."""
    needs, registers = core.needs, image.registers
    profiles, thresholds, formats = (twins(registers[name]) for name in ("cxProfileCfg", "vthProfileCfg", "synapseFmt"))
    return {
        "compartments": needs.compartments,
        "axons_in": needs.axons_in,
        "axons_out": needs.axons_out,
        "synapse_bits": None if needs.synapse_words is None else needs.synapse_words * WORD_BITS,
        "profiles": None if needs.profiles is None else needs.profiles - profiles,
        "thresholds": None if needs.thresholds is None else needs.thresholds - thresholds,
        "formats": None if needs.formats is None else needs.formats - formats,
    }


def ask(problems: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What nengo-loihi says of each core.

    Raises:
        InputError: its environment is missing, or it failed.
    """
    with temporary_folder() as folder:
        for number, arrays in enumerate(problems):
            np.savez(folder / f"{number:05d}.core.npz", **arrays)
        run_elsewhere("nengo-loihi", PYTHON, "oracles", SCRIPT, folder, seconds=1200)
        return [json.loads(path.read_text()) for path in sorted(folder.glob("*.needs.json"))]


def differences(core: CorePlan, image: CoreImage, theirs: dict[str, Any]) -> list[str]:
    """The counts of a core that differ, or why nengo-loihi refuses it."""
    where, ours = image.name, planned(core, image)
    refusals = [f"{where}: refused by nengo-loihi: {theirs['error']}"] if theirs["error"] else []
    wrong = [name for name in COUNTED if ours[name] != theirs.get(name)]
    return refusals + [f"{where}: {name} {ours[name]}, nengo-loihi {theirs.get(name)}" for name in wrong]


def random_network(seed: int) -> FixedNetwork:
    """A network of any size, density and width that may fit Kapoho Bay; every fifth is a large one."""
    rng = np.random.default_rng(seed)
    inputs, neurons = int(rng.integers(1, 1600)), int(rng.integers(1, 400))
    if seed % 5 == 0:
        inputs, neurons = int(rng.integers(1, 60)), int(rng.choice([1100, 3000, 4500, 6000]))
    signed, regular = bool(rng.integers(2)), bool(rng.integers(2))
    bits = int(rng.integers(1, 8))
    density = rng.choice([0.05, 0.3, 0.6, 1.0])
    weights = rng.integers(1, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < density)
    weights = (weights * np.minimum(1, 30_000 / np.maximum(1, weights.sum(axis=0)))).astype(np.int16)
    if signed:
        weights *= rng.choice(np.array([-1, 1], np.int16), weights.shape)
    network = FixedNetwork(
        weights=weights,
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=int(rng.integers(1, 5000)),
        inhibition=int(rng.choice([0, 7, 33, 254, rng.integers(128)])),
        inhibition_exponent=int(rng.integers(0, 5)),
        decay=137,
        steps=50,
        regular=regular,
        bias_input=regular and bool(rng.integers(2)),
    )
    mantissas, exponent = bias_registers(rng.integers(-9000, min(9000, network.highest_bias) + 1, neurons))
    return replace(network, bias=mantissas << exponent)


def random_plans(count: int) -> Iterator[Plan]:
    """Plans of random networks that fit, every other one with dense rows where they save memory."""
    for seed in range(count):
        network = random_network(seed)
        rates = np.full(network.inputs, min(20.0 / network.inputs, 1.0))
        try:
            yield partition(network, KAPOHO_BAY, rates, dense_rows=bool(seed % 2))
        except NetworkLimitError as error:
            click.echo(f"random {seed}: does not fit ({error})")


def real_plans() -> Iterator[tuple[str, Plan]]:
    """The default model of 100 and of 500 places, with other widths and in both input modes."""
    for places in ((0, 100), (0, 500)):
        model = integer_model(learn(places, preset("loihi")), "Kapoho Bay")
        for bias_input in (False, True):
            name = f"{places[1]} places, 3 bits, {'bias' if bias_input else 'injected'}"
            yield name, partition(replace(model.network, bias_input=bias_input), KAPOHO_BAY, expected_rates(model))
    config = update(preset("loihi"), {"network": {"weight_bits": 1}})
    narrow = integer_model(learn((0, 100), config), "Kapoho Bay")
    yield "100 places, 1 bit, injected", partition(narrow.network, KAPOHO_BAY, expected_rates(narrow))


def too_large() -> dict[str, Any]:
    """The core of 100 neurons, 784 + 400 input axons and 8 bits that does not fit, as a known figure."""
    return {
        "weights": np.full((1184, 100), 200),
        "dense": np.ones(1184, bool),
        **{"bits": 8, "exponent": 0, "inhibition": 0, "inhibition_bits": 8, "inhibition_exponent": 0},
        **{
            "to_counters": np.zeros(0, np.int64),
            "to_inh": np.zeros(0, np.int64),
            "to_relays": np.zeros(0, np.int64),
            "compartments": 100,
        },
        **{name: np.full(100, 100, np.int32) for name in ("decay_u", "decay_v", "threshold", "bias")},
        "axons_out": np.zeros(0, np.int64),
    }


@program()
@click.option("--random", "count", default=40, show_default=True, help="Random networks.")
@click.option("--real/--no-real", default=True, help="Also networks trained on real images (LAVA_VPR_DATA).")
def main(count: int, real: bool) -> Printed:
    """What cores need, ours and nengo-loihi's count; fails if anything differs."""
    if real:
        required("nordland")
    failed, rows = list[str](), list[list[str]]()
    plans = [("random", plan) for plan in random_plans(count)] + (list(real_plans()) if real else [])
    cores = [(n, plan, *pair) for n, plan in plans for pair in zip(plan.cores, core_images(plan), strict=True)]
    *answers, refused = ask([problem(plan, core, image) for _, plan, core, image in cores] + [too_large()])
    for name in dict.fromkeys(name for name, _ in plans):
        of = [(core, image, said) for (n, _, core, image), said in zip(cores, answers, strict=True) if n == name]
        wrong = [line for core, image, said in of for line in differences(core, image, said)]
        failed += [f"{name}: {line}" for line in wrong]
        most = max((core.needs.synapse_words or 0) * WORD_BITS for core, _, _ in of)
        rows.append([name, *(f"{figure:,}" for figure in (len(of), len(of) * len(COUNTED), len(wrong), most))])
    columns = ("", "cores", "counts compared", "differ", "most bits of a core")
    yield Table(columns, rows, title="needs of cores, ours and nengo-loihi's")
    refusal = refused["error"] or "nothing"
    if "exceeded max (1048576)" not in refusal:
        failed.append("a core that is too large was not refused")
    yield from verdict(failed[:20], f"{len(cores)} cores counted; one that is too large: nengo-loihi says {refusal!r}")
