"""One step of all cores, from nothing but what was configured; the state is the memory that embedded programs see."""

from __future__ import annotations

from typing import Any

import numpy as np

from nxsdk_standin.cores import Axon, Chip, Core
from nxsdk_standin.faults import StandinError
from nxsdk_standin.registers import held

ACCUMULATOR = held("sum of the weights of one step, on Loihi 1")  # weight units
TOP = held("u wraps beyond, v is clipped to this less 1")


class Running:
    """A core that runs."""

    def __init__(self, core: Core, memory: Any) -> None:
        self.core, self.memory = core, memory
        net = core.network
        self.rows, self.limits, self.decays = net["rows"], net["limits"], net["decays"]
        self.n = len(net["table"])
        config = memory["config"][: self.n]
        for i, name in enumerate(("VthProfile", "CxProfile", "Bias", "BiasExp")):
            config[name] = net["table"][:, i]
        self.levels = np.array([net["levels"][number] for number in net["table"][:, 0]], np.int64) << 6
        self.out: dict[int, list[Axon]] = {}
        for axon in core.axons:
            self.out.setdefault(axon.source, []).append(axon)
        self.arrived: list[int] = []

    def receive(self, axon: int) -> None:
        """A spike that is felt in the next step."""
        if not 0 <= axon < len(self.rows):
            raise StandinError(f"{self.core.where}a spike came to input axon {axon} of {len(self.rows)}")
        self.arrived.append(axon)

    def step(self) -> list[int]:
        """The compartments that spike."""
        received = np.zeros(self.n, np.int64)
        for axon in self.arrived:
            places, values = self.rows[axon]
            received[places] += values
        self.arrived = []
        if (np.abs(received) >> 6 >= ACCUMULATOR).any():
            raise StandinError(f"{self.core.where}an accumulator overflows")
        state, config = self.memory["state"][: self.n], self.memory["config"][: self.n]
        u, v = state["U"].astype(np.int64), state["V"].astype(np.int64)
        u = np.sign(u) * (np.abs(u) * (4095 - self.decays[:, 0]) >> 12) + received
        u = (u + TOP) % (2 * TOP) - TOP
        v = np.sign(v) * (np.abs(v) * (4096 - self.decays[:, 1]) >> 12) + u
        v = np.clip(v + (config["Bias"].astype(np.int64) << config["BiasExp"]), *self.limits)
        v[self.memory["stands"][: self.n] != 0] = 0
        spikes = v > self.levels
        v[spikes] = 0
        state["U"], state["V"] = u, v
        return [int(i) for i in np.flatnonzero(spikes)]


def check_axons(chips: list[Chip]) -> None:
    """Every output axon leads to an input axon that exists."""
    cores = {(chip.id, core.id): core for chip in chips for core in chip.n2CoresAsList if core.used}
    for core in cores.values():
        for axon in core.axons:
            target = cores.get((axon.chip, axon.core))
            if target is None or not 0 <= axon.axon < len(target.network["rows"]):
                raise StandinError(f"{core.where}{axon} leads nowhere")


class Machine:
    """All cores and embedded programs of a board, in step."""

    def __init__(self, board: Any) -> None:
        self.chips, self.snips, self.time = board.n2Chips, board.snips, 0
        self.cores: dict[tuple[int, int], Running] = {}
        spare = np.zeros(256, dtype=self.snips[0].memory.dtype) if self.snips else None
        for chip in self.chips:
            own = [snip.memory for snip in self.snips if snip.chip is chip]
            memory = own[0] if own else spare.copy()
            for core in chip.n2CoresAsList:
                if core.used:
                    self.cores[chip.id, core.id] = Running(core, memory[core.id])

    def step(self, call: Any) -> None:
        """One step; ``call`` runs all embedded programs."""
        self.time += 1
        sent = []
        for running in self.cores.values():
            for source in running.step():
                sent += running.out.get(source, [])
        for axon in sent:
            self.cores[axon.chip, axon.core].receive(axon.axon)
        call(self.time)
        for snip in self.snips:
            for core, axon in snip.injected:
                self.cores[snip.chip.id, core].receive(axon)
