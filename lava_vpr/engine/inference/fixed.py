"""The inference network in Loihi's integer arithmetic, as Lava's bit-accurate models compute it.

Per step, in the units and with the truncations of lava-nc 0.10 (``proc/lif/models.py``, ``proc/dense/models.py``)::

    a  = (sum of weights of the inputs that spiked one step ago) >> shift
         - inhibition (number of *other* neurons that spiked two steps ago)
    u  = a << 6, wrapped into 24 bits         (du = 4095: currents have no memory)
    v  = clip(sign(v) (|v| (4096 - dv) >> 12) + u, +-(2^23 - 1))
    spike if v > vth << 6, then v = 0

An excitatory spike makes its inhibitory relay fire one step later, which reaches every other neuron after one more. A
presentation is ``steps`` steps with input and `SILENT_STEPS` without, after which nothing is in flight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.entry import check_presentations
from lava_vpr.engine.inference.bias_input import biases
from lava_vpr.engine.inference.fixed_kernels import KernelNumbers, present
from lava_vpr.engine.threads import share
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import (
    DECAY_BITS,
    DECAY_UNITY,
    INPUT_LIMIT,
    INPUT_SHIFT,
    THRESHOLD_LIMIT,
    WEIGHT_BITS,
    WEIGHT_EXPONENT_LIMIT,
    WEIGHT_LIMIT,
)

_PADDING = 32
SCALARS = {
    "bits": "bits",
    "shift": "shift",
    "threshold": "threshold",
    "inhibition": "inhibition",
    "inhibition_exponent": "inhibition_exponent",
    "decay": "decay",
    "steps": "steps",
    "regular": "bias_input",
}
"""The numbers of a `FixedNetwork` besides its weights: their keys in files, and their attributes."""

EVENTS = (
    "synaptic_operations",
    "synaptic_operations_dense",
    "neuron_updates",
    "input_spikes",
    "exc_spikes",
    "inh_spikes",
    "messages",
    "steps",
)
"""The events that a run counts; see `named_events`."""

SILENT_STEPS = 3
"""Steps after the last input: its spikes reach exc (1), exc's its relay (2), the relay's the others (3)."""


class Prepared(NamedTuple):
    """A `FixedNetwork` as the kernel reads it: see `FixedNetwork.prepared`."""

    weights: NDArray[np.uint8]
    row_sizes: NDArray[np.int64]
    numbers: KernelNumbers


@dataclass(frozen=True)
class FixedNetwork:
    """Everything about the inference network, in integers; every fixed-point backend runs exactly this.

    Attributes:
        weights: Unsigned weights k < 2^bits, uint8 (inputs, neurons).
        bits: Bits of a weight, 1..8. Lava stores k << (8 - bits).
        shift: Right shift of the input sum; Lava's weight_exp is ``bits - 8 - shift``.
        threshold: vth, compared with v >> 6.
        inhibition: What a spike takes from every other neuron, mantissa of the lateral synapses (<= 255 x 2^exponent).
        inhibition_exponent: Exponent of the lateral synapses; what a spike takes is inhibition 2^exponent.
        decay: dv in units of 2^-12.
        steps: Steps with input in one presentation.
        bias_input: Whether input compartments integrate a bias (`engine.inference.bias_input`); else Poisson spikes are
            injected. In files this is ``regular``, 1 or 0.
    """

    weights: NDArray[np.uint8]
    bits: int
    shift: int
    threshold: int
    inhibition: int
    inhibition_exponent: int
    decay: int
    steps: int
    bias_input: bool = False

    @classmethod
    def of_scalars(cls, weights: NDArray[np.uint8], scalars: Mapping[str, int]) -> FixedNetwork:
        """The network of ``weights`` and the numbers that `scalars` gives.

        Raises:
            KeyError: a number is missing.
            NetworkLimitError: ``regular`` is no truth value.
        """
        numbers: dict[str, Any] = {attribute: int(scalars[key]) for key, attribute in SCALARS.items()}
        if numbers["bias_input"] not in (0, 1):
            raise NetworkLimitError(f"regular {numbers['bias_input']} is neither 0 nor 1; train the model again")
        return cls(weights, **numbers | {"bias_input": bool(numbers["bias_input"])})

    @property
    def scalars(self) -> dict[str, int]:
        """The numbers besides the weights, by their keys in files (`SCALARS`)."""
        return {key: int(getattr(self, attribute)) for key, attribute in SCALARS.items()}

    @property
    def inputs(self) -> int:
        """The number of input neurons."""
        return int(self.weights.shape[0])

    @property
    def neurons(self) -> int:
        """The number of excitatory neurons."""
        return int(self.weights.shape[1])

    @property
    def input_compartments(self) -> int:
        """Number of compartments that the inputs take: none where their spikes are injected."""
        return self.inputs if self.bias_input else 0

    @property
    def lateral(self) -> int:
        """Inhibition of one spike in units of the input sum."""
        return self.inhibition << self.inhibition_exponent

    @property
    def stored(self) -> tuple[NDArray[np.int32], int, int]:
        """The weights as synapse memory holds them, (neurons, inputs), with Lava's num_weight_bits and weight_exp.

        A b-bit weight k is stored as k 2^(8 - b), which the exponent takes back. Where that exponent would leave its
        range, k moves down and takes more bits: the sums are the same.
        """
        spare = WEIGHT_BITS - self.bits
        spare -= min(spare, max(0, spare + self.shift - WEIGHT_EXPONENT_LIMIT))
        return self.weights.T.astype(np.int32) << spare, WEIGHT_BITS - spare, -spare - self.shift

    @cached_property
    def prepared(self) -> Prepared:
        """The network as the kernel reads it, made once.

        The weights (inputs, width) are padded with silent neurons to whole vector registers; the row sizes (inputs,)
        are the numbers of each input's weights that are not 0.
        """
        weights = np.zeros((self.inputs, -(-self.neurons // _PADDING) * _PADDING), np.uint8)
        weights[:, : self.neurons] = self.weights
        numbers = KernelNumbers(
            shift=np.int32(self.shift),
            threshold=np.int32(self.threshold << INPUT_SHIFT),
            lateral=np.int32(self.lateral),
            keep=np.int32(DECAY_UNITY - self.decay),
            steps=self.steps,
            total=self.steps + SILENT_STEPS,
            chunk=np.iinfo(np.uint8).max // max(1, int(weights.max(initial=0))),
            bias_input=self.bias_input,
        )
        return Prepared(weights, np.count_nonzero(weights, axis=1).astype(np.int64), numbers)

    @cached_property
    def narrow(self) -> bool:
        """Whether no input sum can leave 16 bits."""
        return int(self.weights.sum(axis=0, dtype=np.int64).max(initial=0)) <= np.iinfo(np.int16).max

    def check(self, limit: int = INPUT_LIMIT, target: str = "Loihi's 24-bit current") -> None:
        """Refuse a network whose input sum of one step could overflow ``limit``.

        Raises:
            NetworkLimitError: naming need, limit and remedy.
        """
        if not 1 <= self.bits <= 8 or (self.weights.size and int(self.weights.max()) >= 1 << self.bits):
            raise NetworkLimitError(f"weights need {self.bits} bits to hold {int(self.weights.max())}; use 1 to 8 bits")
        exponent = WEIGHT_EXPONENT_LIMIT
        for name, most in (("shift", exponent), ("decay", 1 << DECAY_BITS), ("inhibition_exponent", exponent)):
            if not 0 <= getattr(self, name) <= most:
                raise NetworkLimitError(f"{name} {getattr(self, name)} does not fit 0..{most}; train the model again")
        if self.steps < 1:
            raise NetworkLimitError(f"a presentation of {self.steps} steps holds no input; use at least 1")
        if not 0 < self.threshold < THRESHOLD_LIMIT:
            raise NetworkLimitError(
                f"threshold {self.threshold} does not fit 1..{THRESHOLD_LIMIT - 1}; lower network.threshold"
            )
        if not 0 <= self.inhibition <= WEIGHT_LIMIT:
            raise NetworkLimitError(
                f"inhibition mantissa {self.inhibition} does not fit 0..{WEIGHT_LIMIT}; raise its exponent"
            )
        need = (self.neurons - 1) * self.lateral
        if need >= limit:
            most = (limit - 1) // max(1, self.lateral) + 1
            raise NetworkLimitError(
                f"lateral inhibition of {self.neurons} neurons can reach {need:,}, but {target} holds less than "
                f"{limit:,}; lower network.inhibition (or joined_inhibition) or use at most {most} neurons"
            )
        excitation = int(self.weights.sum(axis=0, dtype=np.int64).max(initial=0)) >> self.shift
        if excitation >= limit:
            raise NetworkLimitError(
                f"the weights of one neuron sum to {excitation:,}, but {target} holds less than {limit:,}; "
                "use fewer weight bits or fewer inputs"
            )


def named_events(network: FixedNetwork, operations: int, input_spikes: int, exc_spikes: int, n: int) -> dict[str, int]:
    """Named events of ``n`` presentations: ``operations`` are those of the input synapses with a weight.

    A neuron counts as updated when it has a reason to: excitatory ones in every step from the first that input can
    reach, inhibitory ones when hit. Every spike of the inputs and of both populations is one message (to one core).
    """
    exc = exc_spikes
    lateral = exc * (network.neurons - 1)
    return {
        "synaptic_operations": operations + exc + lateral,
        "synaptic_operations_dense": input_spikes * network.neurons + exc + exc * network.neurons,
        "neuron_updates": n * network.neurons * (network.steps + SILENT_STEPS - 1) + exc,
        "input_spikes": input_spikes,
        "exc_spikes": exc,
        "inh_spikes": exc,
        "messages": input_spikes + 2 * exc,
        "steps": n * (network.steps + SILENT_STEPS),
    }


def count_spikes(
    network: FixedNetwork,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    *,
    threads: int = 1,
    raster: bool = False,
) -> tuple[NDArray[np.int32], dict[str, int], NDArray[np.uint8]]:
    """Present every image to the network.

    Args:
        network: The network, checked (`FixedNetwork.check`).
        rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
        keys: One key per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
        threads: Threads that share the images; the result does not depend on it.
        raster: Also record every excitatory spike.
    Returns:
        Spike counts int32 (n, neurons); events by name, summed; raster uint8 (n, steps + 3, neurons) or empty.
    Raises:
        InputError: rates or keys of another type or shape.
    """
    check_presentations(rates, keys, np.uint16, network.inputs)
    n = len(rates)
    counts = np.zeros((n, network.neurons), np.int32)
    film = np.zeros((n, network.steps + SILENT_STEPS, network.neurons) if raster else (0, 0, 0), np.uint8)
    prepared, narrow = network.prepared, network.narrow
    rates = np.ascontiguousarray(rates)
    bias = np.left_shift(*biases(rates)) if network.bias_input else np.zeros((n, 0), np.int32)

    def run(part: slice) -> NDArray[np.int64]:
        events = np.zeros(3, np.int64)
        acc = np.zeros(prepared.weights.shape[1], np.int16 if narrow else np.int32)
        present(*prepared, rates[part], bias[part], keys[part], acc, counts[part], events, film[part])
        return events

    totals = share(run, n, threads)
    raw = np.sum(totals, axis=0, dtype=np.int64) if totals else np.zeros(3, np.int64)
    return counts, named_events(network, int(raw[0]), int(raw[1]), int(raw[2]), n), film
