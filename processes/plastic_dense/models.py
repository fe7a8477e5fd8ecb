"""Models of `PlasticDense`."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.model.py.model import PyLoihiProcessModel
from lava.magma.core.model.py.ports import PyInPort, PyOutPort
from lava.magma.core.model.py.type import LavaPyType
from numpy.typing import NDArray

from lava_vpr.engine.learning.integer import Rule, normalise, step_draws
from lava_vpr.engine.learning.integer_kernels import StepDraws, decay_traces, learn_column
from lava_vpr.loihi import TRACE_LIMIT
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.float_rule import FloatRule
from lava_vpr.processes.plastic_dense.process import PlasticDense, interval_of


class PlasticModel(PyLoihiProcessModel):
    """The base of both models runs a step; each begins presentations, sums, decays and learns in its arithmetic."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    s_in_post: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort
    weights: NDArray[Any]
    x1: NDArray[Any]
    a_buff: NDArray[Any]
    top: float

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.interval = interval_of(proc_params["steps"])
        self.presentations = 0 if proc_params["keys"] is None else len(proc_params["keys"])
        self.records = {"weights": proc_params["record_weights"], "x1": proc_params["record_traces"]}

    def run_spk(self) -> None:
        """Send the last step's sums, take this step's input and postsynaptic spikes, and learn from both."""
        image, step = divmod(self.time_step - 1, self.interval) if self.interval else (0, self.time_step - 1)
        learning = self.presentations == 0 or image < self.presentations
        if step == 0 and self.interval and learning:
            self.x1[:] = 0
            self.a_buff[:] = 0
            self._begin(image)
        self.a_out.send(self.a_buff)
        pre = self.s_in.recv().astype(bool)
        self.a_buff = self._sums(pre)
        if learning:
            self._decay(step)
            self.x1[pre] = self.top
        post = self.s_in_post.recv()
        if learning:
            self._learn(np.flatnonzero(post), step)
            if step == self.interval - 1:
                for name, record in self.records.items():
                    if record is not None:
                        record[image] = getattr(self, name)


@cpu_model(PlasticDense, "fixed")
class PyPlasticDenseFixed(PlasticModel):
    """The host engine's kernels; equal to Lava's LearningDense where that can express the rule."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, np.int32, precision=24)
    weights: NDArray[np.uint8] = LavaPyType(np.ndarray, np.uint8, precision=8)
    x1: NDArray[np.uint8] = LavaPyType(np.ndarray, np.uint8, precision=7)
    a_buff: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=24)
    top = TRACE_LIMIT

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.rule: Rule = proc_params["rule"]
        self.whole, self.fraction = self.rule.decay()
        self.products = self.rule.table()
        self.exponent: int = proc_params["weight_exp"]
        self.keys, self.weight_sum = proc_params["keys"], int(proc_params["weight_sum"])
        self.stream: StepDraws | None = proc_params["draws"]  # of the whole run
        self.draws: Any = self.stream  # of this presentation

    def _begin(self, image: int) -> None:
        if self.stream is None:
            self.draws = step_draws(int(self.keys[image]), self.interval)
        else:
            self.draws = StepDraws(*(part[image * self.interval :] for part in self.stream))
        if self.weight_sum:
            normalise(self.weights.T, self.weight_sum, int(self.keys[image]))

    def _sums(self, pre: NDArray[np.bool_]) -> NDArray[np.int32]:
        sums = self.weights[:, pre].sum(axis=1, dtype=np.int32)
        return sums << self.exponent if self.exponent > 0 else sums >> -self.exponent

    def _decay(self, step: int) -> None:
        if step < len(self.draws.traces):
            decay_traces(self.x1, self.whole, self.fraction, self.draws.traces[step])

    def _learn(self, spiking: NDArray[np.int64], step: int) -> None:
        if step < len(self.draws.weights):
            columns, draw = self.weights.T, self.draws.weights[step]
            for i in spiking:
                learn_column(columns, i, self.x1, self.products, self.rule.target, self.rule.mu, draw)


@cpu_model(PlasticDense, "float")
class PyPlasticDenseFloat(PlasticModel):
    """The rule in float64, without rounding; random numbers are not needed."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    weights: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    x1: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    a_buff: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    top = 1.0

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        rule = proc_params["rule"]
        self.rule: FloatRule = FloatRule.of(rule) if isinstance(rule, Rule) else rule
        self.factor, self.keep = 2.0 ** proc_params["weight_exp"], float(np.exp(-1.0 / self.rule.tau))
        self.weight_sum: float = proc_params["weight_sum"]

    def _begin(self, image: int) -> None:
        if self.weight_sum:
            sums = self.weights.sum(axis=1, keepdims=True)
            np.multiply(self.weights, self.weight_sum / sums, out=self.weights, where=sums > 0)

    def _sums(self, pre: NDArray[np.bool_]) -> NDArray[np.float64]:
        return self.weights[:, pre].sum(axis=1) * self.factor

    def _decay(self, step: int) -> None:
        self.x1 *= self.keep

    def _learn(self, spiking: NDArray[np.int64], step: int) -> None:
        rule, w = self.rule, self.weights[spiking]
        change = rule.eta * (self.x1 - rule.target)
        self.weights[spiking] = np.clip(w + change * (rule.w_max - w) ** rule.mu, 0.0, rule.w_max)
