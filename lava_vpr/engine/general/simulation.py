"""Simulation of any network of LIF populations and dense synapses in Loihi's integers: the literal model of the fast
kernels.

In every step, and in any wiring, loops included, each population integrates the sums that its synapses made from the
spikes of the *previous* step: each connection buffers one step, as Lava's Dense. The steps are those of
`engine.general.lif`. This engine is general and slow; the network of places has its own, `engine.inference.fixed`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import (
    LifParameters,
    SignMode,
    bias_of,
    check_thresholds,
    dense_step,
    lif_step,
    need,
    stored_weights,
)
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import WEIGHT_EXPONENT_LIMIT

INPUTS = -1
"""Index that stands for the inputs as a source of synapses."""


@dataclass(frozen=True)
class Population:
    """A population of LIF neurons.

    Attributes:
        threshold: Threshold of each neuron, in units of v >> 6, whole numbers (neurons,).
        bias_mant, bias_exp: Bias mant 2^exp in units of v, one for all or one per neuron; or (presentations, neurons)
            and (presentations, 1), a row for each interval, the last one for all later intervals.
        parameters: Settings that all its neurons share.
        reset_interval: Steps of a presentation: u, v and the hold are 0 at its start; 0: never reset.
    """

    threshold: NDArray[Any]
    bias_mant: NDArray[Any] | int = 0
    bias_exp: NDArray[Any] | int = 0
    parameters: LifParameters = field(default_factory=LifParameters)
    reset_interval: int = 0

    @property
    def size(self) -> int:
        """The number of neurons in this population."""
        return len(self.threshold)

    @property
    def bias(self) -> NDArray[np.int64]:
        """Bias of each neuron in units of v, int64 (neurons,), or (presentations, neurons)."""
        values = bias_of(self.bias_mant, self.bias_exp)
        return np.broadcast_to(values, (*values.shape[:-1], self.size)).copy()

    def check(self, name: str) -> None:
        """Refuse what the registers cannot hold.

        Raises:
            NetworkLimitError: naming the parameter.
        """
        need(self.threshold.ndim == 1 and self.size > 0, f"{name}: threshold's shape", self.threshold.shape, "(n,)")
        for key, value in (("bias_mant", self.bias_mant), ("bias_exp", self.bias_exp)):
            each = self.reset_interval > 0 and np.ndim(value) == 2 and np.shape(value)[1] in (1, self.size)
            fits = each or np.shape(value) in ((), (1,), (self.size,))
            need(fits, f"{name}: {key}'s shape", np.shape(value), f"({self.size},)")
        need(self.reset_interval >= 0, f"{name}: reset_interval", self.reset_interval, "at least 0")
        self.parameters.check()
        check_thresholds(self.threshold)
        bias_of(self.bias_mant, self.bias_exp)


@dataclass(frozen=True)
class Synapses:
    """Dense synapses between two populations, or from the inputs.

    Attributes:
        source: Index of a population, or `INPUTS`.
        target: Index of a population.
        weights: Whole numbers (pre, post), before ``bits`` and ``sign`` round off their low bits.
        bits: Lava's ``num_weight_bits``.
        exponent: Lava's ``weight_exp``: each sum is shifted by it.
        sign: Lava's ``sign_mode``.
    """

    source: int
    target: int
    weights: NDArray[Any]
    bits: int = 8
    exponent: int = 0
    sign: SignMode = "excitatory"

    @property
    def rows(self) -> NDArray[np.int32]:
        """The weights as synapse memory holds them, int32 (pre, post).

        Raises:
            NetworkLimitError: a weight out of its range.
        """
        return np.ascontiguousarray(stored_weights(self.weights, self.bits, self.sign))


@dataclass(frozen=True)
class GeneralNetwork:
    """Inputs, populations and the synapses between them."""

    inputs: int
    populations: tuple[Population, ...]
    synapses: tuple[Synapses, ...]

    def check(self) -> None:
        """Refuse a network that does not fit together, or does not fit the registers.

        Raises:
            NetworkLimitError: naming the population or the synapses, and the remedy.
        """
        for number, population in enumerate(self.populations):
            population.check(f"population {number}")
        last = len(self.populations) - 1
        for number, synapses in enumerate(self.synapses):
            name = f"synapses {number}"
            need(INPUTS <= synapses.source <= last, f"{name}: source", synapses.source, f"in {INPUTS}..{last}")
            need(0 <= synapses.target <= last, f"{name}: target", synapses.target, f"in 0..{last}")
            pre = self.inputs if synapses.source == INPUTS else self.populations[synapses.source].size
            shape = (pre, self.populations[synapses.target].size)
            if synapses.weights.shape != shape:
                raise NetworkLimitError(
                    f"{name}: weights are {synapses.weights.shape}, but must be (pre, post) = {shape}"
                )
            need(abs(synapses.exponent) <= WEIGHT_EXPONENT_LIMIT, f"{name}: exponent", synapses.exponent, "in -7..7")
            stored_weights(synapses.weights, synapses.bits, synapses.sign)


@dataclass(frozen=True)
class Recording:
    """What a run of a network recorded, one array for each population.

    Attributes:
        spikes: bool (steps, neurons).
        u, v: Current and membrane after the last step, int32 (neurons,).
        threshold: Threshold after the last step, int32 (neurons,).
        film_u, film_v: Current and membrane after each step, int32 (steps, neurons); empty tuples unless recorded.
        film_drive: Input sums of each step, int64 (steps, neurons); an empty tuple unless recorded.
    """

    spikes: tuple[NDArray[np.bool_], ...]
    u: tuple[NDArray[np.int32], ...]
    v: tuple[NDArray[np.int32], ...]
    threshold: tuple[NDArray[np.int32], ...]
    film_u: tuple[NDArray[np.int32], ...] = ()
    film_v: tuple[NDArray[np.int32], ...] = ()
    film_drive: tuple[NDArray[np.int64], ...] = ()


class _State:
    """A population while it runs: its arrays in the order that `lif_step` takes them."""

    def __init__(self, population: Population, steps: int, record: bool) -> None:
        n = population.size
        self.interval = population.reset_interval
        self.u, self.v, self.held = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
        self.threshold = population.threshold.astype(np.int32)
        self.drive = np.zeros(n, np.int64)
        self.biases, self.constants = np.atleast_2d(population.bias), population.parameters.constants
        self.bias = self.biases[0]
        self.fired, self.before = np.zeros(n, bool), np.zeros(n, bool)
        self.spikes = np.zeros((steps, n), bool)
        shape = (steps if record else 0, n)
        self.films = np.zeros(shape, np.int32), np.zeros(shape, np.int32), np.zeros(shape, np.int64)

    def advance(self, step: int) -> None:
        """Integrate the input sums ``drive`` in step ``step``, and record the results."""
        if self.interval and step % self.interval == 0:
            self.u[:] = self.v[:] = self.held[:] = 0
            self.bias = self.biases[min(step // self.interval, len(self.biases) - 1)]
        lif_step(self.u, self.v, self.threshold, self.held, self.drive, self.bias, self.constants, self.fired)
        self.spikes[step] = self.fired
        if len(self.films[0]):
            film_u, film_v, film_drive = self.films
            film_u[step], film_v[step], film_drive[step] = self.u, self.v, self.drive


def simulate(network: GeneralNetwork, spikes: NDArray[np.bool_], *, record: bool = False) -> Recording:
    """Run ``network`` on input ``spikes``, from zero.

    Args:
        network: What to run.
        spikes: Input spikes, bool (steps, inputs); those of step t arrive at step t + 1.
        record: Also record u, v and the input sums of every step.
    Raises:
        NetworkLimitError: the network or the spikes do not fit (`GeneralNetwork.check`).
    """
    network.check()
    if spikes.ndim != 2 or spikes.shape[1] != network.inputs or spikes.dtype != np.bool_:
        raise NetworkLimitError(
            f"input spikes are {spikes.dtype} {spikes.shape}, but must be bool (steps, {network.inputs})"
        )
    states = [_State(population, len(spikes), record) for population in network.populations]
    parts = [(synapses, synapses.rows) for synapses in network.synapses]
    sums = [(np.zeros(rows.shape[1], np.int64), np.zeros(rows.shape[1], np.int32)) for _, rows in parts]
    silence = np.zeros(network.inputs, bool)
    for step in range(len(spikes)):
        arrived = spikes[step - 1] if step else silence
        for state in states:
            state.before[:] = state.fired
            state.drive[:] = 0
        for (synapses, rows), (total, scratch) in zip(parts, sums, strict=True):
            source = arrived if synapses.source == INPUTS else states[synapses.source].before
            dense_step(rows, source, synapses.exponent, total, scratch)
            states[synapses.target].drive += total
        for state in states:
            state.advance(step)
    recording = Recording(
        tuple(state.spikes for state in states),
        tuple(state.u for state in states),
        tuple(state.v for state in states),
        tuple(state.threshold for state in states),
    )
    if not record:
        return recording
    films: list[tuple[Any, ...]] = [tuple(state.films[k] for state in states) for k in range(3)]
    return Recording(recording.spikes, recording.u, recording.v, recording.threshold, *films)
