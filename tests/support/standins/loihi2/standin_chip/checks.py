"""Whether the chip could hold what Lava's compiler hands over: nothing is clipped, rounded or ignored in silence."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.process import AbstractProcess
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIF, LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode

from standin_chip.options import options

RANGES = {
    "u": (-(1 << 23) + 1, (1 << 23) - 1),
    "v": (-(1 << 23) + 1, (1 << 23) - 1),
    "du": (0, 4095),
    "dv": (0, 4095),
    "vth": (0, (1 << 17) - 1),
    "bias_mant": (-4096, 4095),
    "bias_exp": (0, 7),
}
"""Of the Vars of a neuron, both ends included."""


class StandinError(Exception):
    """What the chip cannot hold."""


def check_range(what: str, value: Any, low: int, high: int) -> None:
    """Refuse what are no whole numbers in ``low`` .. ``high``."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        raise StandinError(f"{what} is {array.dtype}, not a whole number")
    outside = array[(array < low) | (array > high)]
    if outside.size:
        raise StandinError(f"{what} {outside.flat[0]} is outside {low}..{high}")


def check_var(process: str, name: str, value: Any) -> None:
    """Refuse a value of a neuron's Var."""
    if name in RANGES:
        check_range(f"{process}.{name}", value, *RANGES[name])


def check_process(process: AbstractProcess) -> None:
    """Refuse a Process that is not of Lava's library, or whose parameters the chip cannot hold."""
    kind = type(process)
    if kind in (LIF, LIFReset):
        for var in process.vars:
            check_var(kind.__name__, var.name, var.init)
        if kind is LIFReset:
            interval = process.proc_params["reset_interval"]
            check_range("reset_interval", interval, 1, 1 << 16)
            check_range("reset_offset", process.proc_params["reset_offset"], 0, interval - 1)
    elif kind in (Dense, Sparse):
        _check_synapses(process)
    else:
        raise StandinError(f"{kind.__name__} is not a Process of Lava's library that the stand-in knows")


def _check_synapses(process: Any) -> None:
    """Refuse weights that the chip would store otherwise than they are given."""
    params, weights = process.proc_params, process.weights.init
    values = weights if isinstance(weights, np.ndarray) else weights.toarray()
    bits, exponent, sign = params.get("num_weight_bits", 8), params.get("weight_exp", 0), params.get("sign_mode")
    check_range("num_weight_bits", bits, 1, 8)
    check_range("weight_exp", exponent, -7, 7)
    check_range("num_message_bits", process.num_message_bits.init, 0, 0)
    ranges = {SignMode.EXCITATORY: (0, 255), SignMode.INHIBITORY: (-255, 0), SignMode.MIXED: (-256, 255)}
    if sign not in ranges:
        raise StandinError(f"sign mode {sign} leaves it to Lava to choose")
    check_range("weight", values, *ranges[sign])
    spare = 8 - bits + (sign is SignMode.MIXED)  # one bit is the sign
    if np.any(np.abs(values) & ((1 << spare) - 1)):
        raise StandinError(f"weights have more than {bits} bits, the lowest would be lost")
    wanted = options().get("weights")
    if wanted and isinstance(process, Dense) and min(values.shape) > 1:
        if not np.array_equal(values, np.load(wanted)):
            raise StandinError("the weights of Dense are not those of the bundle")
