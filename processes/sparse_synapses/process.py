"""Sparse synapses that do not learn."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode as LavaSignMode
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, issparse

from lava_vpr.engine.general.lif import SignMode, need, stored_weights
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import STATE_BITS, WEIGHT_BITS, WEIGHT_EXPONENT_LIMIT
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
    their weights cannot be set, and inputs may send whole numbers, by which weights are multiplied. Ports: ``s_in``
    (pre,); ``a_out`` sums (post,). Var: ``a_buff`` (post,), the sums of the next step.
    """

    def __init__(
        self,
        *,
        weights: csr_matrix,
        num_weight_bits: int = WEIGHT_BITS,
        weight_exp: int = 0,
        num_message_bits: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their weights and the exponent in which they are stored.

        Args:
            weights: scipy's sparse matrix (post, pre), all of one sign: whole numbers -255..255, or any floats for the
                floating-point model.
            num_weight_bits: Bits that are stored, 1..8; the low bits of 8 become 0 in the integer model.
            weight_exp: Shifts the sum, to the right if negative; -7..7.
            num_message_bits: Bits of the numbers that inputs send, 0..24; 0: spikes.
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
        need(whole(weight_exp) and abs(weight_exp) <= limit, "weight_exp", weight_exp, f"in {-limit}..{limit}")
        fits = whole(num_message_bits) and 0 <= num_message_bits <= STATE_BITS
        need(fits, "num_message_bits", num_message_bits, f"in 0..{STATE_BITS}")
        self.sign: SignMode = "inhibitory" if len(signs) and signs[0] < 0 else "excitatory"
        super().__init__(
            weights=values,
            num_weight_bits=num_weight_bits,
            weight_exp=int(weight_exp),
            num_message_bits=int(num_message_bits),
            sign=self.sign,
            **kwargs,
        )
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
        given = self.proc_params
        stored_weights(given["weights"].data, given["num_weight_bits"], self.sign, of="SparseSynapses")


class _LibrarySparse(LibrarySynapses):
    shared = ("a_buff",)

    def made(self, proc: SparseSynapses) -> Dense | Sparse:
        """The library's Process with the weights of ``proc``."""
        given = proc.proc_params
        return library_synapses(
            given["weights"],
            given["weight_exp"],
            LavaSignMode[proc.sign.upper()],
            floating=self.floating,
            sparse=True,
            bits=given["num_weight_bits"],
            messages=given["num_message_bits"],
        )


@model_of(SparseSynapses, "fixed")
class SubSparseSynapsesFixed(_LibrarySparse):
    """Lava's Sparse."""


@model_of(SparseSynapses, "float")
class SubSparseSynapsesFloat(_LibrarySparse):
    """The same with weights that Lava's floating-point models take."""


class _SparseModel(PyLoihiProcessModel):
    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, np.int32, precision=24)
    a_out: PyOutPort
    a_buff: NDArray[Any]

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.graded, self.exponent = proc_params["num_message_bits"] > 0, proc_params["weight_exp"]
        self.weights = self.held(proc_params["weights"]).tocsc()

    @abstractmethod
    def held(self, weights: csr_matrix) -> csr_matrix:
        """The weights as they are held."""

    @abstractmethod
    def shifted(self, sums: NDArray[Any]) -> NDArray[Any]:
        """Sums of weights by their exponent."""

    def run_spk(self) -> None:
        """Send the sums of the step before, then add up this one's."""
        self.a_out.send(self.a_buff)
        sent = self.s_in.recv()
        active = np.flatnonzero(sent)
        self.a_buff[:] = 0
        if len(active):
            weights = self.weights[:, active]
            self.a_buff[:] = self.shifted(weights @ sent[active] if self.graded else weights.sum(axis=1).A1)


@model_of(SparseSynapses, "float", held={"a_out": (np.int32, 24), "a_buff": (np.int32, 24)})
class PySparseSynapsesFloat(_SparseModel):
    """The synapses in float64, with the weights as they were given."""

    def held(self, weights: csr_matrix) -> csr_matrix:
        """As they were given."""
        return weights

    def shifted(self, sums: NDArray[Any]) -> NDArray[Any]:
        """Products with 2^weight_exp."""
        return sums * 2.0**self.exponent


@model_of(SparseSynapses, "fixed", held={"a_out": (np.int32, 24), "a_buff": (np.int32, 24)})
class PySparseSynapsesFixed(_SparseModel):
    """The synapses in Loihi's integers, bit-accurate with Lava's Sparse."""

    def held(self, weights: csr_matrix) -> csr_matrix:
        """As synapse memory holds them."""
        made = weights.copy()
        made.data = stored_weights(made.data, self.proc_params["num_weight_bits"], self.proc_params["sign"])
        return made

    def shifted(self, sums: NDArray[Any]) -> NDArray[Any]:
        """Shifted as Lava's Sparse does, to the right if negative."""
        return sums << self.exponent if self.exponent > 0 else sums >> -self.exponent
