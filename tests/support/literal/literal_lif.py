"""Networks of LIF neurons and dense synapses in plain Python integers, by the equations alone.

Used by engine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from support.literal.literal import M, shrink

from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses


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
    return total * 2**synapses.exponent if synapses.exponent >= 0 else total // 2**-synapses.exponent


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
