"""Learning places by STDP in Loihi's integers: 8-bit weights, 7-bit traces, the rule as a sum of products.

One presentation, step by step, with the delays and the arithmetic of Lava (lava-nc 0.10; its ``proc/lif``, and for the
plasticity ``magma/core/model/py/connection.py`` and ``magma/core/learning``)::

    a      = sum of weights of the inputs that spiked one step ago
             - inhibition, if any neuron spiked two steps ago, but not from those that did
    v      = clip(D(v, 4096 - dv) + (a << 6)), not below the floor, 0 while held after a spike
    spike    if v > threshold << 6, then v = 0, threshold += theta_plus
    x      = floor(x e^(-1/tau)), plus 1 with the probability of the fraction (stochastic rounding);
             127 if the input spikes
    on a spike: w = round(w + sum of S 2^E (x - target) (255 - w)^mu), stochastically, within 0..255

Stochastic rounding uses one random number for all traces of a step and one for all weights of a step, as Lava does.
Between presentations the host normalises each neuron's weights to the same sum; no learning engine can, since that
needs a sum over a neuron's synapses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import StdpLearning
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.inference.biases import slopes
from lava_vpr.engine.inference.quantise import mantissa_of
from lava_vpr.engine.learning.integer_kernels import (
    SILENT_STEPS,
    IntegerPhase,
    StepDraws,
    column_sums,
    scale_columns,
    train,
)
from lava_vpr.engine.learning.stdp import PlasticState, mean_trace, of_both, start_weights
from lava_vpr.engine.presentations import check_array, check_rates
from lava_vpr.engine.random import derived_key, uniform
from lava_vpr.errors import ConfigError, InputError, NetworkLimitError
from lava_vpr.loihi import (
    DECAY_UNITY,
    INPUT_LIMIT,
    PRODUCT_EXPONENTS,
    PRODUCT_MANTISSAS,
    THRESHOLD_LIMIT,
    TRACE_LIMIT,
    WEIGHT_LIMIT,
)

AGAIN = "use the arrays of one network"


@dataclass(frozen=True)
class WeightRule:
    """Weight change on a postsynaptic spike, ``sum of mantissa 2^exponent y0 (x1 - target) (255 - w)^mu``.

    Attributes:
        products: (mantissa, exponent) of each product; mantissas in -8..7, exponents in -7..8.
        target: What is subtracted from the trace.
        mu: Power of the distance to the largest weight: 0, 1 or 2 (microcode has no other).
        tau: Decay of the trace, in steps.
    """

    products: tuple[tuple[int, int], ...]
    target: int
    mu: int
    tau: float

    def check(self) -> None:
        """Refuse what Loihi's learning engine cannot express.

        Raises:
            NetworkLimitError: naming the part.
        """
        for mantissa, exponent in self.products:
            most = mantissa == -8 and exponent == max(PRODUCT_EXPONENTS)  # Lava's parser moves it out of range
            if mantissa not in PRODUCT_MANTISSAS or exponent not in PRODUCT_EXPONENTS or most:
                raise NetworkLimitError(
                    f"a product {mantissa} x 2^{exponent} does not fit mantissas -8..7 and exponents -7..8; "
                    "change learning.eta"
                )
        if self.mu not in (0, 1, 2):
            raise NetworkLimitError(f"mu {self.mu} is no sum of products; use learning.mu 0, 1 or 2")
        if not 0 <= self.target <= TRACE_LIMIT:
            raise NetworkLimitError(f"x_target {self.target} is no 7-bit trace; lower learning.x_target")
        if not self.tau >= 1:
            raise NetworkLimitError(f"a trace that decays within {self.tau} steps leaves nothing; use at least 1")

    def microcode(self) -> str:
        """The rule in the notation of Lava's learning rules (``dw``)."""
        factors = f"*(x1-{self.target})" + "*(255-w)" * self.mu
        terms = [f"{mantissa}*2^{exponent}*y0{factors}" for mantissa, exponent in self.products]
        return " + ".join(terms).replace("+ -", "- ")  # Lava cannot read a sign after a sign

    def decay(self) -> tuple[NDArray[np.uint8], NDArray[np.uint64]]:
        """Decay of each trace 0..127 in one step: its whole part, and the probability of rounding up in units of 2^-53.

        A trace rounds up when a draw of 53 bits is below that.
        """
        value = np.exp(-1 / self.tau) * np.arange(TRACE_LIMIT + 1)
        return np.floor(value).astype(np.uint8), np.ceil((value % 1) * 2.0**53).astype(np.uint64)

    def table(self) -> NDArray[np.int64]:
        """The products as the kernel takes them, (n, 2): mantissa, left shift; -8 2^E is -4 2^(E + 1), as in Lava."""
        read = [(-4, e + 1) if m == -8 and e + 1 in PRODUCT_EXPONENTS else (m, e) for m, e in self.products]
        return np.array([(mantissa, exponent + 7) for mantissa, exponent in read], np.int64).reshape(-1, 2)


def products(rate: float) -> tuple[tuple[int, int], ...]:
    """``rate``, a multiple of 2^-7 after rounding, as a sum of mantissa 2^exponent, mantissas at most 7."""
    left = round(rate * 128)
    parts = []
    while left:
        exponent = max(0, left.bit_length() - 3)
        parts.append((left >> exponent, exponent - 7))
        left -= left >> exponent << exponent
    return tuple(parts)


@dataclass(frozen=True)
class IntegerLearning:
    """One phase of learning in integers, which every machine and Lava's Processes run exactly.

    Attributes:
        rule: Weight change and trace.
        inhibition: What the inhibitory neuron subtracts from every neuron except those whose spikes made it fire, in
            units of the input sum.
        neurons: As in `LifParameters`: membrane decay, floor, hold, and what a spike adds to its neuron's threshold.
        weight_sum: Sum to which the host normalises each neuron's weights before a presentation; 0: no normalisation.
        steps: Steps with input in one presentation.
        silent_steps: Steps without input that follow, at least `SILENT_STEPS`.
        late_theta: Thresholds rise after a presentation, by the host, instead of at each spike.
        regular: Inputs spike regularly (`engine.inference.biases`), not by Poisson draws.
    """

    rule: WeightRule
    inhibition: int
    neurons: LifParameters
    weight_sum: int
    steps: int
    late_theta: bool = False
    regular: bool = False
    silent_steps: int = SILENT_STEPS

    @property
    def interval(self) -> int:
        """Steps of one presentation, the silent ones included."""
        return self.steps + self.silent_steps

    def check(self) -> None:
        """Refuse a phase that the chip cannot hold.

        Raises:
            NetworkLimitError: naming need, limit and remedy.
        """
        self.rule.check()
        self.neurons.check()
        if self.inhibition >= INPUT_LIMIT:
            raise NetworkLimitError(
                f"inhibition is {self.inhibition:,} while learning, but Loihi's 24-bit current holds less than "
                f"{INPUT_LIMIT:,}; lower learning.inhibition"
            )


def unit(learning: StdpLearning, spikes_per_step: float) -> float:
    """Units of the input sum per float unit of the membrane."""
    return learning.mean_weight / learning.w_max * WEIGHT_LIMIT * spikes_per_step / learning.drive


def _lateral(learning: StdpLearning, per_unit: float) -> int:
    """Inhibition as lateral synapses hold it, 8 bits and an exponent."""
    mantissa, exponent = mantissa_of(learning.inhibition * per_unit, WEIGHT_LIMIT)
    return mantissa << exponent


def phases(learning: StdpLearning, inputs: int, spikes_per_step: float) -> tuple[IntegerLearning, IntegerLearning]:
    """Competition and consolidation of float settings, in integers.

    Raises:
        ConfigError: a setting that integers cannot express.
        NetworkLimitError: the network could overflow.
    """
    if learning.mu not in (0, 1, 2):
        raise ConfigError(f"learning.mu is {learning.mu!r}, but must be 0, 1 or 2 with --learning integer")
    per_unit = unit(learning, spikes_per_step)
    scale = WEIGHT_LIMIT / learning.w_max
    mu = int(learning.mu)

    def phase(eta: float, tau: float, target: float, theta_plus: float) -> IntegerLearning:
        # (x - target) is in units of 1/127 here, (w_max - w) and the change itself in units of 1/scale; the products of
        # mu > 0 lose 9 mu - 4 bits to the 15-bit accumulator.
        rate = eta * scale / TRACE_LIMIT / scale**mu * (1 << max(0, 9 * mu - 4))
        x_target = target * mean_trace(inputs, spikes_per_step, tau)
        return IntegerLearning(
            rule=WeightRule(products(rate), round(x_target * TRACE_LIMIT), mu, tau),
            inhibition=_lateral(learning, per_unit),
            neurons=LifParameters(
                dv=min(DECAY_UNITY - 1, round(DECAY_UNITY / learning.tau_membrane)),
                floor=round(learning.floor * per_unit),
                hold_steps=learning.hold_steps,
                theta_plus=round(theta_plus * per_unit),
            ),
            weight_sum=round(learning.mean_weight * scale * inputs),
            steps=learning.steps,
            late_theta=learning.theta_update == "presentation",
            regular=learning.trains == "regular",
        )

    both = of_both(learning, phase)
    for part in both:
        part.check()
    return both


def initial_state(
    inputs: int, neurons: int, learning: StdpLearning, spikes_per_step: float, seed: int, stretch: int
) -> PlasticState:
    """`start_weights` and the threshold, rounded."""
    weights = start_weights(inputs, neurons, learning, seed, stretch) * (WEIGHT_LIMIT / learning.w_max)
    theta = np.full(neurons, round(learning.threshold * unit(learning, spikes_per_step)), np.int32)
    return PlasticState(np.minimum(np.round(weights), WEIGHT_LIMIT).astype(np.uint8), theta)


def scale_thresholds(theta: NDArray[np.int32], factor: float) -> None:
    """Multiply thresholds in place by ``factor``, rounded to a multiple of 2^-8; none is below 1."""
    theta[:] = np.maximum(1, theta.astype(np.int64) * round(factor * 256) >> 8)


def step_draws(key: int, steps: int) -> StepDraws:
    """The random numbers of a presentation of ``steps`` steps."""
    traces = uniform(derived_key(key, "trace"), steps) * 2.0**53
    weights = uniform(derived_key(key, "round"), steps) * 2.0**53
    return StepDraws(traces.astype(np.uint64), weights.astype(np.uint64))


def normalise(weights: NDArray[np.uint8], total: int, key: int) -> None:
    """Bring each neuron's weights (a column) in place to the sum ``total``, rounding stochastically."""
    scale_columns(weights, total, np.maximum(1, column_sums(weights)), np.uint64(derived_key(key, "normalise")))


def _kernel_phase(learning: IntegerLearning) -> IntegerPhase:
    """The phase as the kernel reads it; what the host does after a presentation is left out."""
    rule, (whole, fraction) = learning.rule, learning.rule.decay()
    lif = replace(learning.neurons, theta_plus=0) if learning.late_theta else learning.neurons
    return IntegerPhase(
        steps=learning.steps,
        silent_steps=learning.silent_steps,
        regular=learning.regular,
        lif=lif.constants,
        target=rule.target,
        mu=rule.mu,
        products=rule.table(),
        whole=whole,
        fraction=fraction,
    )


def present(
    state: PlasticState,
    learning: IntegerLearning,
    rates: NDArray[np.uint16],
    key: int,
    *,
    draws: StepDraws | None = None,
    traces: NDArray[np.uint8] | None = None,
    inhibition: NDArray[np.int64] | None = None,
    raster: bool = False,
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.uint8]]:
    """Normalise, show one image, learn; changes ``state``.

    Args:
        state: Weights and thresholds.
        learning: The phase.
        rates: Spike probabilities in units of 2^-16, uint16 (inputs,).
        key: The presentation's key (`lava_vpr.engine.random.presentation_key`).
        draws: Random numbers of its steps (default: `step_draws` of the key).
        traces: Traces at the start, changed in place (default: all 0).
        inhibition: What the inhibitory neuron subtracts from each neuron, int64 (neurons,), in units of the input sum
            (default: ``learning.inhibition`` from all).
        raster: Also record every spike.
    Returns:
        Spike counts int32 (neurons,); numbers of input and excitatory spikes, int64 (2,); raster uint8
        (steps + 3, neurons) or empty.
    Raises:
        InputError: an array of another type or shape, or traces beyond 7 bits.
    """
    inputs, neurons = state.weights.shape
    total = learning.interval
    check_rates(rates, np.uint16, (inputs,))
    check_array(state.theta, "thresholds", np.int32, (neurons,), AGAIN)
    if traces is not None:
        check_array(traces, "traces", np.uint8, (inputs,), AGAIN)
        if traces.max(initial=0) > TRACE_LIMIT:
            raise InputError(f"traces of up to {traces.max()}, but 7 bits hold {TRACE_LIMIT}; {AGAIN}")
    if inhibition is not None:
        check_array(inhibition, "inhibition", np.int64, (neurons,), AGAIN)
    for name, numbers in () if draws is None else zip(StepDraws._fields, draws, strict=True):
        check_array(numbers, f"draws of {name}", np.uint64, (total,), AGAIN)
    if learning.weight_sum:
        normalise(state.weights, learning.weight_sum, key)
    counts, events = np.zeros(neurons, np.int32), np.zeros(2, np.int64)
    film = np.zeros((total, neurons) if raster else (0, 0), np.uint8)
    lateral = np.full(neurons, learning.inhibition, np.int64) if inhibition is None else inhibition
    x = np.zeros(inputs, np.uint8) if traces is None else traces
    train(
        state.weights,
        state.theta,
        rates,
        slopes()[rates],
        np.uint64(key),
        _kernel_phase(learning),
        lateral,
        step_draws(key, total) if draws is None else draws,
        x,
        counts,
        events,
        film,
    )
    if learning.late_theta:
        raised = state.theta + counts * np.int32(learning.neurons.theta_plus)
        state.theta[:] = np.minimum(raised, THRESHOLD_LIMIT - 1)
    return counts, events, film
