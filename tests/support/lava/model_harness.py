"""Runs the model of a Lava Process step by step without Lava's runtime.

Used by processes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Wire:
    """Stands for a port: what is to be received, and what was sent."""

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        self.waiting, self.sent, self.dtype = np.zeros(shape, dtype), np.zeros(shape, dtype), dtype

    def recv(self) -> NDArray[Any]:
        return np.zeros(self.waiting.shape, self.dtype) + self.waiting

    def send(self, data: NDArray[Any]) -> None:
        self.sent = data.astype(self.dtype)  # a copy, as in Lava's channels


def build(process: Any, kind: Any) -> Any:
    """The model of a Process as Lava builds it, without Lava's runtime."""
    model = kind(process.proc_params)
    for ports in (process.in_ports, process.out_ports):
        for port in ports:
            setattr(model, port.name, Wire(port.shape, getattr(kind, port.name).d_type))
    for var in process.vars:
        wanted = getattr(kind, var.name)
        value = var.init
        if wanted.cls is np.ndarray:
            value = np.ndarray(var.shape, wanted.d_type)
            value[:] = var.init
        setattr(model, var.name, value)
    return model


def drive(model: Any, given: NDArray[Any] | int, port_in: str = "", port_out: str = "") -> NDArray[Any]:
    """What a model sends in each step, given what it receives (or for how many steps)."""
    sent = []
    for step in range(given if isinstance(given, int) else len(given)):
        model.time_step = step + 1
        if not isinstance(given, int):
            getattr(model, port_in).waiting = given[step]
        model.run_spk()
        sent.append(getattr(model, port_out).sent if port_out else 0)
    return np.array(sent)
