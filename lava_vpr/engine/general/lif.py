"""Leaky integrate-and-fire neurons and dense synapses in Loihi's integers, one step at a time.

The arithmetic is that of the bit-accurate models of lava-nc 0.10 (its ``proc/lif`` and ``proc/dense``), with
M = 2^23 and D(x, k) = sign(x) (|x| k >> 12)::

    u' = D(u, 4096 - (du + 1)) + (a << 6);   u' > M -> u' - 2M;   u' <= -M -> u' + 2M
    v' = clip(D(v, 4096 - dv) + u' + b, +-(M - 1));   b = mantissa << exponent   (>> when it is negative)
    spike = v' > (threshold << 6);   v'[spike] = 0

Learning needs three things more, which Lava's LIF lacks: ``v'`` has a floor, stays at 0 for some steps after a spike,
and each spike may raise its neuron's threshold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import NetworkLimitError
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import (
    BIAS_BITS,
    DECAY_BITS,
    DECAY_UNITY,
    INPUT_SHIFT,
    STATE_LIMIT,
    THRESHOLD_LIMIT,
    WEIGHT_BITS,
    WEIGHT_EXPONENT_LIMIT,
    WEIGHT_LIMIT,
)

SignMode = Literal["null", "mixed", "excitatory", "inhibitory"]
NO_FLOOR = -STATE_LIMIT
"""The floor that stands for none: below every membrane."""


def need(condition: bool, name: str, value: Any, limit: str) -> None:
    """Refuse a parameter that the chip's registers cannot hold.

    Raises:
        NetworkLimitError: naming the parameter, its value and its range.
    """
    if not condition:
        raise NetworkLimitError(f"{name} is {value}, but must be {limit}; choose a value that Loihi's registers hold")


class LifConstants(NamedTuple):
    """`LifParameters` as `lif_step` reads them: factors of u and v in units of 2^-12, and the floor in units of v."""

    keep_u: int
    keep_v: int
    floor: int
    hold_steps: int
    theta_plus: int


@dataclass(frozen=True)
class LifParameters:
    """The settings that a population of leaky integrate-and-fire neurons shares.

    With the input sum a of a step, the current u, the membrane v, the bias b and the threshold th of a neuron, and
    D(x, k) = sign(x) (|x| k >> 12), which shrinks x towards 0 as the chip does::

        u' = D(u, 4095 - du) + (a << 6)          wrapped into 24 bits
        v' = D(v, 4096 - dv) + u' + b            clipped to 24 bits, then to at least floor << 6;
                                                 0 in the hold_steps steps after a spike
        spike = v' > (th << 6)                   then v' = 0 and th' = min(th + theta_plus, 2^17 - 1)

    Attributes:
        du: Decay of the current u in units of 2^-12, 0..4095. With 4095 a current has no memory.
        dv: Decay of the membrane v in units of 2^-12, 0..4096. With 4096 a membrane has no memory.
        floor: Lower bound of the membrane in the unit of the threshold, 2^6 units of v. None is no bound.
        hold_steps: Number of steps after a spike in which the membrane stays at 0.
        theta_plus: Permanent rise of a neuron's threshold with each of its spikes.
    """

    du: int = 4095
    dv: int = 0
    floor: int | None = None
    hold_steps: int = 0
    theta_plus: int = 0

    def check(self) -> None:
        """Refuse what the registers cannot hold.

        Raises:
            NetworkLimitError: a parameter is out of its range.
        """
        need(0 <= self.du < DECAY_UNITY, "du", self.du, f"in 0..{DECAY_UNITY - 1}")
        need(0 <= self.dv <= DECAY_UNITY, "dv", self.dv, f"in 0..{DECAY_UNITY}")
        bound = STATE_LIMIT >> INPUT_SHIFT
        need(self.floor is None or -bound < self.floor <= 0, "floor", self.floor, f"in {1 - bound}..0")
        need(self.hold_steps >= 0, "hold_steps", self.hold_steps, "at least 0")
        need(0 <= self.theta_plus < THRESHOLD_LIMIT, "theta_plus", self.theta_plus, f"in 0..{THRESHOLD_LIMIT - 1}")

    @property
    def constants(self) -> LifConstants:
        """The settings as `lif_step` takes them."""
        floor = NO_FLOOR if self.floor is None else self.floor << INPUT_SHIFT
        return LifConstants(DECAY_UNITY - self.du - 1, DECAY_UNITY - self.dv, floor, self.hold_steps, self.theta_plus)


def check_thresholds(threshold: NDArray[Any] | int) -> None:
    """Refuse thresholds that 17 bits cannot hold.

    Raises:
        NetworkLimitError: naming the first.
    """
    values = np.atleast_1d(np.asarray(threshold))
    outside = values[(values < 0) | (values >= THRESHOLD_LIMIT) | (values != np.floor(values))]
    need(
        not outside.size, "threshold", outside[0] if outside.size else "", f"a whole number in 0..{THRESHOLD_LIMIT - 1}"
    )


def bias_of(mantissa: NDArray[Any] | int, exponent: NDArray[Any] | int) -> NDArray[np.int64]:
    """Bias in units of v: mantissa << exponent, or >> when that is negative.

    Raises:
        NetworkLimitError: a mantissa beyond 13 bits and sign, or an exponent beyond -7..7.
    """
    mant, exp = np.asarray(mantissa, np.int64), np.asarray(exponent, np.int64)
    need(bool((np.abs(mant + 0.5) <= 1 << BIAS_BITS).all()), "bias mantissa", mantissa, "in -4096..4095")
    need(bool((np.abs(exp) <= WEIGHT_EXPONENT_LIMIT).all()), "bias exponent", exponent, "in -7..7")
    return np.where(exp >= 0, mant << np.maximum(exp, 0), mant >> np.maximum(-exp, 0))


def stored_weights(
    weights: NDArray[Any], bits: int = WEIGHT_BITS, sign: SignMode = "excitatory", of: str = ""
) -> NDArray[np.int32]:
    """Weights as synapse memory stores them in ``bits`` bits: the low ones of the 8 bits of magnitude become 0.

    Args:
        weights: Whole numbers, any shape: 0..255, -255..0 if inhibitory, -256..255 if mixed.
        bits: Bits of a weight, 1..8; a mixed sign takes one of them.
        sign: Sign mode of the whole array.
        of: Name of the weights' owner, for the message.
    Raises:
        NetworkLimitError: a weight outside the range. (Lava's Dense clips it without a word.)
    """
    values = np.asarray(weights)
    need(1 <= bits <= WEIGHT_BITS, "num_weight_bits", bits, f"in 1..{WEIGHT_BITS}")
    low, high = {"mixed": (-WEIGHT_LIMIT - 1, WEIGHT_LIMIT), "inhibitory": (-WEIGHT_LIMIT, 0)}.get(
        sign, (0, WEIGHT_LIMIT)
    )
    outside = values[~((values >= low) & (values <= high)) | (values != np.floor(values))]
    shown = outside.flat[0] if outside.size else ""
    name = f"{of}: {sign} weight" if of else f"{sign} weight"
    need(not outside.size, name, shown, f"a whole number in {low}..{high}")
    whole = values.astype(np.int32)
    drop = WEIGHT_BITS - bits + (1 if sign == "mixed" else 0)
    return -((-whole >> drop) << drop) if sign == "inhibitory" else (whole >> drop) << drop


@compiled(nogil=True)
def lif_step(
    u: NDArray[np.int32],
    v: NDArray[np.int32],
    threshold: NDArray[np.int32],
    held: NDArray[np.int32],
    drive: NDArray[np.int64],
    bias: NDArray[np.int64],
    constants: LifConstants,
    spikes: NDArray[np.bool_],
) -> int:
    """Advance a population by one step; every array is (neurons,).

    Args:
        u, v: Current and membrane, changed in place.
        threshold: Thresholds in units of v >> 6; raised in place by theta_plus for each spike, up to what 17 bits hold.
        held: Steps that a membrane still stays at 0, changed in place.
        drive: Input sums of this step.
        bias: Bias of each neuron in units of v.
        constants: `LifParameters.constants`.
        spikes: Filled with the neurons that spike, bool.
    Returns:
        The number of neurons that spike.
    """
    limit = np.int64(STATE_LIMIT)
    keep_u, keep_v, floor = constants.keep_u, constants.keep_v, constants.floor
    n = 0
    for i in range(v.size):
        current = np.int64(u[i])
        current = (current * keep_u >> DECAY_BITS) if current >= 0 else -(-current * keep_u >> DECAY_BITS)
        # Lava adds up in 32 bits, then wraps at 24.
        current = np.int64(np.int32(current + (np.int64(drive[i]) << INPUT_SHIFT)))
        wrapped = current - 2 * limit if current > limit else current
        if wrapped <= -limit:
            wrapped = current + 2 * limit
        u[i] = wrapped
        x = np.int64(v[i])
        x = (x * keep_v >> DECAY_BITS) if x >= 0 else -(-x * keep_v >> DECAY_BITS)
        x = np.int64(np.int32(x + np.int64(u[i]) + bias[i]))
        x = min(max(x, 1 - limit), limit - 1)
        if x < floor:
            x = np.int64(floor)
        if held[i] > 0:
            held[i] -= 1
            x = np.int64(0)
        spikes[i] = x > np.int64(threshold[i]) << INPUT_SHIFT
        if spikes[i]:
            x = np.int64(0)
            held[i] = constants.hold_steps
            threshold[i] = min(threshold[i] + constants.theta_plus, THRESHOLD_LIMIT - 1)
            n += 1
        v[i] = x
    return n


@compiled(nogil=True)
def dense_step(
    rows: NDArray[np.int32],
    spikes: NDArray[np.bool_],
    exponent: int,
    sums: NDArray[np.int64],
    scratch: NDArray[np.int32],
) -> None:
    """Add up the weights of the inputs that spike and shift each sum by ``exponent`` (negative: to the right).

    Args:
        rows: Stored weights (inputs, neurons).
        spikes: bool (inputs,).
        exponent: Lava's ``weight_exp``.
        sums: Filled, int64 (neurons,).
        scratch: int32 (neurons,).
    """
    scratch[:] = 0
    for j in range(spikes.size):
        if spikes[j]:
            for i in range(scratch.size):
                scratch[i] += rows[j, i]
    for i in range(scratch.size):
        x = np.int64(scratch[i])
        sums[i] = x << exponent if exponent > 0 else x >> -exponent
