"""Models of `BiasInputs`: nothing they compute is ever rounded, so all send the same spikes."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.lif.process import LIF
from numpy.typing import NDArray

from lava_vpr.engine.inference.bias_input import LEVEL, THRESHOLD, biases, start_membranes
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import INPUT_SHIFT, NO_MEMORY_DECAY
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.encoders import EncoderModel
from lava_vpr.processes.base.library_parts import library_model, stand_for
from lava_vpr.processes.base.magma import AbstractSubProcessModel, LavaPyType
from lava_vpr.processes.bias_inputs.process import BiasInputs


class _LibraryInputs(AbstractSubProcessModel):
    floating = False

    def __init__(self, proc: BiasInputs) -> None:
        if proc.proc_params["shared"] is not None:
            raise NetworkLimitError("BiasInputs: emitted is not counted by Lava's library; count the spikes of s_out")
        proc.written = proc.values(0, floating=self.floating)
        no_memory: float = 1.0 if self.floating else NO_MEMORY_DECAY
        self.neurons = LIF(shape=proc.s_out.shape, du=no_memory, dv=0, vth=THRESHOLD, **proc.written)
        self.neurons.s_out.connect(proc.s_out)
        stand_for(proc, self.neurons, "v", "bias_mant", "bias_exp", constant=("emitted",))


@library_model(BiasInputs, "fixed")
class SubBiasInputsFixed(_LibraryInputs):
    """Lava's LIF, with the first presentation's bias and start membrane; `BiasInputs.write` brings the others."""


@library_model(BiasInputs, "float")
class SubBiasInputsFloat(_LibraryInputs):
    """The same with the numbers that Lava's floating-point models take."""

    floating = True


class _InputsModel(EncoderModel):
    """The model integrates in the unit of its arithmetic: ``threshold`` is `LEVEL` in units of 1 / ``scale``."""

    v: NDArray[Any]
    bias_mant: NDArray[Any]
    bias_exp: NDArray[Any]
    threshold: float
    scale: float

    def begin(self, image: int) -> None:
        """Write the biases and start membranes of a presentation."""
        self.bias_mant[:], self.bias_exp[:] = biases(self.rates[image])
        self.v[:] = start_membranes(self.keys[image], len(self.v)) * self.scale

    def members(self, step: int) -> NDArray[np.integer]:
        """The compartments whose membrane passes the threshold; it is 0 then."""
        self.v += self.bias_mant * 2**self.bias_exp * self.scale
        spikes = np.flatnonzero(self.v > self.threshold)
        self.v[spikes] = 0
        return spikes


@cpu_model(BiasInputs, "float")
class PyBiasInputsFloat(_InputsModel):
    """The compartments in float64, whose v is in the unit of the threshold."""

    v: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    bias_mant: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    bias_exp: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    threshold, scale = float(THRESHOLD), 2.0**-INPUT_SHIFT


@cpu_model(BiasInputs, "fixed")
class PyBiasInputsFixed(_InputsModel):
    """The compartments in Loihi's integers."""

    v: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=24)
    bias_mant: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=13)
    bias_exp: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=3)
    threshold, scale = LEVEL, 1
