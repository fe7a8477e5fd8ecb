"""One synapse from each neuron to its partner of the same number."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.loihi import WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT
from lava_vpr.processes.base.checked import CheckedProcess, RegisterVar, check_shape, vector, whole
from lava_vpr.processes.base.magma import InPort, OutPort, Var


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
