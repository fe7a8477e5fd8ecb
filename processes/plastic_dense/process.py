"""All-to-all synapses that learn by STDP."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from lava.magma.core.learning.learning_rule import Loihi2FLearningRule
from lava.proc.dense.process import LearningDense
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need, stored_weights
from lava_vpr.engine.learning.integer import WeightRule, normalise, step_draws
from lava_vpr.engine.learning.integer_kernels import SILENT_STEPS, StepDraws, decay_traces, learn_column
from lava_vpr.engine.learning.lava_order import LibraryDraws
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import TRACE_LIMIT, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT
from lava_vpr.processes.base.library_parts import MISSING, LibrarySynapses, stand_for
from lava_vpr.processes.base.magma import (
    AbstractSubProcessModel,
    CheckedProcess,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    RegisterVar,
    Var,
    check_outputs,
    model_of,
    whole,
)

_EXPONENTS = f"in {-WEIGHT_EXPONENT_LIMIT}..{WEIGHT_EXPONENT_LIMIT}"


class FloatRule(NamedTuple):
    """On a postsynaptic spike ``w += eta (x - target) (w_max - w)^mu``, clipped to [0, w_max].

    The presynaptic trace x is set to 1 by a spike and decays by exp(-1 / tau) a step (the paper's rule, as
    `lava_vpr.engine.learning.stdp`).
    """

    eta: float
    target: float
    mu: float
    tau: float
    w_max: float

    @classmethod
    def of(cls, rule: WeightRule) -> FloatRule:
        """The rule that the integer ``rule`` approximates, for weights in 0..255."""
        eta = sum(mantissa * 2.0**exponent for mantissa, exponent in rule.products) / (1 << max(0, 9 * rule.mu - 4))
        return cls(eta * TRACE_LIMIT, rule.target / TRACE_LIMIT, float(rule.mu), rule.tau, float(WEIGHT_LIMIT))

    def check(self) -> None:
        """Refuse what makes no rule.

        Raises:
            NetworkLimitError: naming the part.
        """
        for name in ("eta", "target", "mu"):
            value = getattr(self, name)
            need(bool(np.isfinite(value)) and value >= 0, name, value, "a finite number, at least 0")
        for name in ("tau", "w_max"):
            value = getattr(self, name)
            need(bool(np.isfinite(value)) and value > 0, name, value, "a finite number above 0")


class PlasticDense(CheckedProcess):
    """All-to-all synapses with the STDP rule of `lava_vpr.engine.learning.integer` and `lava_vpr.engine.learning.stdp`.

    The order in a Lava step: send the sums of the previous step's spikes; receive this step's input spikes and sum
    their weights for the next step; let the traces decay and set those of spiking inputs; receive this step's
    postsynaptic spikes; learn. Sending comes before receiving, so that the postsynaptic population can be the one that
    this connection excites.

    With ``steps``, Lava steps are presentations of ``steps`` and ``silent_steps`` more. In the first step of each all
    traces are cleared and, with ``weight_sum``, each neuron's weights are brought to that sum: on a chip the host does
    this, since no learning engine sums over a neuron's synapses. After the last presentation nothing is learned.

    Lava's library uses a LearningDense instead, with separate random numbers (``rng_seed``). It takes one presentation:
    the caller clears the traces (``x1.set``) and normalises weights between two.

    Ports: ``s_in`` (inputs,), ``a_out`` (neurons,), ``s_in_post`` (neurons,), spikes of the same step. Vars:
    ``weights`` (neurons, inputs) as in Lava's Dense, ``x1`` traces (inputs,), ``a_buff`` (neurons,). Traces are 0..127
    in the fixed-point model and 0..1 in the floating-point one.
    """

    def __init__(
        self,
        *,
        weights: NDArray[Any],
        rule: WeightRule | FloatRule,
        weight_exp: int = 0,
        steps: int = 0,
        silent_steps: int = SILENT_STEPS,
        keys: NDArray[np.uint64] | None = None,
        weight_sum: float = 0,
        rng_seed: int | None = None,
        record_weights: NDArray[Any] | None = None,
        record_traces: NDArray[Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their start weights, the rule and the presentations that they learn from.

        Args:
            weights: Start weights (neurons, inputs): 0..255, or 0..w_max with a `FloatRule`.
            rule: Weight change and trace. The floating-point model takes either; it runs a `WeightRule` without
                rounding.
            weight_exp: Sums of weights are multiplied by 2^weight_exp (fixed point: shifted).
            steps: Steps with input of one presentation; 0: one that never ends.
            silent_steps: Steps without input at the end of a presentation.
            keys: Key of each presentation, uint64 (n,); their random numbers are those of the host engine.
            weight_sum: What each neuron's weights are normalised to before a presentation; 0: they are not.
            rng_seed: Random numbers instead of those of the keys: those of Lava's LearningDense with this seed
                (`lava_vpr.engine.learning.lava_order.LibraryDraws`).
            record_weights, record_traces: Filled at the end of each presentation, (n, neurons, inputs) and (n, inputs),
                uint8 or, for the floating-point model, float64; made by
                `lava_vpr.processes.base.shared_memory.shared_array`.
        Raises:
            NetworkLimitError: arrays that do not fit each other, or values that the learning engine cannot hold.
        """
        values = _checked_weights(weights, rule)
        need(abs(weight_exp) <= WEIGHT_EXPONENT_LIMIT, "weight_exp", weight_exp, _EXPONENTS)
        _check_timing(steps, silent_steps, keys, rng_seed, weight_sum)
        _check_records(values.shape, 0 if keys is None else len(keys), record_weights, record_traces)
        super().__init__(
            rule=rule,
            weight_exp=int(weight_exp),
            steps=int(steps),
            keys=keys,
            weight_sum=weight_sum,
            silent_steps=int(silent_steps),
            rng_seed=rng_seed,
            record_weights=record_weights,
            record_traces=record_traces,
            **kwargs,
        )
        self.rule = rule
        self.s_in = InPort(shape=(values.shape[1],))
        self.s_in_post = InPort(shape=(values.shape[0],))
        self.a_out = OutPort(shape=(values.shape[0],))
        self.weights = RegisterVar(values.shape, values, stored_weights)
        self.x1 = Var(shape=(values.shape[1],), init=0)
        self.a_buff = Var(shape=(values.shape[0],), init=0)

    def check_fixed(self) -> None:
        """Refuse a rule for floats.

        Raises:
            NetworkLimitError: the rule is a `FloatRule`.
        """
        fixed = isinstance(self.rule, WeightRule)
        need(
            fixed,
            "PlasticDense: rule",
            "a FloatRule",
            "a lava_vpr.engine.learning.integer.Rule for the fixed-point model",
        )

    def compile_kernels(self) -> None:
        """Compile the host engine's kernels, for weights as they lie in Lava's Vars, before the models are forked."""
        weights, x, rule = np.ones((2, 2), np.uint8).T, np.zeros(2, np.uint8), WeightRule(((1, 0),), 0, 0, 1.0)
        decay_traces(x, *rule.decay(), np.uint64(0))
        learn_column(weights, 0, x, rule.table(), rule.target, rule.mu, np.uint64(0))
        normalise(weights, 2, 0)


def _checked_weights(weights: NDArray[Any], rule: WeightRule | FloatRule) -> NDArray[Any]:
    """The start weights as the model of ``rule`` holds them.

    Raises:
        NetworkLimitError: naming what does not fit.
    """
    values = np.asarray(weights)
    need(values.ndim == 2 and values.size > 0, "PlasticDense: weights' shape", values.shape, "(neurons, inputs)")
    rule.check()
    if not isinstance(rule, FloatRule):
        return stored_weights(values)
    low, high = float(values.min()), float(values.max())
    need(0 <= low and high <= rule.w_max, "a weight", low if low < 0 else high, f"in 0..{rule.w_max}")
    return values


def _check_records(
    shape: tuple[int, ...], presentations: int, weights: NDArray[Any] | None, traces: NDArray[Any] | None
) -> None:
    """Refuse arrays for weights and traces of other than ``shape`` (neurons, inputs) and one entry a presentation.

    Raises:
        NetworkLimitError: naming the first.
    """
    for name, record, size in (("record_weights", weights, shape), ("record_traces", traces, shape[1:])):
        if record is not None:
            kind = np.float64 if record.dtype == np.float64 else np.uint8
            check_outputs("PlasticDense", **{name: (record, (presentations, *size), kind)})


def _check_timing(
    steps: int, silent_steps: int, keys: NDArray[np.uint64] | None, rng_seed: int | None, weight_sum: float
) -> None:
    """Refuse presentations without random numbers, and random numbers of another kind.

    Raises:
        NetworkLimitError: naming what does not fit.
    """
    need(steps >= 0, "steps", steps, "at least 0")
    need(silent_steps >= 0, "silent_steps", silent_steps, "at least 0")
    need(weight_sum >= 0, "weight_sum", weight_sum, "at least 0")
    if keys is not None:
        need(keys.dtype == np.uint64 and keys.ndim == 1, "PlasticDense: keys", keys.dtype, "uint64 (n,)")
    if rng_seed is not None:
        need(whole(rng_seed) and rng_seed >= 0, "PlasticDense: rng_seed", rng_seed, "a whole number, at least 0")
    need(keys is not None or rng_seed is not None, "PlasticDense: keys", None, "given, or rng_seed")
    need(keys is None or steps > 0, "PlasticDense: steps", steps, "at least 1 with keys")
    need(weight_sum == 0 or keys is not None, "PlasticDense: keys", None, "given with weight_sum")


@model_of(PlasticDense, "fixed")
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


@model_of(PlasticDense, "float")
class SubPlasticDenseFloat(AbstractSubProcessModel):
    """None: Lava's floating-point LearningDense scales the same rule differently."""

    def __init__(self, proc: PlasticDense) -> None:
        raise NetworkLimitError(
            "PlasticDense: Lava's floating-point LearningDense scales a rule otherwise than its fixed-point one; take "
            'select_tag="fixed_pt"'
        )


_HELD = {"a_out": (np.int32, 24), "weights": (np.uint8, 8), "x1": (np.uint8, 7), "a_buff": (np.int32, 24)}


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


@model_of(PlasticDense, "fixed", held=_HELD)
class PyPlasticDenseFixed(PlasticModel):
    """The host engine's kernels; equal to Lava's LearningDense where that can express the rule."""

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


@model_of(PlasticDense, "float", held=_HELD)
class PyPlasticDenseFloat(PlasticModel):
    """The rule in float64, without rounding; random numbers are not needed."""

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
