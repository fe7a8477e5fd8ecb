"""Literal, slow versions of the networks, written from the equations alone, to hold the compiled kernels against.

Used by engine and support.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import StdpLearning
from lava_vpr.engine.inference.fixed import FixedNetwork

M = 1 << 23


def shrink(x: int, k: int) -> int:
    """D(x, k) of Lava's fixed-point LIF: sign(x) (|x| k >> 12)."""
    return (1 if x >= 0 else -1) * (abs(x) * k >> 12)


def present_fixed(network: FixedNetwork, spikes: NDArray[np.bool_]) -> NDArray[np.int64]:
    """One presentation, neuron by neuron; input spikes bool (steps, inputs); raster (steps + 3, neurons)."""
    n, total = network.neurons, network.steps + 3
    weights = network.weights.astype(object)
    v = [0] * n
    raster = np.zeros((total, n), np.int64)
    inh = np.zeros((total, n), np.int64)
    for t in range(total):
        if t >= 1:
            inh[t] = raster[t - 1]
        for i in range(n):
            a = 0
            if 1 <= t <= network.steps:
                a += sum(weights[j, i] for j in np.flatnonzero(spikes[t - 1])) >> network.shift
            if t >= 2:
                a -= network.lateral * int(sum(inh[t - 1][k] for k in range(n) if k != i))
            u = a << 6
            if u > M:
                u -= 2 * M
            elif u <= -M:
                u += 2 * M
            v[i] = max(-(M - 1), min(M - 1, shrink(v[i], 4096 - network.decay) + u))
            if v[i] > network.threshold << 6:
                v[i] = 0
                raster[t, i] = 1
    return raster


def train_presentation(
    weights: NDArray[np.float32],
    theta: NDArray[np.float32],
    spikes: NDArray[np.bool_],
    learning: StdpLearning,
    gain: float,
    trace_table: NDArray[np.float32],
    *,
    eta: float,
    target: float,
    theta_plus: float,
) -> NDArray[np.int64]:
    """One training presentation in scalar float32, step by step; changes ``weights`` and ``theta``; returns counts."""
    f = np.float32
    inputs, n = weights.shape
    for i in range(n):
        total = f(0)
        for j in range(inputs):
            total = f(total + weights[j, i])
        factor = f(f(f(learning.mean_weight) * f(inputs)) / total)
        for j in range(inputs):
            weights[j, i] = f(weights[j, i] * factor)
    keep = f(1.0 - 1.0 / learning.tau_membrane)
    v = [f(0)] * n
    last = [-1] * inputs
    held = [0] * n
    history: list[list[int]] = []
    counts = np.zeros(n, np.int64)
    for t in range(len(spikes)):
        on = [int(j) for j in np.flatnonzero(spikes[t])]
        for j in on:
            last[j] = t
        earlier = history[t - 2] if t >= 2 else []
        now = []
        for i in range(n):
            drive = f(0)
            for j in on:
                drive = f(drive + weights[j, i])
            drive = f(drive * f(gain))
            if earlier:
                drive = f(drive - f(f(learning.inhibition) * f(len(earlier))))
                if i in earlier:
                    drive = f(drive + f(learning.inhibition))
            x = max(f(f(v[i] * keep) + drive), f(learning.floor))
            if held[i] > 0:
                x, held[i] = f(0), held[i] - 1
            v[i] = x
            if x > theta[i]:
                now.append(i)
        for i in now:
            v[i] = f(0)
            held[i] = learning.hold_steps
            theta[i] = f(theta[i] + f(theta_plus))
            counts[i] += 1
            for j in range(inputs):
                x = trace_table[t - last[j]] if last[j] >= 0 else f(0)
                change = f(f(eta) * f(x - f(target)))
                if learning.mu:
                    change = f(change * f(f(f(learning.w_max) - weights[j, i]) ** f(learning.mu)))
                weights[j, i] = min(max(f(weights[j, i] + change), f(0)), f(learning.w_max))
        history.append(now)
    return counts
