"""Models of `OneToOne`."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import identity

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.library_parts import LibrarySynapses, library_model, library_synapses
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.one_to_one.process import OneToOne


class _LibraryDiagonal(LibrarySynapses):
    constant = ("weight",)

    def made(self, proc: OneToOne) -> Dense | Sparse:
        """The library's Process with the weight of ``proc`` for each neuron."""
        weight = proc.weight.init[0]
        sign = SignMode.EXCITATORY if weight >= 0 else SignMode.INHIBITORY
        weights = identity(*proc.s_in.shape, format="csr") * weight
        return library_synapses(weights, proc.proc_params["weight_exp"], sign, floating=self.floating, sparse=True)


@library_model(OneToOne, "fixed")
class SubOneToOneFixed(_LibraryDiagonal):
    """Lava's Sparse with weights on its diagonal."""


@library_model(OneToOne, "float")
class SubOneToOneFloat(_LibraryDiagonal):
    """The same with weights that Lava's floating-point models take."""

    floating = True


class _OneToOneModel(PyLoihiProcessModel):
    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort
    weight: NDArray[Any]
    a_buff: NDArray[Any]

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.unit = 1 << proc_params["weight_exp"]

    def run_spk(self) -> None:
        """Send what the spikes of the step before bring, then take this step's."""
        self.a_out.send(self.a_buff)
        np.multiply(self.s_in.recv().astype(bool, copy=False), self.weight * self.unit, out=self.a_buff)


@cpu_model(OneToOne, "float")
class PyOneToOneFloat(_OneToOneModel):
    """The synapses from each neuron to its partner in float64, with any weight."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    weight: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    a_buff: NDArray[np.float64] = LavaPyType(np.ndarray, float)


@cpu_model(OneToOne, "fixed")
class PyOneToOneFixed(_OneToOneModel):
    """The synapses from each neuron to its partner in Loihi's integers."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, np.int32, precision=24)
    weight: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=9)
    a_buff: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=24)
