"""Compiled plasticity of the conductance network: neurons that have spiked, their arrivals and their weight changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.conductance.kernels import NEVER, TRIPLET, ConductanceDrive, Constants
from lava_vpr.kernelcache import compiled


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
    """``old``, or a larger copy, with a free slot after its first ``n``."""
    if n < old.neuron.size:
        return old
    new = new_plastic(2 * n, old.arrived.shape[1], old.times.shape[1])
    for s in range(n):
        new.neuron[s], new.cursor[s] = old.neuron[s], old.cursor[s]
        for j in range(old.arrived.shape[1]):
            new.arrived[s, j] = old.arrived[s, j]
        for p in range(old.times.shape[1]):
            new.times[s, p], new.inputs[s, p] = old.times[s, p], old.inputs[s, p]
    return new


@compiled(nogil=True)
def recruit(plastic: Plastic, slot: int, i: int, step: int, net: ConductanceDrive, total: int) -> None:
    """Neuron ``i`` becomes plastic at ``step``: when each input last arrived, and what arrives later, in order.

    Arrivals of one step stay in the order of their departure, as `input_drive` adds them.
    """
    plastic.neuron[slot], plastic.cursor[slot] = i, 0
    arrived, times, inputs, delay = plastic.arrived[slot], plastic.times[slot], plastic.inputs[slot], net.delays[i]
    ends = np.zeros(total + 1, np.int64)
    for j in range(arrived.size):
        arrived[j] = NEVER
    for p in range(net.when.size):
        arrival = net.when[p] + np.int64(delay[net.sources[p]])
        if arrival <= step:
            arrived[net.sources[p]] = arrival
        elif arrival < total:
            ends[arrival + 1] += 1
    for t in range(max(step, 0), total):
        ends[t + 1] += ends[t]
    for p in range(ends[total], times.size):
        times[p] = total
    for p in range(net.when.size):
        arrival = net.when[p] + np.int64(delay[net.sources[p]])
        if step < arrival < total:
            times[ends[arrival]] = arrival
            inputs[ends[arrival]] = net.sources[p]
            ends[arrival] += 1


@compiled(nogil=True)
def arrive(plastic: Plastic, slot: int, step: int, weights: NDArray[np.float64], change: float, w_max: float) -> float:
    """What reaches the slot's neuron at ``step``; each weight is read, then grows by ``change`` within [0, w_max].

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
