"""Compiled kernels of the conductance network: one presentation's dynamics, and its plasticity.

Order within a step, as Brian2's default schedule has it: states, thresholds, synapses (input arrivals with their part
of the learning, exc to inh, inh to exc, then the postsynaptic part of the learning), resets.

What makes it fast without changing a bit of the result: a neuron's weights cannot change before its first spike of a
presentation (the postsynaptic traces are 0), so its input is added up per arrival step when the input spikes depart.
Only the few neurons that have spiked ("plastic" below) read their weights arrival by arrival. An inhibitory neuron
that never received a spike stays exactly at rest, and so is not computed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

FROZEN, TRIPLET, PAPER = 0, 1, 2
E_REST, E_RESET, E_EXC, E_INH = -65.0, -65.0, 0.0, -100.0
E_OFFSET, E_THRESHOLD = 20.0, -52.0
I_REST, I_RESET, I_THRESHOLD = -60.0, -45.0, -40.0
EXC_TO_INH, INH_TO_EXC = 10.4, 17.0
NEVER = -(1 << 40)
_BLOCK = 8  # float64 of one cache line


class Constants(NamedTuple):
    """The network's settings in steps and shares per step; see `lava_vpr.engine.conductance.model.constants`."""

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


class ConductanceDrive(NamedTuple):
    """Weights and delays (neurons, inputs), and one presentation's input spikes: their steps, ascending, and inputs."""

    weights: NDArray[np.float64]
    delays: NDArray[np.uint16]
    when: NDArray[np.int32]
    sources: NDArray[np.int32]


@compiled(nogil=True)
def normalise(weights: NDArray[np.float64], target: float) -> None:
    """Scale the weights (neurons, inputs) of each neuron to the sum ``target``, in place; all zeros stay."""
    for i in range(weights.shape[0]):
        row = weights[i]
        total = 0.0
        for j in range(row.size):
            total += row[j]
        if total > 0:
            factor = target / total
            for j in range(row.size):
                row[j] *= factor


@compiled(nogil=True)
def input_drive(net: ConductanceDrive, begin: int, carry: NDArray[np.float64], drive: NDArray[np.float64]) -> None:
    """Sum the weights that arrive at every neuron in the steps from ``begin``, as many as ``drive`` has rows.

    ``carry`` (neurons, longest delay) holds what earlier spikes send into these steps, and afterwards what all send
    into the following ones. Weights that arrive together are added in the order of departure, then of input. Neurons
    are processed one after another, so that the sums stay in the first-level cache.
    """
    span, longest = drive.shape[0], carry.shape[1]
    first = np.searchsorted(net.when, begin)
    n = np.searchsorted(net.when, begin + span) - first
    when, source = np.empty(n, np.uint32), np.empty(n, np.uint32)  # unsigned: no test for negative indices below
    for p in range(n):
        when[p], source[p] = net.when[first + p] - begin, net.sources[first + p]
    sums = np.empty((_BLOCK, span + longest))
    for i0 in range(0, drive.shape[1], _BLOCK):
        width = min(_BLOCK, drive.shape[1] - i0)
        for k in range(width):
            total, weight, delay = sums[k], net.weights[i0 + k], net.delays[i0 + k]
            total[:longest], total[longest:] = carry[i0 + k], 0.0
            for p in range(n):
                j = np.uint64(source[p])
                total[np.uint64(when[p]) + np.uint64(delay[j])] += weight[j]
            carry[i0 + k] = total[span:]
        for t in range(span):
            for k in range(width):
                drive[t, i0 + k] = sums[k, t]


@compiled(nogil=True)
def update_exc(
    v: NDArray[np.float64],
    ge: NDArray[np.float64],
    gi: NDArray[np.float64],
    theta: NDArray[np.float64],
    arriving: NDArray[np.float64],
    c: Constants,
    block: NDArray[np.float64],
) -> int:
    """Take one Euler step of all excitatory neurons, then add the input; returns how many are above threshold.

    ``block`` is infinite while a neuron's refractory timer runs, else 0. Separate loops, because a compiler only
    vectorises a loop over few arrays that could overlap.
    """
    leak = c.exc_leak
    for i in range(v.size):
        v[i] += leak * ((E_REST - v[i]) + ge[i] * (E_EXC - v[i]) + gi[i] * (E_INH - v[i]))
    for i in range(v.size):
        ge[i] = (ge[i] - c.ge_decay * ge[i]) + arriving[i]
    for i in range(v.size):
        gi[i] -= c.gi_decay * gi[i]
    above = 0
    for i in range(v.size):
        theta[i] -= c.theta_decay * theta[i]
        above += v[i] > ((theta[i] - E_OFFSET) + E_THRESHOLD) + block[i]
    return above


@compiled(nogil=True)
def calm(
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


class Plastic(NamedTuple):
    """The neurons whose weights can change in this presentation, one slot each.

    Attributes:
        neuron: Neuron of a slot, (slots,).
        cursor: Index of its next arrival in ``times`` and ``inputs``, (slots,).
        arrived: Step at which each input last arrived, or NEVER, (slots, inputs).
        times: Steps of its arrivals from recruitment on, ascending, then the end of the presentation, (slots, spikes).
        inputs: Inputs of those arrivals, (slots, spikes).
    """

    neuron: NDArray[np.int64]
    cursor: NDArray[np.int64]
    arrived: NDArray[np.int64]
    times: NDArray[np.int32]
    inputs: NDArray[np.int32]


@compiled(nogil=True)
def new_plastic(slots: int, inputs: int, spikes: int) -> Plastic:
    """Make room for ``slots`` neurons."""
    return Plastic(
        np.zeros(slots, np.int64),
        np.zeros(slots, np.int64),
        np.empty((slots, inputs), np.int64),
        np.empty((slots, spikes), np.int32),
        np.empty((slots, spikes), np.int32),
    )


@compiled(nogil=True)
def with_room(old: Plastic, n: int) -> Plastic:
    """``old`` if it has a free slot after its first ``n``, else a larger copy."""
    if n < old.neuron.size:
        return old
    new = new_plastic(2 * n, old.arrived.shape[1], old.times.shape[1])
    new.neuron[:n], new.cursor[:n], new.arrived[:n] = old.neuron, old.cursor, old.arrived
    new.times[:n], new.inputs[:n] = old.times, old.inputs
    return new


@compiled(nogil=True)
def recruit(plastic: Plastic, slot: int, i: int, step: int, net: ConductanceDrive, total: int) -> None:
    """Neuron ``i`` becomes plastic at ``step``: when each input last arrived, and what arrives later, in order.

    Arrivals of one step stay in the order of their departure, as `input_drive` adds them.
    """
    plastic.neuron[slot], plastic.cursor[slot] = i, 0
    arrived, times, inputs, delay = plastic.arrived[slot], plastic.times[slot], plastic.inputs[slot], net.delays[i]
    ends = np.zeros(total + 1, np.int64)
    arrived[:] = NEVER
    for p in range(net.when.size):
        arrival = net.when[p] + np.int64(delay[net.sources[p]])
        if arrival <= step:
            arrived[net.sources[p]] = arrival
        elif arrival < total:
            ends[arrival + 1] += 1
    for t in range(max(step, 0), total):
        ends[t + 1] += ends[t]
    times[ends[total] :] = total
    for p in range(net.when.size):
        arrival = net.when[p] + np.int64(delay[net.sources[p]])
        if step < arrival < total:
            times[ends[arrival]] = arrival
            inputs[ends[arrival]] = net.sources[p]
            ends[arrival] += 1


@compiled(nogil=True)
def arrive(plastic: Plastic, slot: int, step: int, weights: NDArray[np.float64], change: float, w_max: float) -> float:
    """The input of the slot's neuron at ``step``; each weight is read, then grows by ``change`` within [0, w_max].

    A negative ``change`` leaves the weights alone.
    """
    times, inputs, arrived = plastic.times[slot], plastic.inputs[slot], plastic.arrived[slot]
    weight = weights[plastic.neuron[slot]]
    cursor, drive = plastic.cursor[slot], 0.0
    while cursor < times.size and times[cursor] == step:
        j = inputs[cursor]
        drive += weight[j]
        arrived[j] = step
        if change >= 0.0:
            weight[j] = min(max(weight[j] + change, 0.0), w_max)
        cursor += 1
    plastic.cursor[slot] = cursor
    return drive


@compiled(nogil=True)
def learn(
    weight: NDArray[np.float64],
    arrived: NDArray[np.int64],
    step: int,
    trace: NDArray[np.float64],
    post2: float,
    rule: int,
    c: Constants,
) -> None:
    """The neuron with these weights (inputs,) spikes at ``step``; ``trace[k]`` is a presynaptic trace k steps old."""
    for j in range(weight.size):
        x = trace[step - arrived[j]] if arrived[j] != NEVER else 0.0
        w = weight[j]
        if rule == TRIPLET:
            w += c.eta_post * x * post2
        else:
            w += c.eta_post * (x - c.x_target) * max(c.w_max - w, 0.0) ** c.mu
        weight[j] = min(max(w, 0.0), c.w_max)
