"""Each spike inhibits all other neurons alike: a dense matrix without its diagonal, and without storing it."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.variable import Var
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.loihi import INPUT_LIMIT, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT
from lava_vpr.processes.base.checked import CheckedProcess, RegisterVar, check_shape, vector, whole


class LateralInhibition(CheckedProcess):
    """``a_out[i]`` = -inhibition times the spikes of all neurons but i, one step ago.

    Ports: ``s_in``, ``a_out`` (neurons,). Vars: ``inhibition`` (1,), ``a_buff`` (neurons,), what the next step sends.
    """

    def __init__(self, *, shape: tuple[int, ...], inhibition: float, **kwargs: Any) -> None:
        """Make the synapses from every neuron to all others, with one inhibition.

        Args:
            shape: (neurons,).
            inhibition: What a spike takes from every other neuron, at least 0. The integer model takes m 2^e with m in
                0..255 and e in 0..7, and as much as (neurons - 1) inhibition fits the current.
        Raises:
            NetworkLimitError: a shape or an integer out of its range; a float is checked when Lava picks the integer
                model for it.
        """
        self.neurons = check_shape("LateralInhibition", shape)
        value = vector("inhibition", inhibition, 1)
        need(bool(value[0] >= 0), "inhibition", inhibition, "at least 0")
        super().__init__(shape=shape, **kwargs)
        self.s_in = InPort(shape=shape)
        self.a_out = OutPort(shape=shape)
        self.inhibition = RegisterVar((1,), value, self.check_fixed)
        self.a_buff = Var(shape=shape, init=0)
        if whole(value):
            self.check_fixed()

    def check_fixed(self, inhibition: NDArray[Any] | None = None) -> None:
        """Refuse an inhibition that no mantissa and exponent make, or that could overflow the current.

        Raises:
            NetworkLimitError: naming it.
        """
        value = np.asarray(self.inhibition.init if inhibition is None else inhibition).flat[0]
        need(bool(value >= 0 and value == np.floor(value)), "inhibition", value, "a whole number, at least 0")
        mantissa, exponent = int(value), 0
        while mantissa > WEIGHT_LIMIT and mantissa % 2 == 0:
            mantissa, exponent = mantissa // 2, exponent + 1
        need(
            mantissa <= WEIGHT_LIMIT and exponent <= WEIGHT_EXPONENT_LIMIT,
            "inhibition",
            value,
            f"m 2^e with m in 0..{WEIGHT_LIMIT} and e in 0..{WEIGHT_EXPONENT_LIMIT}",
        )
        total = (self.neurons - 1) * int(value)
        need(total < INPUT_LIMIT, f"inhibition by {self.neurons - 1} neurons", total, f"below {INPUT_LIMIT}")
