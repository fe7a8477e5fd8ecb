"""Whether the chip could hold what Lava's compiler hands over: nothing is clipped, rounded or ignored in silence."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.process import AbstractProcess
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIF, LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode

from lava_vpr.deploy.hardware.loihi_2 import LIF as HELD
from lava_vpr.deploy.hardware.table import BELIEFS
from standin_chip import options

VARS = tuple(row.name for row in HELD)
"""The Vars of a neuron that the table of hardware knows."""


class StandinError(Exception):
    """What the chip cannot hold."""


def check(name: str, value: Any) -> None:
    """Refuse what are no whole numbers, or not what the row ``name`` of the table of hardware allows."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        raise StandinError(f"{name} is {array.dtype}, not a whole number")
    for number in (int(array.min(initial=0)), int(array.max(initial=0))) if array.size > 1 else (int(array.flat[0]),):
        said = BELIEFS[name].refusal(number)
        if said:
            raise StandinError(said)


def check_var(name: str, value: Any) -> None:
    """Refuse a value of a neuron's Var."""
    if name in VARS:
        check(name, value)


def check_process(process: AbstractProcess) -> None:
    """Refuse a Process that is not of Lava's library, or whose parameters the chip cannot hold."""
    kind = type(process)
    if kind in (LIF, LIFReset):
        for var in process.vars:
            if "arrays" in options().get("refuse", ()) and np.size(var.init) > 1:
                raise StandinError(f"{var.name} has a value a neuron, one for all is needed")
            check_var(var.name, var.init)
        if kind is LIFReset:
            check_reset(process.proc_params["reset_interval"], process.proc_params["reset_offset"])
    elif kind in (Dense, Sparse):
        _check_synapses(process)
    else:
        raise StandinError(f"{kind.__name__} is not a Process of Lava's library that the stand-in knows")


def check_reset(interval: int, offset: int) -> None:
    """Refuse an interval between resets that the chip does not have."""
    row = BELIEFS["steps between two resets of LIFReset"]
    if interval < 1 or interval & (interval - 1):
        raise StandinError(f"reset_interval {interval} is not {row.shown} ({row.source})")
    check("the longest interval between two resets", interval)
    check("step of the first reset (reset_offset)", offset)


def _check_synapses(process: Any) -> None:
    """Refuse weights that the chip would store otherwise than they are given."""
    params, weights = process.proc_params, process.weights.init
    values = weights if isinstance(weights, np.ndarray) else weights.toarray()
    bits, exponent, sign = params.get("num_weight_bits", 8), params.get("weight_exp", 0), params.get("sign_mode")
    check("num_weight_bits", bits)
    check("weight_exp", exponent)
    check("num_message_bits", process.num_message_bits.init)
    if sign not in (SignMode.EXCITATORY, SignMode.INHIBITORY, SignMode.MIXED):
        raise StandinError(f"sign mode {sign} leaves it to Lava to choose")
    check(f"weights of sign mode {sign.name}", values)
    spare = 8 - bits + (sign is SignMode.MIXED)  # one bit is the sign
    if np.any(np.abs(values) & ((1 << spare) - 1)):
        raise StandinError(f"weights have more than {bits} bits, the lowest would be lost")
    wanted = options().get("weights")
    if wanted and isinstance(process, Dense) and min(values.shape) > 1:
        if not np.array_equal(values, np.load(wanted)):
            raise StandinError("the weights of Dense are not those of the bundle")
