"""One presentation of integer learning in plain Python numbers, written from the equations alone.

Used by engine.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.learning.integer import IntegerLearning, Rule
from lava_vpr.engine.random import GOLDEN, derived_key, uniform

M = 1 << 23
WORD = (1 << 64) - 1


def mixed(x: int) -> int:
    """SplitMix64's finaliser."""
    x &= WORD
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 & WORD
    x = (x ^ (x >> 27)) * 0x94D049BB133111EB & WORD
    return x ^ (x >> 31)


def normalised(weights: list[list[int]], total: int, key: int) -> list[list[int]]:
    """Weights (inputs, neurons) brought to the sum ``total`` each neuron: w total / sum, rounded up by chance."""
    own = derived_key(key, "normalise")
    result = [row.copy() for row in weights]
    for i in range(len(weights[0])):
        size = sum(row[i] for row in weights)
        for j, row in enumerate(weights):
            if row[i]:
                exact = Fraction(row[i] * total, size)
                chance = Fraction(mixed(own + int(GOLDEN) * ((i << 32) + j)) >> 32, 1 << 32)
                up = chance < exact - math.floor(exact)
                result[j][i] = min(255, math.floor(exact) + up)
    return result


def learned(w: int, x: int, rule: Rule, chance: float) -> int:
    """A weight after a postsynaptic spike."""
    low, high = -(2**15) - 1, 2**15 - 1
    bits = 7 + 9 * rule.mu + 4  # of trace, weights and mantissa
    accumulator = w * 128
    for mantissa, exponent in rule.products:
        change = (x - rule.target) * (255 - w) ** rule.mu * mantissa
        change = math.floor(Fraction(change, 2 ** max(0, bits - 15))) * 2 ** (exponent + 7)
        accumulator += max(low, min(high, change))
        accumulator = max(low, min(high, accumulator))
    accumulator = max(0, accumulator)
    whole = accumulator // 128
    return min(255, whole + (chance < (accumulator - 128 * whole) / 128))


def shrunk(v: int, keep: int) -> int:
    """sign(v) floor(|v| keep / 4096)."""
    return int(math.copysign(1, v)) * (abs(v) * keep // 4096)


def present(
    weights: NDArray[np.uint8], theta: NDArray[np.int32], spikes: NDArray[np.bool_], learning: IntegerLearning, key: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """One presentation of input ``spikes`` (steps, inputs): weights, thresholds, traces after it, and the raster."""
    total, lif, rule = learning.steps + 3, learning.neurons, learning.rule
    w = [[int(x) for x in row] for row in weights]
    threshold = [int(x) for x in theta]
    inputs, n = len(w), len(threshold)
    trace_chance = uniform(derived_key(key, "trace"), total)
    weight_chance = uniform(derived_key(key, "round"), total)
    if learning.weight_sum:
        w = normalised(w, learning.weight_sum, key)
    x, v, held = [0] * inputs, [0] * n, [0] * n
    sums = [0] * n
    raster = np.zeros((total, n), np.int64)
    for t in range(total):
        now = []
        for i in range(n):
            a = sums[i] >> learning.shift
            if t >= 2:
                a -= learning.inhibition * int(raster[t - 2].sum() - raster[t - 2, i])
            v[i] = max(1 - M, min(M - 1, shrunk(v[i], 4096 - lif.dv) + a * 64))
            if lif.floor is not None:
                v[i] = max(v[i], lif.floor * 64)
            if held[i]:
                v[i], held[i] = 0, held[i] - 1
            if v[i] > threshold[i] * 64:
                v[i], held[i] = 0, lif.hold_steps
                if not learning.late_theta:
                    threshold[i] += lif.theta_plus
                now.append(i)
                raster[t, i] = 1
        on = np.flatnonzero(spikes[t]).tolist() if t < learning.steps else []
        sums = [sum(w[j][i] for j in on) for i in range(n)]
        for j in range(inputs):
            exact = math.exp(-1 / rule.tau) * x[j]
            x[j] = 127 if j in on else math.floor(exact) + (trace_chance[t] < exact % 1)
        for i in now:
            for j in range(inputs):
                w[j][i] = learned(w[j][i], x[j], rule, weight_chance[t])
    if learning.late_theta:
        threshold = [h + lif.theta_plus * int(c) for h, c in zip(threshold, raster.sum(axis=0), strict=True)]
    return np.array(w), np.array(threshold), np.array(x), raster
