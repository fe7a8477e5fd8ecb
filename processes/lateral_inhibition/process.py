"""Each spike inhibits all other neurons alike: a dense matrix without its diagonal, and without storing it."""

from __future__ import annotations

from typing import Any

from lava_vpr.engine.general.lif import need
from lava_vpr.processes.base.checked import CheckedProcess, check_shape, vector
from lava_vpr.processes.base.magma import InPort, OutPort, Var


class LateralInhibition(CheckedProcess):
    """``a_out[i]`` = -inhibition times the spikes of all neurons but i, one step ago; for preset ``paper``.

    Ports: ``s_in``, ``a_out`` (neurons,). Vars: ``inhibition`` (1,), ``a_buff`` (neurons,), what the next step sends.
    """

    def __init__(self, *, shape: tuple[int, ...], inhibition: float, **kwargs: Any) -> None:
        """Make the synapses from every neuron to all others, with one inhibition.

        Args:
            shape: (neurons,).
            inhibition: What a spike takes from every other neuron, at least 0.
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
