"""Synapses that do not learn: from every input to every neuron, to the partner, or to all others."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import identity

from lava_vpr.engine.general import lif
from lava_vpr.engine.general.lif import dense_step, need, stored_weights
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import WEIGHT_BITS, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT
from lava_vpr.processes.base.library_parts import LibrarySynapses, library_synapses
from lava_vpr.processes.base.magma import (
    CheckedProcess,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    RegisterVar,
    Var,
    check_shape,
    model_of,
    require,
    vector,
    whole,
)

_SUMS, _WEIGHT = {"a_out": (np.int32, 24), "a_buff": (np.int32, 24)}, (np.int32, 9)


def sign_of(weights: NDArray[Any], sign_mode: SignMode | str | None) -> lif.SignMode:
    """The sign mode with a name; None: that of the weights, as Lava determines it.

    Raises:
        NetworkLimitError: there is no such mode.
    """
    if sign_mode is None:
        if not weights.size or weights.min() >= 0:
            return "excitatory"
        return "inhibitory" if weights.max() <= 0 else "mixed"
    name = sign_mode.name.lower() if isinstance(sign_mode, SignMode) else sign_mode
    for known in ("null", "mixed", "excitatory", "inhibitory"):
        if name == known:
            return known
    raise NetworkLimitError(f"sign_mode is {sign_mode!r}, but must be null, mixed, excitatory, inhibitory or None")


class DenseSynapses(CheckedProcess):
    """Static synapses: ``a_out`` = (weights of the inputs that spiked one step ago, summed) 2^weight_exp.

    Ports: ``s_in`` spikes (pre,); ``a_out`` sums (post,). Vars: ``weights`` (post, pre), as the chip stores them under
    the integer model; ``a_buff`` (post,), the sums of the next step.
    """

    def __init__(
        self,
        *,
        weights: NDArray[Any],
        num_weight_bits: int = WEIGHT_BITS,
        weight_exp: int = 0,
        sign_mode: SignMode | str | None = None,
        sparse: bool = False,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their weights and the format in which they are stored.

        Args:
            weights: (post, pre): whole numbers 0..255, -255..0 if inhibitory, -256..255 if mixed; or any floats for the
                floating-point model.
            num_weight_bits: Bits that are stored, 1..8; the low bits of 8 become 0 in the integer model.
            weight_exp: Shifts the sum, to the right if negative; -7..7.
            sign_mode: Lava's SignMode or its name in lower case; None: by the weights' signs.
            sparse: Lava's library holds them as Sparse, not Dense: where most are 0 and none is set during a run.
        Raises:
            NetworkLimitError: no matrix, an unknown sign mode, a format out of its range, integers out of theirs;
                weights of a float type are checked when Lava picks the integer model for them.
        """
        weights = np.asarray(weights)
        if weights.ndim != 2 or not weights.size or weights.dtype.kind not in "iubf":
            raise NetworkLimitError(
                f"DenseSynapses: weights are {weights.dtype} {weights.shape}, but must be numbers (post, pre)"
            )
        require("DenseSynapses: a weight", weights, np.isfinite(weights), "finite")
        self.sign = sign_of(weights, sign_mode)
        limit = WEIGHT_EXPONENT_LIMIT
        need(whole(weight_exp) and abs(weight_exp) <= limit, "weight_exp", weight_exp, f"in {-limit}..{limit}")
        need(
            whole(num_weight_bits) and 1 <= num_weight_bits <= WEIGHT_BITS,
            "num_weight_bits",
            num_weight_bits,
            f"in 1..{WEIGHT_BITS}",
        )
        self.bits = int(num_weight_bits)
        super().__init__(
            num_weight_bits=self.bits, weight_exp=int(weight_exp), sign=self.sign, sparse=bool(sparse), **kwargs
        )
        self.s_in = InPort(shape=(weights.shape[1],))
        self.a_out = OutPort(shape=(weights.shape[0],))
        self.weights = RegisterVar(weights.shape, weights, self.check_fixed)
        self.a_buff = Var(shape=(weights.shape[0],), init=0)
        if whole(weights):
            self.check_fixed()

    def check_fixed(self, weights: NDArray[Any] | None = None) -> None:
        """Refuse weights that synapse memory cannot hold.

        Args:
            weights: Another value that they are about to be set to.
        Raises:
            NetworkLimitError: a weight out of the range of its sign mode, or not a whole number.
        """
        stored_weights(self.weights.init if weights is None else weights, self.bits, self.sign, of="DenseSynapses")

    def compile_kernels(self) -> None:
        """Compile the kernel before the models are forked."""
        dense_step(np.zeros((1, 1), np.int32), np.ones(1, bool), 0, np.zeros(1, np.int64), np.zeros(1, np.int32))


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


@model_of(DenseSynapses, "fixed")
class SubDenseSynapsesFixed(_LibraryDense):
    """Lava's Dense or Sparse."""


@model_of(DenseSynapses, "float")
class SubDenseSynapsesFloat(_LibraryDense):
    """The same with weights that Lava's floating-point models take."""


class _DenseModel(PyLoihiProcessModel):
    """The base of both models keeps rows of weights, made at first and whenever a Var was set."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort
    weights: NDArray[Any]
    a_buff: NDArray[Any]
    rows: NDArray[Any] | None = None

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.exponent: int = proc_params["weight_exp"]

    def on_var_update(self) -> None:
        """Drop the rows: a Var was set."""
        self.rows = None


@model_of(DenseSynapses, "float", held=_SUMS | {"weights": _WEIGHT})
class PyDenseSynapsesFloat(_DenseModel):
    """The synapses in float64, with the weights as they were given."""

    def run_spk(self) -> None:
        """Send the sums of the step before, then add up this one's."""
        if self.rows is None:
            self.rows = np.ascontiguousarray(self.weights.T) * 2.0**self.exponent
        self.a_out.send(self.a_buff)
        spikes = np.flatnonzero(self.s_in.recv())
        self.rows.take(spikes, axis=0).sum(axis=0, out=self.a_buff)


@model_of(DenseSynapses, "fixed", held=_SUMS | {"weights": _WEIGHT})
class PyDenseSynapsesFixed(_DenseModel):
    """`dense_step` on the weights as synapse memory holds them, bit-accurate with Lava's Dense."""

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


class OneToOne(CheckedProcess):
    """``a_out`` = weight 2^weight_exp times the spikes of one step ago.

    Ports: ``s_in``, ``a_out`` (neurons,). Vars: ``weight`` (1,), ``a_buff`` (neurons,), what the next step sends.
    """

    def __init__(self, *, shape: tuple[int, ...], weight: float, weight_exp: int = 0, **kwargs: Any) -> None:
        """Make the synapses, one for each neuron and all of one weight.

        Args:
            shape: (neurons,).
            weight: Weight of every synapse; a whole number in -255..255 in the integer model.
            weight_exp: Its exponent, 0..7.
        Raises:
            NetworkLimitError: a shape or an integer out of its range; a float is checked when Lava picks the integer
                model for it.
        """
        check_shape("OneToOne", shape)
        value = vector("weight", weight, 1)
        limit = WEIGHT_EXPONENT_LIMIT
        need(whole(weight_exp) and 0 <= weight_exp <= limit, "weight_exp", weight_exp, f"in 0..{limit}")
        super().__init__(shape=shape, weight_exp=int(weight_exp), **kwargs)
        self.s_in = InPort(shape=shape)
        self.a_out = OutPort(shape=shape)
        self.weight = RegisterVar((1,), value, self.check_fixed)
        self.a_buff = Var(shape=shape, init=0)
        if whole(value):
            self.check_fixed()

    def check_fixed(self, weight: NDArray[Any] | None = None) -> None:
        """Refuse a weight that does not fit 8 bits and sign.

        Raises:
            NetworkLimitError: naming it.
        """
        value = np.asarray(self.weight.init if weight is None else weight).flat[0]
        fits = abs(value) <= WEIGHT_LIMIT and value == np.floor(value)
        need(bool(fits), "weight", value, f"a whole number in {-WEIGHT_LIMIT}..{WEIGHT_LIMIT}")


class _LibraryDiagonal(LibrarySynapses):
    shared, constant = ("a_buff",), ("weight",)

    def made(self, proc: OneToOne) -> Dense | Sparse:
        """The library's Process with the weight of ``proc`` for each neuron."""
        weight = proc.weight.init[0]
        sign = SignMode.EXCITATORY if weight >= 0 else SignMode.INHIBITORY
        weights = identity(*proc.s_in.shape, format="csr") * weight
        return library_synapses(weights, proc.proc_params["weight_exp"], sign, floating=self.floating, sparse=True)


@model_of(OneToOne, "fixed")
class SubOneToOneFixed(_LibraryDiagonal):
    """Lava's Sparse with weights on its diagonal."""


@model_of(OneToOne, "float")
class SubOneToOneFloat(_LibraryDiagonal):
    """The same with weights that Lava's floating-point models take."""


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


@model_of(OneToOne, "float", held=_SUMS | {"weight": _WEIGHT})
class PyOneToOneFloat(_OneToOneModel):
    """The synapses from each neuron to its partner in float64, with any weight."""


@model_of(OneToOne, "fixed", held=_SUMS | {"weight": _WEIGHT})
class PyOneToOneFixed(_OneToOneModel):
    """The synapses from each neuron to its partner in Loihi's integers."""


class LateralInhibition(CheckedProcess):
    """``a_out[i]`` = -inhibition times the spikes of all neurons but i, one step ago; for preset ``paper``.

    Ports: ``s_in``, ``a_out`` (neurons,). Vars: ``inhibition`` (1,), ``a_buff`` (neurons,), what the next step sends.
    """

    def __init__(self, *, shape: tuple[int, ...], inhibition: float, **kwargs: Any) -> None:
        """Make the synapses from every neuron to all others, with one inhibition.

        Args:
            shape: (neurons,).
            inhibition: How much a spike inhibits every other neuron, at least 0.
        Raises:
            NetworkLimitError: a shape or an inhibition out of its range.
        """
        check_shape("LateralInhibition", shape)
        value = vector("inhibition", inhibition, 1)
        need(bool(value[0] >= 0), "inhibition", inhibition, "at least 0")
        super().__init__(shape=shape, **kwargs)
        self.s_in = InPort(shape=shape)
        self.a_out = OutPort(shape=shape)
        self.inhibition = Var(shape=(1,), init=value)
        self.a_buff = Var(shape=shape, init=0)


@model_of(LateralInhibition, "float")
class PyLateralInhibitionFloat(PyLoihiProcessModel):
    """The inhibition between neurons in float64, with any strength."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    inhibition: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    a_buff: NDArray[np.float64] = LavaPyType(np.ndarray, float)

    def run_spk(self) -> None:
        """Send what the spikes of the step before take, then take this step's."""
        self.a_out.send(self.a_buff)
        spikes: NDArray[Any] = np.flatnonzero(self.s_in.recv())
        self.a_buff[:] = -self.inhibition * len(spikes)
        self.a_buff[spikes] += self.inhibition
