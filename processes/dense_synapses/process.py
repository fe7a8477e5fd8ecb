"""Synapses from every input to every neuron, as Lava's Dense; but weights that do not fit are refused, not clipped."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.general import lif
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import WEIGHT_BITS, WEIGHT_EXPONENT_LIMIT
from lava_vpr.processes.base.checked import CheckedProcess, RegisterVar, require, whole
from lava_vpr.processes.base.magma import InPort, OutPort, Var


def sign_of(weights: NDArray[Any], sign_mode: SignMode | str | None) -> lif.SignMode:
    """Sign mode by name; from the weights themselves if it is None, as Lava determines it.

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
        lif.need(whole(weight_exp) and abs(weight_exp) <= limit, "weight_exp", weight_exp, f"in {-limit}..{limit}")
        lif.need(
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
        lif.stored_weights(self.weights.init if weights is None else weights, self.bits, self.sign, of="DenseSynapses")

    def compile_kernels(self) -> None:
        """Compile the kernel before the models are forked."""
        lif.dense_step(np.zeros((1, 1), np.int32), np.ones(1, bool), 0, np.zeros(1, np.int64), np.zeros(1, np.int32))
