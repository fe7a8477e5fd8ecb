"""All-to-all synapses with delays whose weights follow the spikes of both sides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.conductance.kernels import Constants, normalise
from lava_vpr.engine.conductance.model import RULES, trace_table
from lava_vpr.engine.conductance.plastic import learn
from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.checked import CheckedProcess
from lava_vpr.processes.base.magma import InPort, OutPort, Var
from lava_vpr.processes.conductance.delayed_dense.process import check_synapses
from lava_vpr.settings.conductance import ConductanceLearning


class ConductancePlastic(CheckedProcess):
    """`DelayedDense` that learns: at the step at which a spike arrives, the neuron first takes its weight, then::

        triplet: w += eta_pre post1, when an input arrives;  w += eta_post x_pre post2, when the neuron spikes
        paper:   w += eta_post (x_pre - x_target) (w_max - w)^mu, when the neuron spikes

    with weights kept in [0, w_max], and post1, post2 those of the neuron's *earlier* spikes. Before each presentation
    a neuron's weights are scaled to the sum ``weight_sum``; traces and spikes on their way are lost.

    Ports: ``s_in`` input spikes (inputs,), ``post_in`` the neurons' own spikes (neurons,), ``a_out`` summed weights
    (neurons,). Vars: ``weights`` (neurons, inputs).
    """

    def __init__(
        self,
        *,
        weights: NDArray[np.float64],
        delays: NDArray[np.integer],
        learning: ConductanceLearning,
        constants: Constants,
        dt_ms: float,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their start weights, their delays and the rule that they learn by.

        Args:
            weights: At the start, float64 (neurons, inputs), as in Lava's Dense.
            delays: Whole steps in 0..65534, of the same shape.
            learning: The rule and its ``weight_sum``.
            constants: Those of `engine.conductance.model.constants` with ``learn``; a presentation has ``total`` steps.
            dt_ms: Length of a step.
        Raises:
            NetworkLimitError: arrays of different shapes, or a value outside its range.
        """
        super().__init__(
            weights=weights,
            delays=delays,
            rule=RULES[learning.rule],
            weight_sum=learning.weight_sum,
            constants=constants,
            traces=trace_table(constants.total, dt_ms),
            **kwargs,
        )
        if constants.total < 1:
            raise NetworkLimitError(f"ConductancePlastic: a presentation of {constants.total} steps; give at least 1")
        check_synapses("ConductancePlastic", weights, delays, constants.total)
        self.s_in = InPort(shape=(weights.shape[1],))
        self.post_in = InPort(shape=(weights.shape[0],))
        self.a_out = OutPort(shape=(weights.shape[0],))
        self.weights = Var(shape=weights.shape, init=weights)

    def compile_kernels(self) -> None:
        """Compile what the model calls, before Lava forks its processes."""
        weights, arrived = np.zeros((1, 1)), np.zeros(1, np.int64)
        normalise(weights, 1.0)
        c, traces = self.proc_params["constants"], self.proc_params["traces"]
        learn(weights[0], arrived, 0, traces[0], 0.0, 0, c)
