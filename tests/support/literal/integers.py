"""The literal model of Loihi's integers: networks and learning in plain Python numbers, by the equations alone.

Used by deploy and engine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters, SignMode
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.learning.integer import IntegerLearning, WeightRule
from lava_vpr.engine.random import GOLDEN, derived_key, uniform

M = 1 << 23
WORD = (1 << 64) - 1


def shrink(x: int, k: int) -> int:
    """D(x, k) of Lava's fixed-point LIF: sign(x) (|x| k >> 12)."""
    return (1 if x >= 0 else -1) * (abs(x) * k >> 12)


def literal_bias(mantissa: int, exponent: int) -> int:
    """mantissa 2^exponent, rounded down."""
    return mantissa * 2**exponent if exponent >= 0 else mantissa // 2**-exponent


def literal_weight(weight: int, synapses: Synapses) -> int:
    """What the chip stores: a multiple of 2^(8 - bits), of twice that if one bit is the sign; inhibition rounds up."""
    unit = 2 ** (8 - synapses.bits + (1 if synapses.sign == "mixed" else 0))
    return -(-weight // unit * unit) if synapses.sign == "inhibitory" else weight // unit * unit


def wrap(u: int) -> int:
    """Beyond 2^23 to the other end, once."""
    if u > M:
        return u - 2 * M
    return u + 2 * M if u <= -M else u


def literal_sum(synapses: Synapses, neuron: int, active: list[int]) -> int:
    """What ``neuron`` gets from the sources that spiked."""
    total = sum(literal_weight(int(synapses.weights[j, neuron]), synapses) for j in active)
    return literal_bias(total, synapses.exponent)


@dataclass
class Neuron:
    """One neuron: its state and its settings."""

    population: Population
    index: int
    u: int = 0
    v: int = 0
    held: int = 0
    vth: int = 0

    def __post_init__(self) -> None:
        n = self.population.size
        self.vth = int(self.population.threshold[self.index])
        mantissas, exponents = (np.broadcast_to(x, (n,)) for x in (self.population.bias_mant, self.population.bias_exp))
        self.bias = literal_bias(int(mantissas[self.index]), int(exponents[self.index]))

    def step(self, number: int, a: int) -> bool:
        """Integrate ``a``; whether it spikes."""
        own = self.population.parameters
        if self.population.reset_interval and number % self.population.reset_interval == 0:
            self.u = self.v = self.held = 0
        self.u = wrap(shrink(self.u, 4096 - (own.du + 1)) + a * 64)
        v = shrink(self.v, 4096 - own.dv) + self.u + self.bias
        v = max(-(M - 1), min(M - 1, v))
        if own.floor is not None:
            v = max(v, own.floor * 64)
        if self.held:
            v, self.held = 0, self.held - 1
        spike = v > self.vth * 64
        if spike:
            v, self.held, self.vth = 0, own.hold_steps, self.vth + own.theta_plus
        self.v = v
        return spike


def literal_run(
    network: GeneralNetwork, spikes: NDArray[np.bool_]
) -> tuple[list[NDArray[np.bool_]], list[list[int]], list[list[int]]]:
    """Spikes bool (steps, neurons), final u and final v of each population; input spikes bool (steps, inputs)."""
    populations = [[Neuron(p, i) for i in range(p.size)] for p in network.populations]
    films = [np.zeros((len(spikes), p.size), bool) for p in network.populations]
    for t in range(len(spikes)):
        for target, neurons in enumerate(populations):
            for neuron in neurons:
                a = 0
                for synapses in network.synapses:
                    if synapses.target == target and t > 0:
                        film = spikes if synapses.source == INPUTS else films[synapses.source]
                        active = [j for j in range(film.shape[1]) if film[t - 1, j]]
                        a += literal_sum(synapses, neuron.index, active)
                films[target][t, neuron.index] = neuron.step(t, a)
    return films, [[n.u for n in p] for p in populations], [[n.v for n in p] for p in populations]


def as_populations(network: FixedNetwork) -> GeneralNetwork:
    """The same network as populations and synapses: 0 is exc, 1 inh (leaves, then the root), 2 relays if there are any.

    Inputs go to exc, or to the relays and on; exc to the root, or to their leaf and on to the root, which takes from
    every exc.
    """
    n, interval = network.neurons, network.interval
    mantissas, exponent = network.bias_registers
    exc = Population(
        np.full(n, network.threshold), mantissas, exponent, LifParameters(dv=network.decay), reset_interval=interval
    )
    leaves = -(-n // fixed.FAN_IN) if n > fixed.FAN_IN else 0
    inh, relays = (
        Population(np.zeros(size, np.int64), parameters=LifParameters(dv=4095), reset_interval=interval)
        for size in (leaves + 1, network.inputs)
    )
    listen, gather = np.zeros((n, leaves + 1), np.int64), np.zeros((leaves + 1, leaves + 1), np.int64)
    take = np.zeros((leaves + 1, n), np.int64)
    for i in range(n):
        listen[i, i // fixed.FAN_IN if leaves else 0] = 2
    gather[:leaves, leaves] = 2
    take[leaves] = -network.inhibition
    relayed = n > fixed.DIRECT and not network.bias_input
    sign: SignMode = "mixed" if network.signed else "excitatory"
    stored = network.weights.astype(np.int64) * 2 ** (8 - network.bits)
    synapses = [
        Synapses(2 if relayed else INPUTS, 0, stored, network.bits + network.signed, network.bits - 8, sign),
        Synapses(0, 1, listen),
        Synapses(1, 0, take, 8, network.inhibition_exponent, "inhibitory"),
    ]
    if leaves:
        synapses.append(Synapses(1, 1, gather))
    if relayed:
        synapses.append(Synapses(INPUTS, 2, 2 * np.eye(network.inputs, dtype=np.int64)))
    return GeneralNetwork(network.inputs, (exc, inh, relays) if relayed else (exc, inh), tuple(synapses))


def present_fixed(network: FixedNetwork, spikes: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The rasters of exc and inh, (interval, ..), of one presentation of input spikes (steps, inputs)."""
    silence = np.zeros((network.interval - len(spikes), network.inputs), bool)
    films, _, _ = literal_run(as_populations(network), np.concatenate([spikes, silence]))
    return films[0], films[1]


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


def learned(w: int, x: int, rule: WeightRule, chance: float) -> int:
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


def present(
    weights: NDArray[np.uint8], theta: NDArray[np.int32], spikes: NDArray[np.bool_], learning: IntegerLearning, key: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """One presentation of input ``spikes`` (steps, inputs): weights, thresholds, traces after it, and the raster."""
    total, rule = learning.steps + 3, learning.rule
    lif = replace(learning.neurons, theta_plus=0) if learning.late_theta else learning.neurons
    w = [[int(x) for x in row] for row in weights]
    population = Population(theta, parameters=lif)
    neurons = [Neuron(population, i) for i in range(population.size)]
    inputs, n = len(w), len(neurons)
    trace_chance = uniform(derived_key(key, "trace"), total)
    weight_chance = uniform(derived_key(key, "round"), total)
    if learning.weight_sum:
        w = normalised(w, learning.weight_sum, key)
    x, sums = [0] * inputs, [0] * n
    raster = np.zeros((total, n), np.int64)
    for t in range(total):
        for i, neuron in enumerate(neurons):
            a = sums[i]
            if t >= 2 and raster[t - 2].any() and not raster[t - 2, i]:
                a -= learning.inhibition
            raster[t, i] = neuron.step(t, a)
        on = np.flatnonzero(spikes[t]).tolist() if t < learning.steps else []
        sums = [sum(w[j][i] for j in on) for i in range(n)]
        for j in range(inputs):
            exact = math.exp(-1 / rule.tau) * x[j]
            x[j] = 127 if j in on else math.floor(exact) + (trace_chance[t] < exact % 1)
        for i in np.flatnonzero(raster[t]).tolist():
            for j in range(inputs):
                w[j][i] = learned(w[j][i], x[j], rule, weight_chance[t])
    threshold = np.array([neuron.vth for neuron in neurons])
    if learning.late_theta:
        threshold += learning.neurons.theta_plus * raster.sum(axis=0)
    return np.array(w), threshold, np.array(x), raster
