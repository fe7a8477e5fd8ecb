"""Compiled kernels of the conductance network: input spikes, one presentation's dynamics, and its plasticity.

Order within a step, as Brian2's default schedule has it: states, thresholds, synapses (input arrivals with their part
of the learning, exc to inh, inh to exc, then the postsynaptic part of the learning), resets.

What makes it fast without changing a bit of the result: a neuron's weights cannot change before its first spike of a
presentation (the postsynaptic traces are 0), so its input is added up per arrival step when the input spikes depart.
Only the few neurons that have spiked ("plastic" below) read their weights arrival by arrival. An inhibitory neuron
that never received a spike stays exactly at rest, and so is not computed.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.random import GOLDEN, mix

FROZEN, TRIPLET, PAPER = 0, 1, 2
E_REST, E_RESET, E_EXC, E_INH = -65.0, -65.0, 0.0, -100.0
E_OFFSET, E_THRESHOLD = 20.0, -52.0
I_REST, I_RESET, I_THRESHOLD = -60.0, -45.0, -40.0
EXC_TO_INH, INH_TO_EXC = 10.4, 17.0
CALM_CHECK_STEPS = 32
NEVER = -(1 << 40)
_S32, _ONE = np.uint64(32), np.uint64(1)


class Constants(NamedTuple):
    """The network's settings in steps and shares per step; see `lava_vpr.engine.conductance.constants`."""

    steps: int
    total: int
    freeze: int
    timer: int
    inh_freeze: int
    exc_leak: float
    inh_leak: float
    ge_decay: float
    gi_decay: float
    theta_decay: float
    theta_plus: float
    eta_pre: float
    eta_post: float
    x_target: float
    mu: float
    w_max: float


@nb.njit(cache=True, nogil=True)
def draw_spikes(
    rates: NDArray[np.uint32], key: np.uint64, steps: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """All input spikes of one presentation: step t's inputs, ascending, are ``sources[starts[t]:starts[t + 1]]``.

    Equal to ``draws(key, steps, inputs, bits=32) < rates`` of `lava_vpr.engine.random`.
    """
    n = 0
    expected = 0.0
    active = np.empty(rates.size, np.int32)
    for j in range(rates.size):
        expected += rates[j] * 2.0**-32 * steps
        if rates[j] > 0:
            active[n] = j
            n += 1
    width = (n + 3) // 4 * 4  # both lanes of four inputs are one 64-bit word of flags; the padding never spikes
    offsets = np.zeros(width, np.uint64)
    limits = np.zeros(2 * width, np.uint32)
    for k in range(n):
        offsets[k] = key + GOLDEN * np.uint64(active[k])
        limits[2 * k] = limits[2 * k + 1] = rates[active[k]]
    words = np.empty(width, np.uint64)
    flags = np.empty(2 * width, np.uint8)
    starts = np.zeros(steps + 1, np.int64)
    sources = np.empty(int(1.2 * expected) + 2 * n + 64, np.int32)
    second = np.empty(n, np.int32)
    end = 0
    for block in range((steps + 1) // 2):
        start = GOLDEN * (np.uint64(block) << _S32)
        for k in range(width):
            words[k] = mix(offsets[k] + start)
        lanes = words.view(np.uint32)
        for k in range(2 * width):
            flags[k] = lanes[k] < limits[k]
        if end + 2 * n > sources.size:
            grown = np.empty(2 * sources.size + 2 * n, np.int32)
            grown[:end] = sources[:end]
            sources = grown
        groups = flags.view(np.uint64)
        n_second = 0
        for p in range(width // 4):
            if groups[p] != 0:
                for k in range(4 * p, 4 * p + 4):
                    if flags[2 * k]:
                        sources[end] = active[k]
                        end += 1
                    if flags[2 * k + 1]:
                        second[n_second] = active[k]
                        n_second += 1
        starts[2 * block + 1] = end
        if 2 * block + 1 < steps:
            sources[end : end + n_second] = second[:n_second]
            end += n_second
            starts[2 * block + 2] = end
    return starts, sources[:end]


@nb.njit(cache=True, nogil=True)
def normalise(weights: NDArray[np.float64], target: float) -> None:
    """Scale each neuron's weights to the sum ``target``, in place; a neuron whose weights are all 0 keeps them."""
    factors = np.zeros(weights.shape[1])
    for j in range(weights.shape[0]):
        for i in range(weights.shape[1]):
            factors[i] += weights[j, i]
    for i in range(factors.size):
        factors[i] = target / factors[i] if factors[i] > 0 else 1.0
    for j in range(weights.shape[0]):
        for i in range(weights.shape[1]):
            weights[j, i] *= factors[i]


@nb.njit(cache=True, nogil=True)
def _depart(
    sources: NDArray[np.int32],
    step: int,
    weights: NDArray[np.float64],
    delays: NDArray[np.uint16],
    shift: int,
    ring: NDArray[np.float64],
) -> None:
    """Add the weights of the inputs that spike at ``step`` to the steps at which they arrive.

    Row ``a`` modulo its length of the flat ``ring``, rows of 2^shift, holds what arrives at step ``a``.
    """
    mask = ring.size - 1
    for s in range(sources.size):
        row_w, row_d = weights[sources[s]], delays[sources[s]]
        for i in range(row_w.size):
            ring[(((step + np.int64(row_d[i])) << shift) + i) & mask] += row_w[i]


@nb.njit(cache=True, nogil=True)
def _update_exc(
    v: NDArray[np.float64],
    ge: NDArray[np.float64],
    gi: NDArray[np.float64],
    theta: NDArray[np.float64],
    block: NDArray[np.float64],
    arriving: NDArray[np.float64],
    c: Constants,
) -> int:
    """One Euler step of all excitatory neurons, then the arriving input; returns how many are above threshold.

    ``block`` is infinite while a neuron's refractory timer runs, else 0. Separate loops, because a compiler only
    vectorises a loop over few arrays that could overlap.
    """
    leak = c.exc_leak
    for i in range(v.size):
        v[i] += leak * ((E_REST - v[i]) + ge[i] * (E_EXC - v[i]) + gi[i] * (E_INH - v[i]))
    for i in range(v.size):
        ge[i] = (ge[i] - c.ge_decay * ge[i]) + arriving[i]
        arriving[i] = 0.0
    for i in range(v.size):
        gi[i] -= c.gi_decay * gi[i]
    above = 0
    for i in range(v.size):
        theta[i] -= c.theta_decay * theta[i]
        above += v[i] > ((theta[i] - E_OFFSET) + E_THRESHOLD) + block[i]
    return above


@nb.njit(cache=True, nogil=True)
def _calm(
    v: NDArray[np.float64],
    ge: NDArray[np.float64],
    gi: NDArray[np.float64],
    theta: NDArray[np.float64],
    leak: float,
    c: Constants,
    rest: float,
    limit: float,
) -> bool:
    """Whether no neuron can reach its threshold any more, once no input is left on its way.

    With leak (1 + ge + gi) <= 1 a step moves v to a weighted mean of itself, the rest and the reversal potentials, so
    a membrane at most M >= rest rises by at most leak |M| ge a step, |M| leak ge / ge_decay in all. 1e-3 mV covers
    rounding. Empty ``theta``: the threshold is ``limit``; else theta + ``limit``, with theta's decay until the end.
    """
    for i in range(v.size):
        if leak * (1.0 + ge[i] + gi[i]) > 1.0:
            return False
        top = max(v[i], rest)
        threshold = limit
        if theta.size > 0:
            threshold += theta[i] * (1.0 - c.theta_decay * c.total)
        if top - leak * top * ge[i] / c.ge_decay > threshold - 1e-3:
            return False
    return True


@nb.njit(cache=True, nogil=True)
def _schedule(
    i: int,
    step: int,
    delays: NDArray[np.uint16],
    starts: NDArray[np.int64],
    sources: NDArray[np.int32],
    total: int,
    arrived: NDArray[np.int64],
    times: NDArray[np.int32],
    inputs: NDArray[np.int32],
) -> None:
    """Neuron ``i`` becomes plastic at ``step``: when did each input last arrive, and what arrives later, in order.

    Arrivals of one step are in the order of their departure, as `_depart` adds them.
    """
    starts_at = np.zeros(total + 1, np.int64)
    arrived[:] = NEVER
    for t in range(starts.size - 1):
        for p in range(starts[t], starts[t + 1]):
            arrival = t + np.int64(delays[sources[p], i])
            if arrival <= step:
                arrived[sources[p]] = arrival
            elif arrival < total:
                starts_at[arrival + 1] += 1
    for t in range(total):
        starts_at[t + 1] += starts_at[t]
    times[starts_at[total] :] = total  # never reached
    for t in range(starts.size - 1):
        for p in range(starts[t], starts[t + 1]):
            arrival = t + np.int64(delays[sources[p], i])
            if step < arrival < total:
                times[starts_at[arrival]] = arrival
                inputs[starts_at[arrival]] = sources[p]
                starts_at[arrival] += 1


@nb.njit(cache=True, nogil=True)
def _arrive(
    i: int,
    step: int,
    cursor: int,
    times: NDArray[np.int32],
    inputs: NDArray[np.int32],
    arrived: NDArray[np.int64],
    weights: NDArray[np.float64],
    change: float,
    clip: bool,
    w_max: float,
) -> tuple[float, int]:
    """What reaches plastic neuron ``i`` at ``step``, each weight read before it grows by ``change``."""
    drive = 0.0
    while cursor < times.size and times[cursor] == step:
        j = inputs[cursor]
        drive += weights[j, i]
        arrived[j] = step
        if clip:
            weights[j, i] = min(max(weights[j, i] + change, 0.0), w_max)
        cursor += 1
    return drive, cursor


@nb.njit(cache=True, nogil=True)
def _learn(
    i: int,
    step: int,
    arrived: NDArray[np.int64],
    weights: NDArray[np.float64],
    pre: NDArray[np.float64],
    post2: float,
    rule: int,
    c: Constants,
) -> None:
    """The postsynaptic part of the learning: neuron ``i`` spikes at ``step``. ``pre[k]`` is a trace k steps old."""
    for j in range(arrived.size):
        x = pre[step - arrived[j]] if arrived[j] != NEVER else 0.0
        w = weights[j, i]
        if rule == TRIPLET:
            w += c.eta_post * x * post2
        else:
            w += c.eta_post * (x - c.x_target) * max(c.w_max - w, 0.0) ** c.mu
        weights[j, i] = min(max(w, 0.0), c.w_max)
