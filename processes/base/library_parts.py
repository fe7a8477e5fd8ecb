"""Parts of a place network from Lava's own library that its library networks have in common."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from lava_vpr.engine.inference.neuron_bias import bias_registers
from lava_vpr.loihi import INPUT_SHIFT, NO_MEMORY_DECAY


def reset_each(interval: int) -> dict[str, int]:
    """The arguments by which a LIFReset falls back to 0 in the steps 1, ``interval`` + 1, and so on."""
    return {"reset_interval": interval, "reset_offset": 1}


def bias_vars(bias: NDArray[np.int32], floating: bool = False) -> dict[str, NDArray[Any]]:
    """The Vars of a LIFReset that hold ``bias`` (neurons,) in units of v: ``bias_mant`` and ``bias_exp``.

    Args:
        bias: As `check_bias` allows.
        floating: For a run with the tag ``floating_pt``, whose models ignore the exponent.
    """
    if floating:
        return {"bias_mant": bias * 2.0**-INPUT_SHIFT}
    mantissas, exponent = bias_registers(bias)
    return {"bias_mant": mantissas, "bias_exp": exponent}


def without_memory(neurons: int, interval: int, floating: bool = False) -> LIFReset:
    """Inhibitory neurons or relays, which any positive input makes spike, reset each ``interval`` steps.

    Args:
        neurons: Their number.
        interval: Steps of a presentation.
        floating: For a run with the tag ``floating_pt``, whose models take decays as fractions.
    """
    no_memory = 1.0 if floating else NO_MEMORY_DECAY
    return LIFReset(shape=(neurons,), du=no_memory, dv=no_memory, vth=0, **reset_each(interval))


def fixed_synapses(
    weights: NDArray[Any], weight_exp: int = 0, floating: bool = False, sign_mode: SignMode = SignMode.EXCITATORY
) -> Dense | Sparse:
    """Synapses that do not learn: Dense where every source reaches every target, else Sparse.

    Args:
        weights: Mantissas (post, pre), whole numbers.
        weight_exp: Their exponent.
        floating: For a run with the tag ``floating_pt``, whose models ignore exponents.
        sign_mode: Lava's.
    """
    if floating:
        weights = weights * 2.0**weight_exp
    if len(weights) == 1 or weights.shape[1] == 1:
        return Dense(weights=weights, weight_exp=weight_exp, sign_mode=sign_mode)
    return Sparse(weights=csr_matrix(weights), weight_exp=weight_exp, sign_mode=sign_mode)
