"""The bundle's cores without a board: registers and unpacked synapses run in numpy, step by step.

The arithmetic is that of nengo-loihi 1.1.0's emulator (emulator/interface.py): a current that wraps at 24 bits, a
membrane that is clipped, decays of magnitudes, a spike above the threshold. It says what the registers mean, not what a
chip does.
"""

from typing import Dict, List, Tuple

import numpy as np

from board_input import Query
from board_network import COUNTER_UNIT, Core, Network
from refusals import Refused

WRAP, EXPONENT = 1 << 23, 6


class Running:
    """One core: a value a compartment, and the rows of its input axons."""

    def __init__(self, core: Core) -> None:
        registers, table = core.registers, core.compartments.astype(np.int64)
        profiles = registers["cxProfileCfg"]
        if any(profile["refractDelay"] != 1 for profile in profiles):
            raise Refused("bundle", core.name + ": refractory steps are not simulated")
        self.keep_u = 4095 - np.array([profiles[i]["decayU"] for i in table[:, 0]], np.int64)
        self.keep_v = 4096 - np.array([profiles[i]["decayV"] for i in table[:, 0]], np.int64)
        self.level = np.array([registers["vthProfileCfg"][i]["vth"] for i in table[:, 1]], np.int64) << 6
        self.own_bias = table[:, 2] << table[:, 3]
        shared = registers["dendriteSharedCfg"]
        self.limits = 1 - (1 << shared["negVmLimit"]), (1 << 9 + 2 * shared["posVmLimit"]) - 1
        formats = registers["synapseFmt"]
        self.rows: List[Tuple[np.ndarray, np.ndarray]] = []
        for number, targets, weights in core.rows:
            shift, values = EXPONENT + formats[number]["wgtExp"], np.array(weights, np.int64)
            worth = np.abs(values) << shift if shift >= 0 else np.abs(values) >> -shift
            self.rows.append((np.array(targets, np.int64), np.sign(values) * worth))
        self.row_of_axon = core.row_of_axon.reshape(-1).tolist()
        self.out: Dict[int, list] = {}
        for source, chip, target, axon in core.axons_out.tolist():
            self.out.setdefault(source, []).append(((chip, target), axon))
        self.reset()

    def reset(self) -> None:
        """Everything to 0, biases as the bundle has them."""
        self.u, self.v, self.sums = np.zeros((3, len(self.level)), np.int64)
        self.bias = self.own_bias.copy()

    def receive(self, axon: int) -> None:
        """A spike at an input axon; it is felt in the next step."""
        targets, values = self.rows[self.row_of_axon[axon]]
        self.sums[targets] += values

    def step(self) -> list:
        """The axons that the spikes of this step go to."""
        decayed = np.sign(self.u) * (np.abs(self.u) * self.keep_u >> 12) + self.sums
        self.u, self.sums = (decayed + WRAP) % (2 * WRAP) - WRAP, np.zeros_like(self.sums)
        kept = np.sign(self.v) * (np.abs(self.v) * self.keep_v >> 12)
        self.v = np.clip(kept + self.u + self.bias, *self.limits)
        spikes = np.flatnonzero(self.v > self.level)
        self.v[spikes] = 0
        return [way for i in spikes.tolist() for way in self.out.get(i, ())]


class Simulation:
    """All cores of a bundle, which answer queries as the board would."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.cores = {place: Running(core) for place, core in network.of.items()}
        self.ways: List[list] = [[] for _ in range(network.inputs)]
        for number, chip, core, axon in network.injection.tolist():
            self.ways[number].append((chip, core, axon))

    def counts(self, query: Query) -> np.ndarray:
        """What the counters hold after a presentation, from rest, int32 (neurons,)."""
        network = self.network
        for core in self.cores.values():
            core.reset()
        self._set(query)
        for step in range(network.steps + network.silent):
            if network.bias_input and step == network.steps:
                for chip, core, compartment in network.sources.tolist():
                    self.cores[chip, core].bias[compartment] = 0
            sent = [way for core in self.cores.values() for way in core.step()]
            for place, axon in sent:
                self.cores[place].receive(axon)
            if not network.bias_input and step < network.steps:
                self._inject(query, step)
        held = [int(self.cores[chip, core].v[i]) for chip, core, i in network.counters.tolist()]
        wrong = [v for v in held if v < 0 or v % COUNTER_UNIT]
        if wrong:
            raise Refused("run", "a counter holds {}, which is no count of spikes".format(wrong[0]))
        return np.array(held, np.int32) // COUNTER_UNIT

    def _set(self, query: Query) -> None:
        """What is written before a presentation: biases and membranes of inputs, biases of neurons."""
        network = self.network
        for chip in network.chips:
            places = network.sources[network.sources[:, 0] == chip]
            for (_, core, i), (word, membrane) in zip(places.tolist(), query.settings.get(chip, [])):  # noqa: B905
                self.cores[chip, core].bias[i] = (int(word) & 0xFFF) << (int(word) >> 12)
                self.cores[chip, core].v[i] = membrane
            neurons = network.exc[network.exc[:, 0] == chip]
            for (_, core, i), word in zip(neurons.tolist(), query.biases.get(chip, [])):  # noqa: B905
                exponent = int(word) & 7
                self.cores[chip, core].bias[i] = (int(word) - exponent) // 8 * (1 << exponent)

    def _inject(self, query: Query, step: int) -> None:
        """The input spikes of a step, each at every axon of its chip."""
        for chip in self.network.chips:
            for number in np.flatnonzero(query.spikes[chip][step]).tolist():
                for target, core, axon in self.ways[number]:
                    if target == chip:
                        self.cores[chip, core].receive(axon)
