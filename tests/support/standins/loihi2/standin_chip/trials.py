"""What the stand-in says of Processes that the chip could not hold; to be called by the runner."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.io.source import RingBuffer
from lava.proc.lif.process import LIF, LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from standin_chip.checks import StandinError, check_process, check_var

BOTH = {"sign_mode": SignMode.EXCITATORY}
ONE = np.array([[4]])


def refusals(arrays: dict[str, NDArray[Any]], options: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """By name, what is said of each; ``nothing`` where it is accepted."""
    made = {
        "a good neuron": LIF(shape=(2,), du=4095, dv=0, vth=8000, v=np.array([1, -2])),
        "du": LIF(shape=(1,), du=4096, vth=3),
        "vth": LIFReset(shape=(1,), vth=1 << 17, reset_interval=32, reset_offset=1),
        "fraction": LIF(shape=(1,), dv=0.5),
        "bias": LIF(shape=(1,), bias_mant=np.array([4096])),
        "offset": LIFReset(shape=(1,), vth=1, reset_interval=4, reset_offset=3),
        "353 steps": LIFReset(shape=(1,), vth=1, reset_interval=353, reset_offset=1),
        "33 steps": LIFReset(shape=(1,), vth=1, reset_interval=33, reset_offset=1),
        "131072 steps": LIFReset(shape=(1,), vth=1, reset_interval=1 << 17, reset_offset=1),
        "256 steps": LIFReset(shape=(1,), vth=1, reset_interval=256, reset_offset=1),
        "good synapses": Sparse(weights=ONE, **BOTH),
        "sign": Dense(weights=ONE),
        "weight": Dense(weights=ONE * 64, **BOTH),
        "bits": Dense(weights=ONE, num_weight_bits=5, **BOTH),
        "exponent": Dense(weights=ONE, weight_exp=-8, **BOTH),
        "foreign": RingBuffer(data=ONE),
    }
    said = {name: _said(check_process, process) for name, process in made.items()}
    said["written"] = _said(check_var, "v", np.array([1 << 23]))
    return {name: np.array(text) for name, text in said.items()}


def _said(check: Any, *args: Any) -> str:
    try:
        check(*args)
    except StandinError as error:
        return str(error)
    return "nothing"
