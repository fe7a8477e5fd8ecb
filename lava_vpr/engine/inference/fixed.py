"""The inference network in Loihi's integer arithmetic, as Lava's bit-accurate models compute it.

Per step t, in the units and with the truncations of lava-nc 0.10 (``proc/lif/models.py``, ``proc/dense/models.py``)::

    a  = sum of weights of the inputs that spiked at t - input_delay
         - inhibition, if any excitatory neuron spiked at t - inhibition_delay
    u  = a << 6, wrapped into 24 bits         (du = 4095: currents have no memory)
    v  = clip(sign(v) (|v| (4096 - dv) >> 12) + u + bias, +-(2^23 - 1))
    spike if v > vth << 6, then v = 0

One inhibitory neuron listens to all excitatory ones, fires one step after any of them, and one step later inhibits
every one equally, winners included. It can listen to at most `FAN_IN` neurons. In a larger network every `FAN_IN`
neurons have a leaf, and the root listens to the leaves, which takes one more step. Where neurons are spread over many
cores, injected spikes reach them through relays on the chip, one step later. Both depend only on the number of neurons
(`FixedNetwork.depth`, `input_delay`).

A presentation is ``steps`` steps with input and `FixedNetwork.silent_steps` without, after which nothing is in flight.
A network that hears the cells of a front end themselves has other currents (`lava_vpr.engine.inference.direct`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.biases import bias_registers, check_bias, highest_bias, safe_bias
from lava_vpr.engine.inference.direct import SILENCING
from lava_vpr.engine.inference.fixed_kernels import KernelNumbers, add_weighted, laid_out
from lava_vpr.engine.presentations import check_array
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import BURST, BURST_STEPS
from lava_vpr.loihi import (
    CORE_AXONS,
    DECAY_UNITY,
    INPUT_LIMIT,
    INPUT_SHIFT,
    STATE_LIMIT,
    THRESHOLD_LIMIT,
    WEIGHT_BITS,
    WEIGHT_EXPONENT_LIMIT,
    WEIGHT_LIMIT,
)
from lava_vpr.neurons.models import LIF

SCALARS = (
    *("bits", "signed", "threshold", "inhibition", "inhibition_exponent"),
    *("decay", "steps", "regular", "bias_input"),
)
"""The scalar fields of every `FixedNetwork`, all but weights and biases; files use the same names. Only one that hears
cells directly has `OF_DIRECT`, too."""

OF_DIRECT = ("rising", "rise")

FAN_IN = CORE_AXONS
"""Neurons that one inhibitory neuron can listen to: each needs an input axon of its core."""

DIRECT_SILENT = 2
"""Steps after the last spike of a neuron that hears cells directly: to the inhibitory one, and back."""

DIRECT = 1024
"""Most neurons that injected spikes reach directly; with more, on many cores, relays on the chip pass them on."""


def inhibitory_depth(neurons: int) -> int:
    """Inhibitory neurons in a row between an excitatory spike and the inhibition that it causes: 1 or 2."""
    return 1 if neurons <= FAN_IN else 2


def input_delay(neurons: int, bias_input: bool) -> int:
    """Steps from an input's spike to ``neurons`` neurons: 2 through relays, which inputs on the chip do not need."""
    return 1 if bias_input or neurons <= DIRECT else 2


def silent_steps(neurons: int, bias_input: bool) -> int:
    """Steps after the last input until all its effects are over: to exc, to each inhibitory neuron, and back."""
    return input_delay(neurons, bias_input) + inhibitory_depth(neurons) + 1


class Prepared(NamedTuple):
    """A `FixedNetwork` as the kernel reads it: see `FixedNetwork.prepared`."""

    weights: NDArray[Any]
    row_sizes: NDArray[np.int64]
    numbers: KernelNumbers


@dataclass(frozen=True)
class FixedNetwork:
    """The full specification of the inference network in integers, which every fixed-point backend runs exactly.

    Attributes:
        weights: Weights k with |k| < 2^bits, int16 (inputs, neurons); none below 0 unless ``signed``.
        bias: What each membrane gains in every step, in units of v, int32 (neurons,); alone it makes no neuron spike.
        bits: Bits of a weight's magnitude, 1..8, with a sign 1..7. Lava stores k << (8 - bits).
        signed: Whether weights have a sign, which takes a bit more.
        threshold: vth, compared with v >> 6.
        inhibition: What a spike of the root subtracts: mantissa of its synapses (<= 255 x 2^exponent).
        inhibition_exponent: Exponent of those synapses.
        decay: dv in units of 2^-12.
        steps: Steps with input in one presentation.
        regular: Whether inputs spike regularly (`engine.inference.biases`) instead of by Poisson draws.
        bias_input: Whether regular inputs are compartments of the chip, which integrate a bias; else all input spikes
            are injected.
        rising, rise: Where the network hears the cells of a front end themselves (`lava_vpr.engine.inference.direct`),
            the step from which on every step adds to all currents, and how much; 0: inputs have rates.
        model: The neuron model (`lava_vpr.neurons.models`); boards, Processes and other formats have ``lif`` alone.
    """

    weights: NDArray[np.int16]
    bias: NDArray[np.int32] = field(repr=False)
    bits: int
    signed: bool
    threshold: int
    inhibition: int
    inhibition_exponent: int
    decay: int
    steps: int
    regular: bool = False
    bias_input: bool = False
    rising: int = 0
    rise: int = 0
    model: str = LIF.name

    @classmethod
    def of_scalars(
        cls, weights: NDArray[np.int16], bias: NDArray[np.int32], scalars: Mapping[str, int]
    ) -> FixedNetwork:
        """The network of ``weights``, ``bias`` and the numbers that `scalars` gives.

        Raises:
            KeyError: a number is missing.
            NetworkLimitError: a truth value is none.
        """
        numbers: dict[str, Any] = {name: int(scalars[name]) for name in SCALARS}
        numbers |= {name: int(scalars.get(name, 0)) for name in OF_DIRECT}
        for name in ("signed", "regular", "bias_input"):
            if numbers[name] not in (0, 1):
                raise NetworkLimitError(f"{name} {numbers[name]} is neither 0 nor 1; train the model again")
            numbers[name] = bool(numbers[name])
        return cls(weights, bias, **numbers)

    @property
    def direct(self) -> bool:
        """Whether neurons hear the cells of a front end themselves."""
        return self.rising > 0

    @property
    def bias_steps(self) -> int:
        """Steps of input that one bias counts for: a membrane that keeps nothing gains it once for all of a burst."""
        return BURST_STEPS if self.direct else 1

    @property
    def scalars(self) -> dict[str, int]:
        """The numbers besides weights and biases, by name (`SCALARS`)."""
        names = (*SCALARS, *(OF_DIRECT if self.direct else ()))
        return {name: int(getattr(self, name)) for name in names}

    @property
    def inputs(self) -> int:
        """The number of input neurons."""
        return int(self.weights.shape[0])

    @property
    def neurons(self) -> int:
        """The number of excitatory neurons."""
        return int(self.weights.shape[1])

    @property
    def leaves(self) -> int:
        """Number of leaves, which listen to `FAN_IN` neurons each but the last; 0: the root listens to all."""
        return 0 if self.depth == 1 else -(-self.neurons // FAN_IN)

    @property
    def inhibitory(self) -> int:
        """The number of inhibitory neurons: the leaves, then the root, the last of them."""
        return self.leaves + 1

    @property
    def depth(self) -> int:
        """See `inhibitory_depth`."""
        return inhibitory_depth(self.neurons)

    @property
    def input_delay(self) -> int:
        """Steps from an input's spike to the neurons; see `input_delay`."""
        return input_delay(self.neurons, self.bias_input or self.direct)

    @property
    def inhibition_delay(self) -> int:
        """Steps from an excitatory spike to the inhibition of all neurons."""
        return self.depth + 1

    @property
    def silent_steps(self) -> int:
        """Steps without input at the end of a presentation; see `silent_steps`."""
        return DIRECT_SILENT if self.direct else silent_steps(self.neurons, self.bias_input)

    @property
    def interval(self) -> int:
        """Steps of a presentation, the silent ones included."""
        return self.steps + self.silent_steps

    @property
    def relayed(self) -> bool:
        """Whether relays on the chip, one an input, pass injected spikes on to the cores."""
        return self.input_delay == 2

    @property
    def input_compartments(self) -> int:
        """Number of compartments that stand for inputs: they integrate a bias, or relay injected spikes."""
        return self.inputs if self.bias_input or self.relayed else 0

    @property
    def lateral(self) -> int:
        """What a spike of the root subtracts, in units of the input sum."""
        return self.inhibition << self.inhibition_exponent

    @property
    def stored_bits(self) -> int:
        """Bits of a stored weight: its magnitude's, and one for a sign."""
        return self.bits + self.signed

    @property
    def stored(self) -> tuple[NDArray[np.int32], int, int]:
        """The weights as synapse memory holds them, (neurons, inputs), with Lava's num_weight_bits and weight_exp.

        A weight k of b bits is stored as k 2^(8 - b), which the exponent takes back. With a sign a synapse of n bits
        has n - 1 of magnitude: Lava drops the lowest of the 9 bits of -256..255 (``utils/weightutils.py``).
        """
        spare = WEIGHT_BITS - self.bits
        return self.weights.T.astype(np.int32) << spare, self.stored_bits, -spare

    @property
    def bias_registers(self) -> tuple[NDArray[np.int32], int]:
        """Mantissas int32 (neurons,) of the biases and their common exponent, the smallest that holds them."""
        mantissas, exponent = bias_registers(self.bias)
        return mantissas, int(exponent)

    @property
    def highest_bias(self) -> int:
        """The largest bias with which no membrane rises above the threshold without input."""
        return highest_bias(self.threshold, self.decay)

    @property
    def safe_bias(self) -> int:
        """The largest bias that training and queries set: `highest_bias` with a unit of decay to spare."""
        return safe_bias(self.threshold, self.decay)

    @cached_property
    def prepared(self) -> Prepared:
        """The network as the kernel reads it, made once.

        The weights are laid out by `fixed_kernels.laid_out`; the row sizes (inputs,) are the numbers of each input's
        weights that are not 0.
        """
        numbers = KernelNumbers(
            threshold=np.int32(self.threshold << INPUT_SHIFT),
            lateral=np.int32(self.lateral),
            keep=np.int32(DECAY_UNITY - self.decay),
            steps=self.steps,
            total=self.interval,
            input_delay=self.input_delay,
            inhibition_delay=self.inhibition_delay,
            leaf=FAN_IN if self.leaves else 0,
            regular=self.regular,
            rising=self.rising,
            rise=np.int32(self.rise),
        )
        return Prepared(laid_out(self.weights), np.count_nonzero(self.weights, axis=1).astype(np.int64), numbers)

    @cached_property
    def span(self) -> tuple[int, int]:
        """The smallest weight, at most 0, and the largest, at least 0."""
        return int(self.weights.min(initial=0)), int(self.weights.max(initial=0))

    @cached_property
    def sums(self) -> tuple[int, int]:
        """The largest sum of one neuron's positive weights, and of the magnitudes of its negative ones."""
        up = np.maximum(self.weights, 0).sum(axis=0, dtype=np.int64).max(initial=0)
        down = np.minimum(self.weights, 0).sum(axis=0, dtype=np.int64).min(initial=0)
        return int(up), int(-down)

    @property
    def extremes(self) -> tuple[int, int]:
        """The most that the spikes of one step can add to a neuron's input sum, and the most that they can subtract."""
        up, down = self.sums
        return up, max(down, SILENCING if self.direct else 0) + self.lateral

    @cached_property
    def narrow(self) -> bool:
        """Whether no input sum can leave 16 bits."""
        return max(self.sums) <= np.iinfo(np.int16).max

    def drives(self, rates: NDArray[np.uint16]) -> NDArray[np.int64]:
        """The sum of each neuron's weights times ``rates`` (n, inputs), in units of both, int64 (n, neurons)."""
        weights, sums = self.prepared.weights, np.empty((len(rates), self.neurons), np.int64)
        add_weighted(weights, rates, np.zeros(weights.shape[1], np.int32 if self.narrow else np.int64), sums)
        return sums

    def bounded(self, bias: NDArray[np.int32]) -> bool:
        """Whether no current can wrap and no membrane be clipped with ``bias`` (any shape), whatever spikes arrive."""
        most = (max(self.extremes) << INPUT_SHIFT) + int(np.abs(bias).max(initial=0))  # of a step; decay ends their sum
        return max(self.extremes) < INPUT_LIMIT and most * DECAY_UNITY < STATE_LIMIT * self.decay

    def check_presented(self, bias: NDArray[np.int32], n: int) -> None:
        """Refuse biases of ``n`` presentations that are not int32 (n, neurons), or that `check_bias` refuses.

        Raises:
            InputError: another type or shape.
            NetworkLimitError: a bias out of its range.
        """
        check_array(bias, "biases", np.int32, (n, self.neurons), "give one row for each image")
        check_bias(bias, self.highest_bias)

    def check(self, limit: int = INPUT_LIMIT, target: str = "Loihi's 24-bit current") -> None:
        """Refuse a network whose input sum of one step could overflow ``limit``, or that registers cannot hold.

        Raises:
            NetworkLimitError: naming need, limit and remedy.
        """
        most, (least, largest) = WEIGHT_BITS - self.signed, self.span
        need = max(largest, -least)
        if not 1 <= self.bits <= most or need >= 1 << self.bits:
            raise NetworkLimitError(f"weights need {self.bits} bits to hold {need}; use 1 to {most} bits")
        if not self.signed and least < 0:
            raise NetworkLimitError(f"a weight of {least} has a sign; set network.signed")
        if self.bias_input and not self.regular:
            raise NetworkLimitError("inputs that integrate a bias spike regularly; set network.trains to regular")
        if self.steps < 1:
            raise NetworkLimitError(f"a presentation of {self.steps} steps holds no input; use at least 1")
        for name, lowest, highest, remedy in (
            ("decay", 0, DECAY_UNITY, "train the model again"),
            ("threshold", 1, THRESHOLD_LIMIT - 1, "lower network.threshold"),
            ("inhibition", 0, WEIGHT_LIMIT, "raise its exponent"),
            ("inhibition_exponent", 0, WEIGHT_EXPONENT_LIMIT, "lower network.inhibition"),
        ):
            if not lowest <= (value := getattr(self, name)) <= highest:
                raise NetworkLimitError(f"{name} {value} does not fit {lowest}..{highest}; {remedy}")
        check_bias(self.bias, self.highest_bias)
        if self.direct:
            self._check_direct()
        for name, need in zip(("weights above 0", "weights below 0 and inhibition"), self.extremes, strict=True):
            if need >= limit:
                raise NetworkLimitError(
                    f"the {name} of one neuron sum to {need:,}, but {target} holds less than {limit:,}; "
                    "use fewer weight bits or fewer inputs"
                )

    def _check_direct(self) -> None:
        """Refuse a network that hears cells directly, but could not be silenced, or listened to."""
        risen = self.rise * (self.steps - self.rising)
        most = (BURST - 1) * self.sums[0] + risen
        if self.leaves or not self.rising < self.steps:
            raise NetworkLimitError(
                f"{self.neurons:,} neurons in {self.steps} steps cannot hear cells directly; learn fewer than "
                f"{FAN_IN:,} places, or with --input frontend"
            )
        if most >= SILENCING:
            raise NetworkLimitError(
                f"cells and the clock can bring a neuron {most:,}, but the clock takes {SILENCING:,} to silence it; "
                "use fewer weight bits or a lower encoder.read_threshold"
            )
