"""Learning places by STDP: one training presentation of the current-based network, in float32.

The rule is the paper's (Hussaini et al. 2022, the equation of the weight change): when a neuron spikes,
``w += eta (x_pre - x_target) (w_max - w)^mu``, clipped to [0, w_max]. The presynaptic trace ``x_pre`` is set to 1 by an
input spike and decays by exp(-1 / tau_trace) a step. Homeostasis raises a neuron's threshold by ``theta_plus`` for each
spike, for good; before a presentation every neuron's weights are normalised to the same mean.

All arithmetic is elementwise or summed in a fixed order, without fused or reordered operations, so that every machine
and every vector width computes the same bits. One inhibitory neuron fires when any excitatory one has; neurons that
spiked get its inhibition back, so that winners are spared.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import StdpLearning
from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import schedule, slopes
from lava_vpr.engine.presentations import check_rates
from lava_vpr.engine.random import presentation_key, uniform
from lava_vpr.kernelcache import compiled

Phase = TypeVar("Phase")


@dataclass
class PlasticState:
    """The state that training changes: ``weights`` (inputs, neurons) and thresholds ``theta`` (neurons,).

    Both are float32; learning in integers (`engine.learning.integer`) has uint8 and int32.
    """

    weights: NDArray[Any]
    theta: NDArray[Any]


def start_weights(inputs: int, neurons: int, learning: StdpLearning, seed: int, stretch: int) -> NDArray[np.float64]:
    """Random start weights ``start_weight (U[0, 1) + 0.01)``; every ``stretch`` draws its own, by its key."""
    draws = uniform(presentation_key(seed, "start", stretch), inputs * neurons).reshape(inputs, neurons)
    return learning.start_weight * (draws + 0.01)


def initial_state(
    inputs: int, neurons: int, learning: StdpLearning, spikes_per_step: float, seed: int, stretch: int
) -> PlasticState:
    """`start_weights` and the threshold of the settings; ``spikes_per_step`` matters only to learning in integers."""
    weights = start_weights(inputs, neurons, learning, seed, stretch).astype(np.float32)
    return PlasticState(weights, np.full(neurons, learning.threshold, np.float32))


def normalise(weights: NDArray[np.float32], mean: float) -> None:
    """Scale each neuron's weights (a column) in place to ``mean``; the sum runs over inputs in order."""
    _normalise(weights, np.float32(mean))


def trace_table(steps: int, tau: float) -> NDArray[np.float32]:
    """Trace k steps after its input's spike, k = 0 .. steps; by repeated multiplication, the same on every machine."""
    decay = round(math.exp(-1.0 / tau), 12)
    table = np.empty(steps + 1, np.float64)
    value = 1.0
    for k in range(steps + 1):
        table[k] = value
        value *= decay
    return table.astype(np.float32)


class KernelPhase(NamedTuple):
    """One phase of learning as the kernel and `present` read it.

    ``eta``, ``target`` (x_target), ``w_max`` and ``mu`` are those of the rule, ``mean_weight``, ``theta_plus``,
    ``inhibition`` and ``floor`` those of `StdpLearning`. ``keep`` is the share of a membrane that a step leaves,
    ``gain`` the drive of one unit of weight, ``hold_steps`` the number of steps at rest after a spike. Inputs spike in
    ``regular`` trains or by Poisson draws. ``trace`` is `trace_table`.
    """

    eta: np.float32
    target: np.float32
    w_max: np.float32
    mu: np.float32
    mean_weight: float
    theta_plus: np.float32
    inhibition: np.float32
    keep: np.float32
    gain: np.float32
    floor: np.float32
    steps: int
    hold_steps: int
    regular: bool
    trace: NDArray[np.float32]


@compiled(nogil=True)
def _normalise(weights: NDArray[np.float32], mean: np.float32) -> None:
    inputs, neurons = weights.shape
    total = np.zeros(neurons, np.float32)
    for j in range(inputs):
        for i in range(neurons):
            total[i] += weights[j, i]
    for i in range(neurons):
        total[i] = mean * np.float32(inputs) / total[i] if total[i] > 0 else np.float32(0)
    for j in range(inputs):
        for i in range(neurons):
            weights[j, i] *= total[i]


@compiled(inline="always")
def _learn(
    column: int,
    weights: NDArray[np.float32],
    last: NDArray[np.int32],
    now: int,
    phase: KernelPhase,
) -> None:
    """Change all synapses of neuron ``column``, which spikes at step ``now``."""
    eta, target, w_max, mu, trace = phase.eta, phase.target, phase.w_max, phase.mu, phase.trace
    for j in range(last.size):
        x = trace[now - last[j]] if last[j] >= 0 else np.float32(0)
        w = weights[j, column]
        change = eta * (x - target)
        if mu != 0:
            change *= (w_max - w) ** mu
        w = np.float32(w + change)
        weights[j, column] = min(max(w, np.float32(0)), w_max)


@compiled(inline="always")
def _integrate(
    v: NDArray[np.float32],
    drive: NDArray[np.float32],
    theta: NDArray[np.float32],
    free_from: NDArray[np.int32],
    step: int,
    phase: KernelPhase,
) -> bool:
    """Integrate one step of all neurons; returns whether any exceeds its threshold."""
    keep, floor = phase.keep, phase.floor
    above = False
    for i in range(v.size):
        x = np.float32(np.float32(v[i] * keep) + drive[i])
        x = floor if x < floor else x
        x = np.float32(0) if step < free_from[i] else x
        v[i] = x
        above |= x > theta[i]
    return above


@compiled(nogil=True)
def _train(
    weights: NDArray[np.float32],
    theta: NDArray[np.float32],
    rates: NDArray[np.uint16],
    slopes: NDArray[np.int32],
    key: np.uint64,
    phase: KernelPhase,
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
) -> None:
    """Run one presentation; changes ``weights`` and ``theta``, fills ``counts`` (neurons,), adds to ``events``.

    ``slopes`` (inputs,) stand for ``rates`` where inputs spike regularly (`engine.inference.biases.biases`).
    """
    inhibition, gain = phase.inhibition, phase.gain
    inputs, neurons = weights.shape
    if phase.regular:
        starts, members = schedule(slopes, key, phase.steps)
    else:
        starts, members = poisson_spikes(rates, key, phase.steps)
    last = np.full(inputs, -1, np.int32)
    free_from = np.zeros(neurons, np.int32)
    drive = np.zeros(neurons, np.float32)
    v = np.zeros(neurons, np.float32)
    fired = np.zeros((3, neurons), np.int32)
    n_fired = np.zeros(3, np.int64)
    for step in range(phase.steps):
        drive[:] = 0
        for s in range(starts[step], starts[step + 1]):
            row = np.uint64(members[s])
            last[row] = step
            for i in range(neurons):
                drive[i] += weights[row, i]
        now, before = step % 3, (step + 1) % 3  # (step - 2) mod 3
        for i in range(neurons):
            drive[i] *= gain
        if n_fired[before] > 0:
            for i in range(neurons):
                drive[i] -= inhibition
            for s in range(n_fired[before]):
                drive[fired[before, s]] += inhibition
        n_fired[now] = 0
        if _integrate(v, drive, theta, free_from, step, phase):
            for i in range(neurons):
                if v[i] > theta[i]:
                    v[i] = 0
                    theta[i] += phase.theta_plus
                    free_from[i] = step + 1 + phase.hold_steps
                    fired[now, n_fired[now]] = i
                    n_fired[now] += 1
                    counts[i] += 1
                    _learn(i, weights, last, step, phase)
            events[1] += n_fired[now]
    events[0] += members.size


def mean_trace(inputs: int, spikes_per_step: float, tau: float) -> float:
    """Expected trace of an input of mean rate p: p tau / (1 + p tau), for a trace that is set to 1, not added to."""
    load = spikes_per_step / inputs * tau
    return load / (1.0 + load)


def phases(learning: StdpLearning, inputs: int, spikes_per_step: float) -> tuple[KernelPhase, KernelPhase]:
    """Competition and consolidation.

    Args:
        learning: Settings of the rule.
        inputs: Number of inputs.
        spikes_per_step: Expected input spikes per step ("tot") of the rates that will be shown.
    """

    def phase(eta: float, tau: float, target: float, theta_plus: float) -> KernelPhase:
        return KernelPhase(
            eta=np.float32(eta),
            target=np.float32(target * mean_trace(inputs, spikes_per_step, tau)),
            w_max=np.float32(learning.w_max),
            mu=np.float32(learning.mu),
            mean_weight=learning.mean_weight,
            theta_plus=np.float32(theta_plus),
            inhibition=np.float32(learning.inhibition),
            keep=np.float32(1.0 - 1.0 / learning.tau_membrane),
            gain=np.float32(learning.drive / (learning.mean_weight * spikes_per_step)),
            floor=np.float32(learning.floor),
            steps=learning.steps,
            hold_steps=learning.hold_steps,
            regular=learning.trains == "regular",
            trace=trace_table(learning.steps, tau),
        )

    return of_both(learning, phase)


def of_both(learning: StdpLearning, phase: Callable[[float, float, float, float], Phase]) -> tuple[Phase, Phase]:
    """Competition and consolidation, each made by ``phase`` from its ``eta``, ``tau_trace``, ``x_target`` and
    ``theta_plus``."""
    return (
        phase(learning.eta, learning.tau_trace, learning.x_target, learning.theta_plus),
        phase(learning.consolidation_eta, learning.consolidation_tau_trace, learning.consolidation_x_target, 0.0),
    )


def scale_thresholds(theta: NDArray[np.float32], factor: float) -> None:
    """Multiply thresholds in place by ``factor``, as consolidation begins."""
    theta *= np.float32(factor)


def present(
    state: PlasticState, phase: KernelPhase, rates: NDArray[np.uint16], key: int
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Normalise, show one image, learn; changes ``state``.

    Args:
        state: Weights and thresholds.
        phase: The phase.
        rates: Spike probabilities in units of 2^-16, uint16 (inputs,).
        key: The presentation's key (`lava_vpr.engine.random.presentation_key`).
    Returns:
        Spike counts int32 (neurons,); numbers of input and excitatory spikes, int64 (2,).
    Raises:
        InputError: rates of another type or shape.
    """
    check_rates(rates, np.uint16, state.weights.shape[:1])
    counts, events = np.zeros(len(state.theta), np.int32), np.zeros(2, np.int64)
    normalise(state.weights, phase.mean_weight)
    _train(state.weights, state.theta, rates, slopes()[rates], np.uint64(key), phase, counts, events)
    return counts, events
