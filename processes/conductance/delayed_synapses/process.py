"""All-to-all synapses with delays, whose weights stay or follow the spikes of both sides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.conductance.kernels import NEVER, TRIPLET, Constants, learn, normalise
from lava_vpr.engine.conductance.model import RULES, trace_table
from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.magma import (
    AbstractProcess,
    CheckedProcess,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    Var,
    model_of,
)
from lava_vpr.settings.conductance import ConductanceLearning

MAX_DELAY = 65534
"""Steps; delays are kept as 16 bits, as in the model file."""


def check_synapses(owner: str, weights: NDArray[np.float64], delays: NDArray[np.integer], interval: int) -> None:
    """Refuse weights, delays and presentation lengths that cannot form a network.

    Raises:
        NetworkLimitError: naming what is out of range.
    """
    if weights.ndim != 2 or weights.size == 0 or delays.shape != weights.shape:
        raise NetworkLimitError(
            f"{owner}: weights {weights.shape} and delays {delays.shape} must be of one shape, (neurons, inputs)"
        )
    if not np.isfinite(weights).all():
        raise NetworkLimitError(f"{owner}: a weight is not finite; train the model again")
    if not np.issubdtype(delays.dtype, np.integer):
        raise NetworkLimitError(f"{owner}: delays of type {delays.dtype} must be whole steps; round them")
    if delays.min() < 0 or delays.max() > MAX_DELAY:
        raise NetworkLimitError(
            f"{owner}: delays of {delays.min()}..{delays.max()} steps must lie in 0..{MAX_DELAY}; lengthen the step"
        )
    if interval < 0:
        raise NetworkLimitError(f"{owner}: interval is {interval}, but must be at least 0 steps")


class DelayedDense(AbstractProcess):
    """All-to-all synapses; a spike sent at step t reaches neuron i, weighted, at step t + 1 + ``delays[i, j]``.

    The one step is every Lava connection's own. At the first step of a presentation all spikes on their way are lost.

    Ports: ``s_in`` spikes (inputs,), ``a_out`` summed weights (neurons,). Vars: ``weights`` (neurons, inputs).
    """

    def __init__(
        self,
        *,
        weights: NDArray[np.float64],
        delays: NDArray[np.integer],
        interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their weights and delays.

        Args:
            weights: float64 (neurons, inputs), as in Lava's Dense.
            delays: Whole steps in 0..65534, of the same shape.
            interval: Steps of one presentation; 0: nothing is ever lost.
        Raises:
            NetworkLimitError: arrays of different shapes, or a value outside its range.
        """
        super().__init__(weights=weights, delays=delays, interval=interval, **kwargs)
        check_synapses("DelayedDense", weights, delays, interval)
        self.s_in = InPort(shape=(weights.shape[1],))
        self.a_out = OutPort(shape=(weights.shape[0],))
        self.weights = Var(shape=weights.shape, init=weights)


@model_of(DelayedDense, "float")
class PyDelayedDenseFloat(PyLoihiProcessModel):
    """A ring of sums, one row for each step in which spikes can still arrive.

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


class ConductancePlastic(CheckedProcess):
    """`DelayedDense` that learns: at the step at which a spike arrives, the neuron first takes its weight, then::

        triplet: w += eta_pre post1, when an input arrives;  w += eta_post x_pre post2, when the neuron spikes
        paper:   w += eta_post (x_pre - x_target) (w_max - w)^mu, when the neuron spikes

    with weights kept in [0, w_max], and post1, post2 those of the neuron's *earlier* spikes. Before each presentation
    a neuron's weights are scaled to the sum ``weight_sum``; traces and spikes on their way are lost.

    Ports: ``s_in`` input spikes (inputs,), ``post_in`` the neurons' own spikes (neurons,), ``a_out`` summed weights
    (neurons,). Vars: ``weights`` (neurons, inputs).
    """

    def __init__(
        self,
        *,
        weights: NDArray[np.float64],
        delays: NDArray[np.integer],
        learning: ConductanceLearning,
        constants: Constants,
        dt_ms: float,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their start weights, their delays and the rule that they learn by.

        Args:
            weights: At the start, float64 (neurons, inputs), as in Lava's Dense.
            delays: Whole steps in 0..65534, of the same shape.
            learning: The rule and its ``weight_sum``.
            constants: Those of `engine.conductance.model.constants` with ``learn``; a presentation has ``total`` steps.
            dt_ms: Length of a step.
        Raises:
            NetworkLimitError: arrays of different shapes, or a value outside its range.
        """
        super().__init__(
            weights=weights,
            delays=delays,
            rule=RULES[learning.rule],
            weight_sum=learning.weight_sum,
            constants=constants,
            traces=trace_table(constants.total, dt_ms),
            **kwargs,
        )
        if constants.total < 1:
            raise NetworkLimitError(f"ConductancePlastic: a presentation of {constants.total} steps; give at least 1")
        check_synapses("ConductancePlastic", weights, delays, constants.total)
        self.s_in = InPort(shape=(weights.shape[1],))
        self.post_in = InPort(shape=(weights.shape[0],))
        self.a_out = OutPort(shape=(weights.shape[0],))
        self.weights = Var(shape=weights.shape, init=weights)

    def compile_kernels(self) -> None:
        """Compile what the model calls, before Lava forks its processes."""
        weights, arrived = np.zeros((1, 1)), np.zeros(1, np.int64)
        normalise(weights, 1.0)
        c, traces = self.proc_params["constants"], self.proc_params["traces"]
        learn(weights[0], arrived, 0, traces[0], 0.0, 0, c)


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


@model_of(ConductancePlastic, "float")
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
