"""Models of `PlasticDense`."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.learning.learning_rule import Loihi2FLearningRule
from lava.proc.dense.process import LearningDense
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.engine.learning.integer import WeightRule, normalise, step_draws
from lava_vpr.engine.learning.integer_kernels import StepDraws, decay_traces, learn_column
from lava_vpr.engine.learning.lava_order import LibraryDraws
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import TRACE_LIMIT
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.float_rule import FloatRule
from lava_vpr.processes.base.library_parts import MISSING, LibrarySynapses, library_model, stand_for
from lava_vpr.processes.base.magma import AbstractSubProcessModel, LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.plastic_dense.process import PlasticDense


@library_model(PlasticDense, "fixed")
class SubPlasticDenseFixed(LibrarySynapses):
    """Lava's LearningDense, whose postsynaptic spikes come from ``s_in_post``."""

    def __init__(self, proc: PlasticDense) -> None:
        super().__init__(proc)
        proc.s_in_post.connect(self.synapses.s_in_bap)
        stand_for(proc, self.synapses, "x1")

    def made(self, proc: PlasticDense) -> LearningDense:
        """The library's Process with the weights and the rule of ``proc``.

        Raises:
            NetworkLimitError: what LearningDense lacks: weights that are normalised, presentations, records.
        """
        given, name = proc.proc_params, "PlasticDense"
        rule: WeightRule = given["rule"]  # no FloatRule: `PlasticDense.check_fixed` has seen it
        need(given["rng_seed"] is not None, f"{name}: rng_seed", None, "given with Lava's library")
        need(given["weight_sum"] == 0, f"{name}: weight_sum", given["weight_sum"], MISSING)
        shown = 0 if given["keys"] is None else len(given["keys"])
        need(shown <= 1, f"{name}: presentations", shown, "1 with Lava's library; clear x1 between them")
        for record in ("record_weights", "record_traces"):
            need(given[record] is None, f"{name}: {record}", "an array", MISSING)
        # Impulses saturate at 127: every spike sets its trace to that.
        stdp = Loihi2FLearningRule(
            dw=rule.microcode(),
            x1_impulse=TRACE_LIMIT,
            x1_tau=rule.tau,
            t_epoch=1,
            rng_seed=given["rng_seed"],
        )
        weights = proc.weights.init.astype(np.int32)
        exponent = given["weight_exp"]
        return LearningDense(weights=weights, weight_exp=exponent, learning_rule=stdp, sign_mode=SignMode.EXCITATORY)


@library_model(PlasticDense, "float")
class SubPlasticDenseFloat(AbstractSubProcessModel):
    """None: Lava's floating-point LearningDense scales the same rule differently."""

    def __init__(self, proc: PlasticDense) -> None:
        raise NetworkLimitError(
            "PlasticDense: Lava's floating-point LearningDense scales a rule otherwise than its fixed-point one; take "
            'select_tag="fixed_pt"'
        )


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
        steps = proc_params["steps"]
        self.interval = steps + proc_params["silent_steps"] if steps else 0  # 0: a presentation that never ends
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
        self.rule: WeightRule = proc_params["rule"]
        self.whole, self.fraction = self.rule.decay()
        self.products = self.rule.table()
        self.exponent: int = proc_params["weight_exp"]
        self.keys, self.weight_sum = proc_params["keys"], int(proc_params["weight_sum"])
        seed = proc_params["rng_seed"]
        self.library = None if seed is None else LibraryDraws(seed)
        self.draws: StepDraws  # of this presentation, or of this step of one that never ends

    def _begin(self, image: int) -> None:
        if self.library is None:
            self.draws = step_draws(int(self.keys[image]), self.interval)
        else:
            self.draws = self.library.next(self.interval)
        if self.weight_sum:
            normalise(self.weights.T, self.weight_sum, int(self.keys[image]))

    def _sums(self, pre: NDArray[np.bool_]) -> NDArray[np.int32]:
        sums = self.weights[:, pre].sum(axis=1, dtype=np.int32)
        return sums << self.exponent if self.exponent > 0 else sums >> -self.exponent

    def _decay(self, step: int) -> None:
        if self.library is not None and not self.interval:
            self.draws = self.library.next(1)
        decay_traces(self.x1, self.whole, self.fraction, self.draws.traces[step % len(self.draws.traces)])

    def _learn(self, spiking: NDArray[np.int64], step: int) -> None:
        columns, draw = self.weights.T, self.draws.weights[step % len(self.draws.weights)]
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
        self.rule: FloatRule = FloatRule.of(rule) if isinstance(rule, WeightRule) else rule
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
