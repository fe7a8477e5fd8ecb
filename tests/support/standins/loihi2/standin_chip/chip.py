"""The chip: Lava's bit-accurate models, one step after the other, in one process."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
from lava.magma.compiler.builders.py_builder import PyProcessBuilder
from lava.proc.dense.models import PyDenseModelBitAcc
from lava.proc.lif.models import PyLifModelBitAcc, PyLifResetModelBitAcc
from lava.proc.sparse.models import PySparseModelBitAcc
from numpy.typing import NDArray

from standin_chip import note, options
from standin_chip.building import BoardBuilder
from standin_chip.checks import StandinError, check_var

MODELS = {
    "LIF": PyLifModelBitAcc,
    "LIFReset": PyLifResetModelBitAcc,
    "Dense": PyDenseModelBitAcc,
    "Sparse": PySparseModelBitAcc,
}
NEURONS = ("LIF", "LIFReset")
FAULTS = ("raise", "exit", "hang", "lose", "pause")
"""In a step the device is gone, its process dies, it never ends, no spikes come back, or the run ends early."""


class _Port:
    """Stands for a model's port: what is received, and what was sent."""

    def __init__(self) -> None:
        self.value: Any = None

    def recv(self) -> Any:
        return self.value

    def send(self, value: Any) -> None:
        self.value = np.array(value)


class _Part:
    """A Process on the chip, run by Lava's own model of it."""

    def __init__(self, builder: BoardBuilder) -> None:
        self.builder = builder
        own = PyProcessBuilder(MODELS[builder.kind], builder.process_id, builder.params)
        own.set_variables(builder.variables)
        self.model = own.build()
        self.neurons = builder.kind in NEURONS
        self.into, self.out = ("a_in", "s_out") if self.neurons else ("s_in", "a_out")
        setattr(self.model, self.into, _Port())
        setattr(self.model, self.out, _Port())

    def step(self, received: NDArray[Any]) -> NDArray[Any]:
        """Run one step; what it sends."""
        getattr(self.model, self.into).value = received
        self.model.time_step += 1
        self.model.run_spk()
        return np.asarray(getattr(self.model, self.out).value)


class Chip:
    """All Processes of the board, wired as they were compiled."""

    def __init__(self, nc: list[BoardBuilder], c: list[BoardBuilder]) -> None:
        self.parts = {builder.process_id: _Part(builder) for builder in nc}
        self.ins = [builder for builder in c if builder.kind == "PyToNxAdapter"]
        self.outs = [builder for builder in c if builder.kind == "NxToPyAdapter"]
        self.steps = 0
        asked = options()
        self.fault, self.fault_step = asked.get("fault"), asked.get("step", 0)
        if self.fault is not None and self.fault not in (*FAULTS, "no power"):
            raise StandinError(f"there is no fault {self.fault!r}")
        note(f"placed {', '.join(sorted(builder.kind for builder in (*nc, *c)))}")

    def channels(self) -> list[Any]:
        """Those to and from the host."""
        return [port for builder in (*self.ins, *self.outs) for port in builder.channels.values()]

    def ready(self) -> bool:
        """Whether the host has sent spikes for another step."""
        return bool(self.ins) and all(builder.channels["inp"].probe() for builder in self.ins)

    def set(self, process_id: int, var_id: int, value: NDArray[Any]) -> None:
        """Write a Var."""
        if "set" in options().get("refuse", ()):
            raise StandinError("a Var of the chip cannot be set")
        part = self.parts[process_id]
        name = part.model.var_id_to_var_map[var_id]
        if np.any(value != np.floor(value)):
            raise StandinError(f"{name} is written with fractions")
        whole = value.astype(np.int64)
        check_var(name, whole)
        if isinstance(getattr(part.model, name), np.ndarray):
            getattr(part.model, name).flat[:] = whole
        else:
            setattr(part.model, name, int(whole[0]))

    def get(self, process_id: int, var_id: int) -> NDArray[Any]:
        """Read a Var."""
        model = self.parts[process_id].model
        return np.atleast_1d(getattr(model, model.var_id_to_var_map[var_id])).astype(np.float64).ravel()

    def step(self) -> bool:
        """Run one step, exchanging spikes with the host; whether the run is to end early."""
        self.steps += 1
        fault = self.fault if self.steps == self.fault_step else None
        sent = {builder.process_id: builder.channels["inp"].recv() for builder in self.ins}
        if self.parts and "reset" in options().get("refuse", ()):  # only the first presentation begins at rest
            for part in self.parts.values():
                if part.neurons and hasattr(part.model, "reset_interval"):
                    part.model.reset_interval = 1 << 30
        if fault == "raise":
            raise ConnectionError("the board does not answer any more")
        if fault == "exit":
            os._exit(9)
        while fault == "hang":
            time.sleep(60)
        buffers = {i: np.array(part.model.a_buff) for i, part in self.parts.items() if not part.neurons}
        for i, part in self.parts.items():
            if part.neurons:  # what synapses summed up one step ago
                sent[i] = part.step(self._sum(part.builder, "a_in", buffers))
        for part in self.parts.values():
            if not part.neurons:
                part.step(self._sum(part.builder, "s_in", sent))
        for builder in self.outs:
            if fault != "lose":
                builder.channels["out"].send(self._sum(builder, "inp", sent).astype(np.int32))
        return fault == "pause"

    @staticmethod
    def _sum(builder: BoardBuilder, port: str, sent: dict[int, NDArray[Any]]) -> NDArray[Any]:
        """What arrives at a port."""
        total = np.zeros(builder.shapes[port], np.int32)
        for source, _ in builder.sources[port]:
            total = total + np.asarray(sent[source], np.int32)
        return total
