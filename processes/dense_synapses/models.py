"""Models of `DenseSynapses`: driven by events, weights input by input."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import dense_step, stored_weights
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.library_parts import LibrarySynapses, library_model, library_synapses
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.dense_synapses.process import DenseSynapses


class _LibraryDense(LibrarySynapses):
    def made(self, proc: DenseSynapses) -> Dense | Sparse:
        """The library's Process with the weights and the format of ``proc``."""
        given = proc.proc_params
        return library_synapses(
            proc.weights.init,
            given["weight_exp"],
            SignMode[given["sign"].upper()],
            floating=self.floating,
            sparse=given["sparse"],
            bits=given["num_weight_bits"],
        )


@library_model(DenseSynapses, "fixed")
class SubDenseSynapsesFixed(_LibraryDense):
    """Lava's Dense or Sparse."""


@library_model(DenseSynapses, "float")
class SubDenseSynapsesFloat(_LibraryDense):
    """The same with weights that Lava's floating-point models take."""

    floating = True


class _DenseModel(PyLoihiProcessModel):
    """The base of both models keeps rows of weights, made at first and whenever a Var was set."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    weights: NDArray[Any]
    a_buff: NDArray[Any]
    rows: NDArray[Any] | None = None

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.exponent: int = proc_params["weight_exp"]

    def on_var_update(self) -> None:
        """Drop the rows: a Var was set."""
        self.rows = None


@cpu_model(DenseSynapses, "float")
class PyDenseSynapsesFloat(_DenseModel):
    """The synapses in float64, with the weights as they were given."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    weights: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    a_buff: NDArray[np.float64] = LavaPyType(np.ndarray, float)

    def run_spk(self) -> None:
        """Send the sums of the step before, then add up this one's."""
        if self.rows is None:
            self.rows = np.ascontiguousarray(self.weights.T) * 2.0**self.exponent
        self.a_out.send(self.a_buff)
        spikes = np.flatnonzero(self.s_in.recv())
        self.rows.take(spikes, axis=0).sum(axis=0, out=self.a_buff)


@cpu_model(DenseSynapses, "fixed")
class PyDenseSynapsesFixed(_DenseModel):
    """`dense_step` on the weights as synapse memory holds them, bit-accurate with Lava's Dense."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, np.int32, precision=24)
    weights: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=9)
    a_buff: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32, precision=24)

    def _prepare(self) -> None:
        params = self.proc_params
        self.weights[:] = stored_weights(self.weights, params["num_weight_bits"], params["sign"])
        self.rows = np.ascontiguousarray(self.weights.T)
        self.sums, self.scratch = np.zeros(len(self.weights), np.int64), np.zeros(len(self.weights), np.int32)

    def run_spk(self) -> None:
        """Send the sums of the step before, then add up this one's."""
        if self.rows is None:
            self._prepare()
        self.a_out.send(self.a_buff)
        spikes = self.s_in.recv().astype(bool, copy=False)
        dense_step(self.rows, spikes, self.exponent, self.sums, self.scratch)
        self.a_buff[:] = self.sums
