"""Sparse synapses that do not learn."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, issparse

from lava_vpr.engine.general.lif import need, stored_weights
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import WEIGHT_EXPONENT_LIMIT
from lava_vpr.processes.base.library_parts import LibrarySynapses, library_synapses
from lava_vpr.processes.base.magma import (
    CheckedProcess,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    Var,
    model_of,
    require,
    whole,
)


class SparseSynapses(CheckedProcess):
    """Static synapses: ``a_out`` = (weights of the inputs that spiked one step ago, summed) 2^weight_exp.

    As `lava_vpr.processes.synapses.process.DenseSynapses`, but their memory and time grow with the number of synapses,
    and their weights cannot be set. Ports: ``s_in`` spikes (pre,); ``a_out`` sums (post,). Var: ``a_buff`` (post,), the
    sums of the next step.
    """

    def __init__(self, *, weights: csr_matrix, weight_exp: int = 0, **kwargs: Any) -> None:
        """Make the synapses with their weights and the exponent in which they are stored.

        Args:
            weights: scipy's sparse matrix (post, pre), all of one sign: whole numbers -255..255, or any floats for the
                floating-point model.
            weight_exp: Their exponent, 0..7.
        Raises:
            NetworkLimitError: no sparse matrix, weights of both signs, or integers out of their range; weights of a
                float type are checked when Lava picks the integer model for them.
        """
        if not issparse(weights) or not all(weights.shape) or weights.dtype.kind not in "iubf":
            raise NetworkLimitError(
                "SparseSynapses: weights must be a sparse matrix of numbers (post, pre); make it with scipy.sparse, or "
                "take DenseSynapses"
            )
        values = csr_matrix(weights)
        require("SparseSynapses: a weight", values.data, np.isfinite(values.data), "finite")
        signs = np.unique(np.sign(values.data[values.data != 0]))
        need(len(signs) < 2, "SparseSynapses: signs", "of both kinds", "one: make two Processes")
        limit = WEIGHT_EXPONENT_LIMIT
        need(whole(weight_exp) and 0 <= weight_exp <= limit, "weight_exp", weight_exp, f"in 0..{limit}")
        super().__init__(weights=values, weight_exp=int(weight_exp), **kwargs)
        self.inhibitory = bool(len(signs) and signs[0] < 0)
        self.s_in = InPort(shape=(values.shape[1],))
        self.a_out = OutPort(shape=(values.shape[0],))
        self.a_buff = Var(shape=(values.shape[0],), init=0)
        if whole(values.data):
            self.check_fixed()

    def check_fixed(self) -> None:
        """Refuse weights that synapse memory cannot hold.

        Raises:
            NetworkLimitError: a weight out of its range, or not a whole number.
        """
        stored_weights(
            self.proc_params["weights"].data,
            sign="inhibitory" if self.inhibitory else "excitatory",
            of="SparseSynapses",
        )


class _LibrarySparse(LibrarySynapses):
    shared = ("a_buff",)

    def made(self, proc: SparseSynapses) -> Dense | Sparse:
        """The library's Process with the weights of ``proc``."""
        given, sign = proc.proc_params, SignMode.INHIBITORY if proc.inhibitory else SignMode.EXCITATORY
        return library_synapses(given["weights"], given["weight_exp"], sign, floating=self.floating, sparse=True)


@model_of(SparseSynapses, "fixed")
class SubSparseSynapsesFixed(_LibrarySparse):
    """Lava's Sparse."""


@model_of(SparseSynapses, "float")
class SubSparseSynapsesFloat(_LibrarySparse):
    """The same with weights that Lava's floating-point models take."""


class _SparseModel(PyLoihiProcessModel):
    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort
    a_buff: NDArray[Any]

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.weights = (proc_params["weights"] * (1 << proc_params["weight_exp"])).tocsc()

    def run_spk(self) -> None:
        """Send the sums of the step before, then add up this one's."""
        self.a_out.send(self.a_buff)
        spikes = np.flatnonzero(self.s_in.recv())
        self.a_buff[:] = 0
        if len(spikes):
            self.a_buff[:] = self.weights[:, spikes].sum(axis=1).A1


@model_of(SparseSynapses, "float", held={"a_out": (np.int32, 24), "a_buff": (np.int32, 24)})
class PySparseSynapsesFloat(_SparseModel):
    """The synapses in float64, with the weights as they were given."""


@model_of(SparseSynapses, "fixed", held={"a_out": (np.int32, 24), "a_buff": (np.int32, 24)})
class PySparseSynapsesFixed(_SparseModel):
    """The synapses in Loihi's integers, bit-accurate with Lava's Sparse."""
