"""Runs a bundle's registers in nengo-loihi's emulator: registers_in_nengo_loihi.py FOLDER N STEPS POPULATION ...

It runs in an environment of its own. FOLDER holds ``bundle``, the folder of ``cores`` and ``host`` of a bundle for
Kapoho Bay, and what is presented: ``spikes.npy``, injected spikes, bool (N, STEPS, inputs), if spikes are injected;
``mantissas.npz``, biases that the host writes to populations before each presentation, int32 (N, width) by name; and
``exponents.npz``, those of each presentation, int32 (N,), of populations whose exponents it writes too.

Every core of the bundle becomes one of nengo-loihi's blocks, by a reader of its own that knows NxSDK's names of
registers (nengo-loihi 1.1.0, ``hardware/builder.py``), the layout of the bundle's synapse words, and nothing of
lava-vpr. ``spikes.npz`` gets every spike of each POPULATION, bool (N, STEPS, width); counted, the membranes of the
counters, if there are any, after the last step, int32 (N, neurons); and read, the cores, synapses and axons found.

The emulator starts every presentation at 0, is given spikes and biases, and is read: what a board's program does to
clear, inject, write and read out is not shown here.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from nengo_loihi.block import Axon, LoihiBlock, Synapse, SynapseConfig
from nengo_loihi.builder.validate import validate_block
from nengo_loihi.emulator import EmulatorInterface
from nengo_loihi.inputs import SpikeInput

PARAMETERS = {
    "wgtLimitMant": "weight_limit_mant",
    "wgtLimitExp": "weight_limit_exp",
    "wgtExp": "weight_exp",
    "discMaxWgt": "disc_max_weight",
    "learningCfg": "learning_cfg",
    "tagBits": "tag_bits",
    "dlyBits": "delay_bits",
    "wgtBits": "weight_bits",
    "reuseSynData": "reuse_synapse_data",
    "numSynapses": "n_synapses",
    "cIdxOffset": "idx_offset",
    "cIdxMult": "idx_mult",
    "skipBits": "skip_bits",
    "idxBits": "idx_bits",
    "synType": "synapse_type",
    "fanoutType": "fanout_type",
    "compression": "compression",
    "stdpProfile": "stdp_cfg",
    "ignoreDly": "ignore_delay",
}
"""nengo-loihi's parameters of a synapse format by NxSDK's names (``hardware/builder.py:129-147``)."""

WORD, HEADER = 64, (4, 6)
"""Bits of a word of synapse memory, and of a block's format number and number of synapses less 1."""


class BundleCore:
    """One core of the bundle: its block, and the synapses and axons in it that its input axons lead to."""

    def __init__(self, folder: Path) -> None:
        name = folder.name.replace("chip", "").replace("core", "")
        self.place = tuple(int(number) for number in name.split("-"))
        read = {path.stem: np.load(path, allow_pickle=False) for path in folder.glob("*.npy")}
        self.registers = json.loads((folder / "registers.json").read_text())
        self.sources = read["axons_out"].astype(np.int64)
        compartments = read["compartments"].astype(np.int64)
        self.block, self.exponents = self._block(folder.name, compartments), compartments[:, 3]
        self.synapses, self.axons = self._synapses(read["synapses"], read["axons_in"].tolist())
        for synapse in self.synapses:
            self.block.add_synapse(synapse)

    def _block(self, label: str, table: np.ndarray) -> LoihiBlock:
        """The compartments, as their registers have them."""
        profile, threshold, mantissa, exponent = table.T
        profiles, limits = self.registers["cxProfileCfg"], self.registers["dendriteSharedCfg"]
        made = LoihiBlock(len(table), label=label)
        own = made.compartment
        own.decay_u, own.decay_v, own.refract_delay = (
            np.array([profiles[i][name] for i in profile], np.int32) for name in ("decayU", "decayV", "refractDelay")
        )
        own.scale_u = own.scale_v = False
        vth = np.array([entry["vth"] for entry in self.registers["vthProfileCfg"]], np.int64)
        own.vth = (vth[threshold] << 6).astype(np.int32)
        own.bias = (mantissa << exponent).astype(np.int32)
        own.vmin, own.vmax = 1 - (1 << limits["negVmLimit"]), (1 << 9 + 2 * limits["posVmLimit"]) - 1
        return made

    def _synapses(self, words: np.ndarray, entries: list[list[int]]) -> tuple[list[Synapse], list[tuple[int, int]]]:
        """One group of synapses for each format, with the rows of all input axons; each axon's group and row."""
        memory = np.unpackbits(words.astype("<u8").view(np.uint8), bitorder="little").astype(np.int64)
        formats = [
            None if form is None else SynapseConfig(**{PARAMETERS[name]: value for name, value in form.items()})
            for form in self.registers["synapseFmt"]
        ]
        rows: dict[int, list[Any]] = {}
        axons = []
        for first, length, count in entries:
            number, indices, weights = row(memory[WORD * first : WORD * (first + length)], count, formats)
            axons.append((number, len(rows.setdefault(number, []))))
            rows[number].append((indices, weights))
        groups = []
        for number, own in sorted(rows.items()):
            made = Synapse(len(own), label=f"format {number}")
            made._set_weights_indices([w for _, w in own], indices=[i for i, _ in own], weight_dtype=np.int32)
            made.synapse_cfg = formats[number]
            groups.append(made)
        order = {number: group for group, number in enumerate(sorted(rows))}
        return groups, [(order[number], position) for number, position in axons]


def numbers_in(bits: np.ndarray) -> np.ndarray:
    """The numbers that bits (..., width) hold, the least significant first."""
    return bits @ (1 << np.arange(bits.shape[-1]))


def row(bits: np.ndarray, count: int, formats: list[Any]) -> tuple[int, np.ndarray, np.ndarray]:
    """Format, compartments and weights, in units of u as the emulator adds them, of the row in ``bits``.

    A block: 4 bits format, 6 bits synapses less 1, then for each synapse its compartment, if the format has index bits,
    and its weight in two's complement, the upper bits of the register's 9; then nothing to the end of a word.
    """
    at, number, indices, weights = 0, 0, [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    while at < bits.size:
        number, size = (int(numbers_in(part)) for part in np.split(bits[at : at + sum(HEADER)], HEADER[:1]))
        at, size, own = at + sum(HEADER), size + 1, formats[number]
        wide, end = own.real_idx_bits, at + size * (own.real_idx_bits + own.real_weight_bits)
        each = bits[at:end].reshape(size, -1)
        indices.append(numbers_in(each[:, :wide]) if wide else sum(map(len, indices)) + np.arange(size))
        stored = numbers_in(each[:, wide:]) - (each[:, -1] << own.real_weight_bits)
        weights.append(((stored << own.shift_bits) * own.scale).astype(np.int64))
        at = end + -end % WORD
    found = np.concatenate(indices).astype(np.int32), np.concatenate(weights).astype(np.int32)
    if len(found[0]) != count:
        raise ValueError(f"a row has {len(found[0])} synapses, but its axon says {count}")
    return number, *found


def connect(source: Any, size: int, ways: np.ndarray, cores: dict[Any, BundleCore]) -> int:
    """Axons from ``source``, with so many compartments or inputs, along ``ways``; returns their number.

    A way is a compartment, chip, core and input axon. An axon of nengo-loihi leads each compartment to one input axon
    of one group of synapses, so there are as many as needed.
    """
    made: dict[Any, list[np.ndarray]] = {}
    for compartment, chip, core, axon in ways.tolist():
        target = cores[chip, core]
        group, number = target.axons[axon]
        maps = made.setdefault((chip, core, group), [])
        free = next((own for own in maps if own[compartment] < 0), None)
        if free is None:
            free = np.full(size, -1)
            maps.append(free)
        free[compartment] = number
    for (chip, core, group), maps in made.items():
        for own in maps:
            axon = Axon(int((own >= 0).sum()))
            axon.target = cores[chip, core].synapses[group]
            axon.set_compartment_axon_map(own)
            source.add_axon(axon)
    return len(ways)


def run(folder: Path, presentations: int, steps: int, names: list[str]) -> dict[str, np.ndarray]:
    """Every spike of the populations ``names``, what the counters hold, and what was read."""
    bundle = folder / "bundle"
    found = [BundleCore(path) for path in sorted((bundle / "cores").iterdir())]
    cores = {core.place: core for core in found}
    axons = sum(connect(core.block, core.block.n_neurons, core.sources, cores) for core in found)
    spikes, sources = np.zeros((presentations, steps, 0), bool), []
    if (folder / "spikes.npy").exists():
        spikes = np.load(folder / "spikes.npy", allow_pickle=False)
        sources = [SpikeInput(spikes.shape[2])]
        injection = np.load(bundle / "host" / "injection.npy", allow_pickle=False)
        axons += connect(sources[0], spikes.shape[2], injection, cores)
    for core in found:
        validate_block(core.block)
    blocks = [core.block for core in found]
    starts = dict(zip(cores, np.cumsum([0] + [block.n_neurons for block in blocks])))  # noqa: B905 (Python 3.8)
    tables = {path.stem: np.load(path, allow_pickle=False) for path in (bundle / "host").glob("*.npy")}
    have = [name for name in (*names, "counters") if name in tables]
    at = {name: np.array([starts[c, k] + i for c, k, i in tables[name].tolist()]) for name in have}
    mantissas, exponents = (dict(np.load(folder / f"{name}.npz")) for name in ("mantissas", "exponents"))
    own = np.concatenate([core.exponents for core in found])
    result = {name: np.zeros((presentations, steps, at[name].size), bool) for name in names}
    counted = np.zeros((presentations, len(at.get("counters", ()))), np.int32)
    for number, shown in enumerate(spikes):
        for source in sources:
            source.spikes.clear()
            for step, active in enumerate(shown):
                source.add_spikes(step + 1, np.flatnonzero(active))
        model = SimpleNamespace(blocks=blocks, inputs=sources, probes=[], dt=0.001)
        with EmulatorInterface(model, seed=0) as emulator:
            for name, written in mantissas.items():
                exponent = exponents[name][number] if name in exponents else own[at[name]]
                emulator.compartment.bias[at[name]] = written[number] << exponent
            for step in range(steps):
                emulator.step()
                for name, film in result.items():
                    film[number, step] = emulator.compartment.spiked[at[name]]
            if "counters" in at:
                counted[number] = emulator.compartment.voltage[at["counters"]]
    synapses = sum(weights.size for core in found for group in core.synapses for weights in group.weights)
    return result | {"counted": counted, "read": np.array([len(found), synapses, axons])}


def main(folder: str, presentations: str, steps: str, *names: str) -> None:
    """Run the bundle of ``folder`` on what is presented there and write what came of it."""
    found = run(Path(folder), int(presentations), int(steps), list(names))
    np.savez_compressed(Path(folder) / "spikes.npz", **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
