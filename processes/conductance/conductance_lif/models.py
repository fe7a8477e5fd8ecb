"""The floating-point model of `ConductanceLIF`; chips cannot run it (conductances multiply state by state)."""

from __future__ import annotations

from typing import Any

import numpy as np

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.conductance.conductance_lif.process import READY, ConductanceLIF
from lava_vpr.processes.conductance.neurons import ConductanceNeuron


@cpu_model(ConductanceLIF, "float")
class PyConductanceLIFFloat(PyLoihiProcessModel):
    """Euler's method in float64, operation by operation as `lava_vpr.engine.conductance.kernels` does it."""

    g_e_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, float)
    g_i_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, float)
    s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, bool, precision=1)
    v: np.ndarray = LavaPyType(np.ndarray, float)
    ge: np.ndarray = LavaPyType(np.ndarray, float)
    gi: np.ndarray = LavaPyType(np.ndarray, float)
    theta: np.ndarray = LavaPyType(np.ndarray, float)
    since_spike: np.ndarray = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.neuron: ConductanceNeuron = proc_params["neuron"]
        self.interval: int = proc_params["interval"]

    def run_spk(self) -> None:
        """Run one step: receive what arrives, advance the states, send the spikes, reset the neurons that fired."""
        excited, inhibiting = self.g_e_in.recv(), -self.g_i_in.recv()
        if self.interval > 0 and (self.time_step - 1) % self.interval == 0:
            self._rest()
        else:
            self.ge += excited
            # One spike after another: floating-point sums depend on how they are grouped.
            for spike in range(int(inhibiting.max())):
                self.gi += np.where(inhibiting > spike, self.neuron.g_inh, 0.0)
        fired = self._step(self.neuron)
        self.s_out.send(fired)
        self.v[fired] = self.neuron.reset
        self.theta[fired] += self.neuron.theta_plus
        self.since_spike[fired] = 0

    def _rest(self) -> None:
        """Bring all states but theta to rest, as a presentation begins with them."""
        self.v[:] = self.neuron.rest
        self.ge[:] = 0.0
        self.gi[:] = 0.0
        self.since_spike[:] = READY

    def _step(self, n: ConductanceNeuron) -> np.ndarray:
        """Advance all states by one step and return which neurons spike, bool (neurons,)."""
        self.since_spike += 1
        change = n.leak * ((n.rest - self.v) + self.ge * (n.e_exc - self.v) + self.gi * (n.e_inh - self.v))
        np.add(self.v, change, out=self.v, where=self.since_spike >= n.freeze)
        self.ge -= n.ge_decay * self.ge
        self.gi -= n.gi_decay * self.gi
        self.theta -= n.theta_decay * self.theta
        return (self.v > (self.theta - n.offset) + n.threshold) & (self.since_spike >= n.refractory)
