"""Runs problems in nengo-loihi's emulator: python in_nengo_loihi.py FOLDER (an environment of its own).

Reads every ``*.problem.npz`` (`benchmarks.oracles.problems` has the format) and writes ``*.result.npz`` beside it.
Blocks are built by hand, without nengo's network on top, so that the emulator gets the very integers; only the weights
pass its own discretisation, as they do on their way to a chip.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from nengo_loihi.block import Axon, LoihiBlock, Synapse, SynapseConfig
from nengo_loihi.builder.discretize import discretize_weights
from nengo_loihi.emulator import EmulatorInterface
from nengo_loihi.inputs import SpikeInput

TOP = (1 << 23) - 1


def block(problem: Any, index: int) -> LoihiBlock:
    """Population ``index``: registers as they are."""
    size, du, dv, floor, hold = (int(x) for x in problem["populations"][index])
    made = LoihiBlock(size, label=f"population {index}")
    registers = made.compartment
    registers.decay_u = np.full(size, du, np.int32)
    registers.decay_v = np.full(size, dv, np.int32)
    registers.scale_u = registers.scale_v = False
    registers.refract_delay = np.full(size, hold + 1, np.int32)  # 1 is none
    registers.vth = (problem[f"threshold_{index}"] << 6).astype(np.int32)
    registers.bias = problem[f"bias_{index}"].astype(np.int32)
    registers.vmin, registers.vmax = max(floor, -TOP), TOP
    return made


def connect(problem: Any, index: int, source: Any, target: LoihiBlock) -> None:
    """Connection ``index`` from a block or the inputs to a block; sign modes have the chip's numbers."""
    _, _, bits, exponent, sign = (int(x) for x in problem["connections"][index])
    weights = problem[f"weights_{index}"]
    settings = {
        "weight_bits": SynapseConfig.WEIGHT_BITS_MAP.index(bits),
        "weight_exp": exponent,
        "fanout_type": sign,
    }
    synapse = Synapse(len(weights), label=f"connection {index}")
    whole = discretize_weights(SynapseConfig(**settings), weights.astype(np.float64))
    synapse._set_weights_indices(whole[:, None, :], weight_dtype=np.int32, compression=3)
    synapse.format(**settings)
    target.add_synapse(synapse)
    axon = Axon(len(weights))
    axon.target = synapse
    source.add_axon(axon)


def run(problem: Any) -> dict[str, np.ndarray]:
    """Spikes and membranes of every population."""
    spikes = problem["spikes"]
    presentations, steps, inputs = spikes.shape
    blocks = [block(problem, i) for i in range(len(problem["populations"]))]
    source = SpikeInput(inputs)
    for i, (pre, post) in enumerate(problem["connections"][:, :2]):
        connect(problem, i, source if pre < 0 else blocks[pre], blocks[post])
    result = {}
    for i, made in enumerate(blocks):
        shape = (presentations, steps, made.n_neurons)
        result |= {f"spikes_{i}": np.zeros(shape, bool), f"v_{i}": np.zeros(shape, np.int32)}
    for presentation in range(presentations):
        source.spikes.clear()
        for step in range(steps):
            source.add_spikes(step + 1, np.flatnonzero(spikes[presentation, step]))
        model = SimpleNamespace(blocks=blocks, inputs=[source], probes=[], dt=0.001)
        with EmulatorInterface(model, seed=0) as emulator:
            for step in range(steps):
                emulator.step()
                state = emulator.compartment
                for i, made in enumerate(blocks):
                    part = emulator.block_info.slices[made]
                    result[f"spikes_{i}"][presentation, step] = state.spiked[part]
                    result[f"v_{i}"][presentation, step] = state.voltage[part]
    return result


def main(folder: str) -> None:
    """Run every problem of ``folder`` and write its result beside it."""
    warnings.simplefilter("ignore")  # each overflow and each lost bit; both show in the result
    for path in sorted(Path(folder).glob("*.problem.npz")):
        with np.load(path, allow_pickle=False) as problem:
            arrays = run({name: problem[name] for name in problem.files})
        np.savez_compressed(path.with_name(path.name.replace(".problem.", ".result.")), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
