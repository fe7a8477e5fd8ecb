"""Compiled kernels of `lava_vpr.engine.learning.integer`: scaled weights, traces, weight changes, one presentation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.general.lif import LifConstants, lif_step
from lava_vpr.engine.inference.biases import schedule
from lava_vpr.engine.random import GOLDEN, mix
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import TRACE_LIMIT, WEIGHT_LIMIT

SILENT_STEPS = 3
"""Fewest steps after the last input of a training presentation: one until its spikes reach exc, one until those of exc
reach the inhibitory neuron, one until it inhibits the others."""

_S32 = np.uint64(32)
_ACCUMULATOR = (1 << 15) - 1


class StepDraws(NamedTuple):
    """Random numbers of 53 bits, one for each step, uint64 (steps,): for the traces and for the weights."""

    traces: NDArray[np.uint64]
    weights: NDArray[np.uint64]


class IntegerPhase(NamedTuple):
    """One phase of learning as the kernel reads it.

    ``steps``, ``silent_steps`` and ``regular`` are those of `lava_vpr.engine.learning.integer.IntegerLearning`, ``lif``
    its neurons; the rest is its rule: ``target``, ``mu``, ``products`` (`Rule.table`), and ``whole`` and ``fraction``
    (`Rule.decay`).
    """

    steps: int
    silent_steps: int
    regular: bool
    lif: LifConstants
    target: int
    mu: int
    products: NDArray[np.int64]
    whole: NDArray[np.uint8]
    fraction: NDArray[np.uint64]


@compiled(nogil=True)
def column_sums(weights: NDArray[np.uint8]) -> NDArray[np.int64]:
    """The sum of each column, int64 (neurons,)."""
    sums = np.zeros(weights.shape[1], np.int64)
    for row in weights:
        sums += row
    return sums


@compiled(nogil=True)
def scale_columns(weights: NDArray[np.uint8], wanted: int, sizes: NDArray[np.int64], key: np.uint64) -> None:
    """Scale each column of ``weights`` in place by ``wanted`` / its size, at least 1, rounding stochastically.

    Quotients are taken in float64, which is exact here: numerator and denominator are whole and far below 2^53, so that
    none rounds up to the next whole number. A draw of 32 bits d rounds up when d / 2^32 is below the fraction.
    """
    inputs, neurons = weights.shape
    divisors, factor = sizes.astype(np.float64), np.float64(wanted)
    counters = np.empty(neurons, np.uint64)
    for i in range(neurons):
        counters[i] = key + GOLDEN * (np.uint64(i) << _S32)
    for j in range(inputs):
        own = GOLDEN * np.uint64(j)
        for i in range(neurons):
            scaled = np.float64(weights[j, i]) * factor
            whole = np.floor(scaled / divisors[i])
            rest = np.uint64(np.int32(scaled - whole * divisors[i]))
            draw = mix(counters[i] + own) >> _S32
            whole += np.float64(draw * np.uint64(sizes[i]) < rest << _S32)
            weights[j, i] = np.uint8(np.int32(min(whole, np.float64(WEIGHT_LIMIT))))


@compiled(nogil=True)
def decay_traces(x: NDArray[np.uint8], whole: NDArray[np.uint8], fraction: NDArray[np.uint64], draw: np.uint64) -> None:
    """Let all traces ``x`` (inputs,) decay by one step, in place; tables from `Rule.decay`, ``draw`` of 53 bits."""
    after = np.empty(whole.size, np.uint8)
    for k in range(whole.size):
        after[k] = whole[k] + np.uint8(draw < fraction[k])
    for j in range(x.size):
        x[j] = after[x[j]]


@compiled(nogil=True)
def learn_column(
    weights: NDArray[np.uint8],
    column: int,
    x: NDArray[np.uint8],
    products: NDArray[np.int64],
    target: int,
    mu: int,
    draw: np.uint64,
) -> None:
    """The weight change of all synapses of neuron ``column``, which spikes; as Lava's ``LearningDense`` computes it.

    All intermediate values fit 32 bits: 127 x 255^mu x 8 >> (9 mu - 4), shifted left by at most 15.
    """
    top, bottom, zero = np.int32(_ACCUMULATOR), np.int32(-_ACCUMULATOR - 2), np.int32(0)
    right, limit = np.int32(max(0, 9 * mu - 4)), np.int32(WEIGHT_LIMIT)
    # A draw of 53 bits is below a fraction k / 2^7 if its highest 7 bits are below k.
    chance = np.int32(draw >> np.uint64(46))
    total, factor = weights[:, column].astype(np.int32), x.astype(np.int32)
    for j in range(x.size):
        factor[j] = np.int32(factor[j] - np.int32(target))
    for _ in range(mu):
        for j in range(x.size):
            factor[j] = np.int32(factor[j] * np.int32(limit - total[j]))
    for j in range(x.size):
        total[j] = np.int32(total[j] << np.int32(7))
    for p in range(products.shape[0]):
        mantissa, left = np.int32(products[p, 0]), np.int32(products[p, 1])
        for j in range(x.size):
            change = np.int32(np.int32(np.int32(factor[j] * mantissa) >> right) << left)
            change = min(max(change, bottom), top)
            total[j] = min(max(np.int32(total[j] + change), bottom), top)
    for j in range(x.size):
        w = max(total[j], zero)
        w = np.int32(np.int32(w >> np.int32(7)) + np.int32(chance < np.int32(w & np.int32(127))))
        total[j] = min(w, limit)
    weights[:, column] = total.astype(np.uint8)


@compiled(nogil=True)
def _decay_epochs(
    value: NDArray[np.uint8], newest: int, whole: NDArray[np.uint8], fraction: NDArray[np.uint64], draw: np.uint64
) -> None:
    """`decay_traces` of the values ``value[:newest]``, one for the spikes of each step; older spikes have smaller
    values."""
    for s in range(newest - 1, -1, -1):
        k = value[s]
        if k == 0:
            return
        value[s] = whole[k] + np.uint8(draw < fraction[k])


@compiled(nogil=True)
def _learn_at(
    weights: NDArray[np.uint8], x: NDArray[np.uint8], fired: NDArray[np.bool_], phase: IntegerPhase, draw: np.uint64
) -> None:
    """Change the synapses of all neurons that ``fired``, by the traces ``x`` of this step."""
    for i in range(fired.size):
        if fired[i]:
            learn_column(weights, i, x, phase.products, phase.target, phase.mu, draw)


@compiled(nogil=True)
def train(
    weights: NDArray[np.uint8],
    theta: NDArray[np.int32],
    rates: NDArray[np.uint16],
    slopes: NDArray[np.int32],
    key: np.uint64,
    phase: IntegerPhase,
    inhibition: NDArray[np.int64],
    draws: StepDraws,
    x: NDArray[np.uint8],
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
    raster: NDArray[np.uint8],
) -> None:
    """Run one presentation; changes ``weights``, ``theta`` and traces ``x``, fills ``counts``, adds to ``events``.

    ``slopes`` (inputs,) stand for ``rates`` where inputs spike regularly (`engine.inference.biases.biases`).

    Every spike sets its trace to the same value, and all traces of a step share one random number: traces last set in
    the same step stay equal, and only one value a step is followed.
    """
    steps, whole, fraction = phase.steps, phase.whole, phase.fraction
    neurons = weights.shape[1]
    if phase.regular:
        starts, members = schedule(slopes, key, steps)
    else:
        starts, members = poisson_spikes(rates, key, steps)
    u, v = np.zeros(neurons, np.int32), np.zeros(neurons, np.int32)
    held, bias = np.zeros(neurons, np.int32), np.zeros(neurons, np.int64)
    buffer, drive = np.zeros(neurons, np.int32), np.zeros(neurons, np.int64)
    fired = np.zeros((3, neurons), np.bool_)
    n_fired = np.zeros(3, np.int64)
    classes = TRACE_LIMIT + 1
    value = np.arange(classes + steps).astype(np.uint8)  # traces at the start, then those set in each step
    last = x.astype(np.int32)  # index of each trace in ``value``
    warm = x.max() > 0
    for step in range(steps + phase.silent_steps):
        now, before = step % 3, (step + 1) % 3  # (step - 2) mod 3
        for i in range(neurons):
            drive[i] = buffer[i]
            if n_fired[before] > 0 and not fired[before, i]:
                drive[i] -= inhibition[i]
        n_fired[now] = lif_step(u, v, theta, held, drive, bias, phase.lif, fired[now])
        # The input sums that this step's spikes will bring, with the weights before this step's learning.
        buffer[:] = 0
        if warm:
            _decay_epochs(value[:classes], classes, whole, fraction, draws.traces[step])
        _decay_epochs(value[classes:], min(step, steps), whole, fraction, draws.traces[step])
        if step < steps:
            value[classes + step] = TRACE_LIMIT
        for s in range(starts[min(step, steps)], starts[min(step + 1, steps)]):
            row = np.uint64(members[s])
            last[row] = classes + step
            for i in range(neurons):
                buffer[i] += weights[row, i]
        if n_fired[now] > 0:
            events[1] += n_fired[now]
            x[:] = value[last]
            _learn_at(weights, x, fired[now], phase, draws.weights[step])
            counts += fired[now]
            if raster.size > 0:
                raster[step] = fired[now]
    events[0] += members.size
    x[:] = value[last]
