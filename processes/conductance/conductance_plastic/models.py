"""The floating-point model of `ConductancePlastic`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.conductance.kernels import NEVER, TRIPLET, Constants, normalise
from lava_vpr.engine.conductance.plastic import learn
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.conductance.conductance_plastic.process import ConductancePlastic


class _Arrivals:
    """The synapses that deliver a spike at each coming step, in the order of departure, then of input.

    A ring of lists, one for each step that a spike can still arrive in.
    """

    def __init__(self, delays: NDArray[np.integer]) -> None:
        """Set up for ``delays`` (neurons, inputs) in steps."""
        self.delays = np.ascontiguousarray(delays.T, np.int64)
        inputs, neurons = self.delays.shape
        self.slots = int(delays.max()) + 1
        self.rank = np.zeros((inputs, neurons), np.int64)  # among the synapses of one input with equal delays
        self.share = np.zeros((inputs, self.slots), np.int64)  # how many there are of each delay
        for delay in range(self.slots):
            equal = self.delays == delay
            self.rank[equal] = (np.cumsum(equal, axis=1) - 1)[equal]
            self.share[:, delay] = equal.sum(axis=1)
        self.synapse = np.arange(neurons) * inputs
        self.fill = np.zeros(self.slots, np.int64)
        self.queue = np.zeros((self.slots, 64), np.int64)

    def clear(self) -> None:
        """Forget all spikes on their way."""
        self.fill[:] = 0

    def depart(self, step: int, source: int) -> None:
        """Input ``source`` spikes at ``step``; call with the inputs of one step ascending."""
        self.fill += np.roll(self.share[source], step % self.slots)
        if self.fill.max() > self.queue.shape[1]:
            self.queue = np.pad(self.queue, ((0, 0), (0, int(self.fill.max()))))
        slot = (step + self.delays[source]) % self.slots
        last = self.fill[slot] - self.share[source, self.delays[source]]
        self.queue[slot, last + self.rank[source]] = self.synapse + source

    def take(self, step: int) -> NDArray[np.int64]:
        """Flat indices into (neurons, inputs) of the synapses that deliver at ``step``; the list is emptied."""
        slot = step % self.slots
        arrived = self.queue[slot, : self.fill[slot]].copy()
        self.fill[slot] = 0
        return arrived


@cpu_model(ConductancePlastic, "float")
class PyConductancePlasticFloat(PyLoihiProcessModel):
    """Weights in float64, changed by the kernels of the host engine."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    post_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    weights: np.ndarray = LavaPyType(np.ndarray, float)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.rule: int = proc_params["rule"]
        self.weight_sum: float = proc_params["weight_sum"]
        self.constants: Constants = proc_params["constants"]
        self.traces = proc_params["traces"]
        shape = proc_params["delays"].shape
        self.arrivals = _Arrivals(proc_params["delays"])
        self.arrived = np.full(shape, NEVER, np.int64)  # the step at which each synapse last delivered
        self.post = np.full(shape[0], NEVER, np.int64)  # the neurons' last spikes
        self.drive = np.zeros(shape[0])

    def run_spk(self) -> None:
        """Send what arrived in the last step, take what arrives in this one, and learn from its postsynaptic spikes."""
        step = (self.time_step - 1) % self.constants.total
        if step == 0:
            self._begin()
        self.a_out.send(self.drive)
        for source in np.flatnonzero(self.s_in.recv()):
            self.arrivals.depart(step, int(source))
        self._arrive(step)
        self._learn(step, np.flatnonzero(self.post_in.recv()))

    def _begin(self) -> None:
        """Begin a presentation: weights are normalised, traces and spikes on their way are lost."""
        normalise(self.weights, self.weight_sum)
        self.arrivals.clear()
        self.arrived[:] = NEVER
        self.post[:] = NEVER
        self.drive[:] = 0.0

    def _arrive(self, step: int) -> None:
        """Weights are read, and then changed by the trace of earlier postsynaptic spikes."""
        synapses = self.arrivals.take(step)
        neurons = synapses // self.weights.shape[1]
        flat = self.weights.reshape(-1)
        self.drive[:] = 0.0
        np.add.at(self.drive, neurons, flat[synapses])  # one after another, in the order of arrival
        self.arrived.reshape(-1)[synapses] = step
        if self.rule == TRIPLET:
            fresh = self._post_trace(step, 1)
            flat[synapses] = np.clip(
                flat[synapses] + (self.constants.eta_pre * fresh)[neurons], 0.0, self.constants.w_max
            )

    def _learn(self, step: int, fired: NDArray[np.int64]) -> None:
        """The neurons ``fired`` spike: what arrived before decides what becomes of their weights."""
        post2 = self._post_trace(step, 2)
        for i in fired:
            learn(self.weights[i], self.arrived[i], step, self.traces[0], post2[i], self.rule, self.constants)
        self.post[fired] = step

    def _post_trace(self, step: int, trace: int) -> NDArray[np.float64]:
        """The postsynaptic traces as they are now, (neurons,)."""
        spiked = self.post != NEVER
        return np.where(spiked, self.traces[trace, np.where(spiked, step - self.post, 0)], 0.0)
