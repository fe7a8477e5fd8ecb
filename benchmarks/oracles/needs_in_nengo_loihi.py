"""What cores need of Loihi 1 as nengo-loihi counts it: python needs_in_nengo_loihi.py FOLDER (its own environment).

Reads every ``*.core.npz`` (`benchmarks.oracles.needs` has the format): which neurons stand on a core and which weights
lead to them. Builds nengo-loihi's own block of it, lets its own functions count bits, axons and configurations and
validate it, and writes ``*.needs.json`` beside it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from nengo.exceptions import BuildError
from nengo_loihi.block import Axon, LoihiBlock, Synapse, SynapseConfig
from nengo_loihi.builder.validate import validate_block
from nengo_loihi.hardware.allocators import Allocator
from nengo_loihi.hardware.nxsdk_objects import Board
from nengo_loihi.hardware.validate import validate_core

MIXED = 1
TO_INHIBITORY = {"weight": 2, "bits": 3, "exponent": -6}
"""The synapses to counters, to inhibitory neurons, and to relays."""


def synapse(label: str, rows: list[Any], indices: list[Any] | None, code: dict[str, int]) -> Synapse:
    """A group of rows in one format: dense without ``indices``."""
    made = Synapse(len(rows), label=label)
    made._set_weights_indices(rows, indices=indices, weight_dtype=np.int32, compression=3 if indices is None else 0)
    made.format(**code)
    return made


def code(bits: int, exponent: int) -> dict[str, int]:
    """The registers of a format, each of whose weights has a sign."""
    return {"weight_bits": SynapseConfig.WEIGHT_BITS_MAP.index(bits), "weight_exp": exponent, "fanout_type": MIXED}


def groups(problem: Any) -> list[Synapse]:
    """All synapses of the core: rows of the inputs and of the root, and those to counters,
    inhibitory neurons and relays."""
    scalar = {name: int(problem[name]) for name in problem.files if problem[name].ndim == 0}
    weights, dense = problem["weights"].astype(np.int32), problem["dense"]
    made = []
    inputs = code(scalar["bits"], scalar["exponent"])
    used = weights.any(axis=1)
    if (used & dense).any():
        made.append(synapse("dense inputs", list(weights[used & dense]), None, inputs))
    if (used & ~dense).any():
        rows = weights[used & ~dense]
        columns = [np.flatnonzero(row) for row in rows]
        made.append(synapse("sparse inputs", [r[c] for r, c in zip(rows, columns)], columns, inputs))  # noqa: B905
    if scalar["inhibition"]:
        taken = np.full(weights.shape[1], scalar["inhibition"], np.int32)
        registers = code(scalar["inhibition_bits"], scalar["inhibition_exponent"])
        made.append(synapse("the root", [taken], [np.arange(taken.size)], registers))
    for name in ("to_counters", "to_inh", "to_relays"):
        targets = problem[name]
        if targets.size:
            rows = [np.array([TO_INHIBITORY["weight"]], np.int32)] * targets.size
            registers = code(TO_INHIBITORY["bits"], TO_INHIBITORY["exponent"])
            made.append(synapse(name, rows, [np.array([target]) for target in targets], registers))
    return made


def needs(problem: Any) -> dict[str, Any]:
    """The needs of a core as nengo-loihi's own functions count them."""
    size = int(problem["compartments"])
    block = LoihiBlock(size)
    registers = block.compartment
    registers.decay_u, registers.decay_v = problem["decay_u"], problem["decay_v"]
    registers.vth = problem["threshold"].astype(np.int64) << 6
    registers.bias = problem["bias"].astype(np.int32)
    registers.refract_delay = np.ones(size, np.int32)
    registers.scale_u = registers.scale_v = False
    for group in groups(problem):
        block.add_synapse(group)
    for count in problem["axons_out"]:
        axon = Axon(int(count))
        axon.target = SimpleNamespace(pop_type=0)  # synapses on another core, of single axons
        block.add_axon(axon)
    validated: dict[str, Any] = {"error": None}
    try:
        validate_block(block)
        board = Board()
        chip = board.new_chip()
        Allocator().block_to_new_core(block, chip)
        core = chip.cores[0]
        validate_core(core)
        validated["profiles"], validated["thresholds"] = len(core.compartment_cfgs), len(core.vth_cfgs)
    except (BuildError, AssertionError) as error:
        validated["error"] = str(error) or type(error).__name__
    formats = {tuple(getattr(group.synapse_cfg, name) for name in SynapseConfig.params) for group in block.synapses}
    return validated | {
        "compartments": size,
        "axons_in": sum(group.n_axons for group in block.synapses),
        "axons_out": sum(axon.axon_slots() for axon in block.axons),
        "synapse_bits": sum(group.bits() for group in block.synapses),
        "formats": len(formats),
    }


def main(folder: str) -> None:
    """Count what every core of ``folder`` needs and write it beside the core."""
    for path in sorted(Path(folder).glob("*.core.npz")):
        with np.load(path, allow_pickle=False) as problem:
            counted = needs(problem)
        path.with_name(path.name.replace(".core.npz", ".needs.json")).write_text(json.dumps(counted))


if __name__ == "__main__":
    main(*sys.argv[1:])
