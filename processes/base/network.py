"""What the place networks share as Processes: ports, and the Vars of their parts."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from lava_vpr.processes.base.magma import CheckedProcess, InPort, OutPort, Var


class NetworkProcess(CheckedProcess):
    """A place network of parts, whose models wire them (`wire`).

    Ports: ``s_in`` (inputs,), ``s_out`` (neurons,), ``s_out_inh`` (inhibitory,). Vars of its parts: ``weights``
    (neurons, inputs), ``u``, ``v``, ``vth`` (neurons,), ``v_inh`` (inhibitory,), ``lateral_weights`` (neurons,
    inhibitory). ``interval``: steps of a presentation, the silent ones included.
    """

    def __init__(self, weights: NDArray[Any], vth: Any, laterals: NDArray[Any], interval: int, **kwargs: Any) -> None:
        """Make ports and Vars, with what their parts hold at first."""
        super().__init__(**kwargs)
        (neurons, inputs), inhibitory = weights.shape, laterals.shape[1]
        self.interval = interval
        self.s_in, self.s_out, self.s_out_inh = InPort((inputs,)), OutPort((neurons,)), OutPort((inhibitory,))
        self.weights = Var(shape=weights.shape, init=weights)
        self.vth = Var(shape=(neurons,), init=vth)
        self.lateral_weights = Var(shape=laterals.shape, init=laterals)
        self.u, self.v, self.v_inh = (Var(shape=(size,), init=0) for size in (neurons, neurons, inhibitory))
