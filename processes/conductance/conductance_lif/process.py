"""Conductance-based integrate-and-fire neurons, the two populations of the ``paper`` preset."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.checked import check_shape
from lava_vpr.processes.base.magma import AbstractProcess, InPort, OutPort, Var
from lava_vpr.processes.conductance.neurons import ConductanceNeuron

READY = 1 << 40
"""Steps since the last spike of a neuron that has never spiked."""


class ConductanceLIF(AbstractProcess):
    """A population of conductance-based neurons; floating point only::

        v += leak ((rest - v) + ge (e_exc - v) + gi (e_inh - v)), frozen for ``freeze`` steps after a spike
        spike if v > (theta - offset) + threshold, at least ``refractory`` steps after the last one
        then v = reset, theta += theta_plus

    What arrives in a Lava step was sent by spikes of the step before and is added to the conductances *first*: the
    same as adding it at the end of that step, after its thresholds, as Brian2's schedule does. So Lava's connections,
    which take one step, give Brian2's timing without any change. In the first step of a presentation all states but
    theta return to rest, and what arrives then is lost.

    Ports, all (neurons,): ``g_e_in`` excitatory conductance; ``g_i_in`` *minus the number* of inhibitory spikes, as
    `LateralInhibition` sends with an inhibition of 1, since each adds ``g_inh`` on its own; ``s_out`` spikes.
    Vars, all (neurons,): ``v``, ``ge``, ``gi``, ``theta``, ``since_spike`` (steps).
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        neuron: ConductanceNeuron,
        theta: float | NDArray[np.float64] = 0.0,
        interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make a population at rest.

        Args:
            shape: ``(neurons,)``.
            neuron: What they have in common.
            theta: Adaptive part of each threshold in mV, one value or (neurons,).
            interval: Steps of one presentation; 0: states are never reset.
        Raises:
            NetworkLimitError: a value outside its range.
        """
        super().__init__(shape=shape, neuron=neuron, theta=theta, interval=interval, **kwargs)
        check_shape("ConductanceLIF", shape)
        if interval < 0:
            raise NetworkLimitError(f"ConductanceLIF: interval is {interval}, but must be at least 0 steps")
        values = np.asarray(theta, np.float64)
        if values.shape not in ((), shape) or not np.isfinite(values).all():
            raise NetworkLimitError(
                f"ConductanceLIF: theta of shape {values.shape} must be finite, one value or of shape {shape}"
            )
        self.g_e_in = InPort(shape=shape)
        self.g_i_in = InPort(shape=shape)
        self.s_out = OutPort(shape=shape)
        self.v = Var(shape=shape, init=neuron.rest)
        self.ge = Var(shape=shape, init=0.0)
        self.gi = Var(shape=shape, init=0.0)
        self.theta = Var(shape=shape, init=np.broadcast_to(values, shape).copy())
        self.since_spike = Var(shape=shape, init=READY)
