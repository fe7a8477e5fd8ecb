"""Conductance-based integrate-and-fire neurons, the two populations of the ``paper`` preset."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.checked import check_shape
from lava_vpr.processes.base.magma import (
    AbstractProcess,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    Var,
    model_of,
)
from lava_vpr.processes.conductance.neurons import ConductanceNeuron

READY = 1 << 40
"""Steps since the last spike of a neuron that has never spiked."""


class ConductanceLIF(AbstractProcess):
    """A population of conductance-based neurons; floating point only::

        v += leak ((rest - v) + ge (e_exc - v) + gi (e_inh - v)), frozen for ``freeze`` steps after a spike
        spike if v > (theta - offset) + threshold, at least ``refractory`` steps after the last one
        then v = reset, theta += theta_plus

    What arrives in a Lava step was sent by spikes of the step before and is added to the conductances *first*: the
    same as adding it at the end of that step, after its thresholds, as Brian2's schedule does. So Lava's connections,
    which take one step, give Brian2's timing without any change. In the first step of a presentation all states but
    theta return to rest, and what arrives then is lost.

    Ports, all (neurons,): ``g_e_in`` excitatory conductance; ``g_i_in`` *minus the number* of inhibitory spikes, as
    `LateralInhibition` sends with an inhibition of 1, since each adds ``g_inh`` on its own; ``s_out`` spikes.
    Vars, all (neurons,): ``v``, ``ge``, ``gi``, ``theta``, ``since_spike`` (steps).
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        neuron: ConductanceNeuron,
        theta: float | NDArray[np.float64] = 0.0,
        interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make a population at rest.

        Args:
            shape: ``(neurons,)``.
            neuron: What they have in common.
            theta: Adaptive part of each threshold in mV, one value or (neurons,).
            interval: Steps of one presentation; 0: states are never reset.
        Raises:
            NetworkLimitError: a value outside its range.
        """
        super().__init__(shape=shape, neuron=neuron, theta=theta, interval=interval, **kwargs)
        check_shape("ConductanceLIF", shape)
        if interval < 0:
            raise NetworkLimitError(f"ConductanceLIF: interval is {interval}, but must be at least 0 steps")
        values = np.asarray(theta, np.float64)
        if values.shape not in ((), shape) or not np.isfinite(values).all():
            raise NetworkLimitError(
                f"ConductanceLIF: theta of shape {values.shape} must be finite, one value or of shape {shape}"
            )
        self.g_e_in = InPort(shape=shape)
        self.g_i_in = InPort(shape=shape)
        self.s_out = OutPort(shape=shape)
        self.v = Var(shape=shape, init=neuron.rest)
        self.ge = Var(shape=shape, init=0.0)
        self.gi = Var(shape=shape, init=0.0)
        self.theta = Var(shape=shape, init=np.broadcast_to(values, shape).copy())
        self.since_spike = Var(shape=shape, init=READY)


@model_of(ConductanceLIF, "float")
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
