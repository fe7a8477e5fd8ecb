"""The floating-point model of `DelayedDense`."""

from __future__ import annotations

from typing import Any

import numpy as np

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.conductance.delayed_dense.process import DelayedDense


@cpu_model(DelayedDense, "float")
class PyDelayedDenseFloat(PyLoihiProcessModel):
    """A ring of sums, one row for each step that spikes can still arrive in.

    Weights that arrive together are added in the order of departure, then of input, as the host engine adds them.
    """

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    weights: np.ndarray = LavaPyType(np.ndarray, float)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.interval: int = proc_params["interval"]
        delays = proc_params["delays"]
        self.delays = np.ascontiguousarray(delays.T, np.int64)  # row by row: the synapses of one input
        self.arriving = np.zeros((int(delays.max()) + 1, len(delays)))
        self.posts = np.arange(len(delays))

    def run_spk(self) -> None:
        """Send what arrives from the spikes up to the last step, then receive this step's."""
        step = (self.time_step - 1) % self.interval if self.interval > 0 else self.time_step - 1
        if step == 0:
            self.arriving[:] = 0.0
        now = self.arriving[(step - 1) % len(self.arriving)]
        self.a_out.send(now)
        now[:] = 0.0
        for j in np.flatnonzero(self.s_in.recv()):
            self.arriving[(step + self.delays[j]) % len(self.arriving), self.posts] += self.weights[:, j]
