"""What `ConductancePlaceNetwork` is composed of."""

from __future__ import annotations

import numpy as np

from lava_vpr.engine.conductance.kernels import EXC_TO_INH, Constants
from lava_vpr.engine.conductance.model import constants
from lava_vpr.processes.base.magma import AbstractSubProcessModel, implements, tag
from lava_vpr.processes.conductance.conductance_lif.process import ConductanceLIF
from lava_vpr.processes.conductance.conductance_place_network.process import (
    ConductancePlaceNetwork,
    excitatory_neuron,
    inhibitory_neuron,
)
from lava_vpr.processes.conductance.conductance_plastic.process import ConductancePlastic
from lava_vpr.processes.conductance.delayed_dense.process import DelayedDense
from lava_vpr.processes.lateral_inhibition.process import LateralInhibition
from lava_vpr.processes.one_to_one.process import OneToOne


@implements(proc=ConductancePlaceNetwork)
@tag("floating_pt")
class SubConductancePlaceNetwork(AbstractSubProcessModel):
    """Two populations, the input's synapses, and the loop through the inhibitory population."""

    def __init__(self, proc: ConductancePlaceNetwork) -> None:
        state, learn = proc.proc_params["state"], proc.proc_params["learn"]
        c = constants(proc.proc_params["config"], learn=learn)
        neurons, total = len(state.theta_mv), c.total
        self.excite = self._synapses(proc, c)
        self.exc = ConductanceLIF(shape=(neurons,), neuron=excitatory_neuron(c), theta=state.theta_mv, interval=total)
        self.relay = OneToOne(shape=(neurons,), weight=EXC_TO_INH)
        self.inh = ConductanceLIF(shape=(neurons,), neuron=inhibitory_neuron(c), interval=total)
        self.others = LateralInhibition(shape=(neurons,), inhibition=1.0)  # minus the number that spiked
        proc.in_ports.s_in.connect(self.excite.in_ports.s_in)
        self.excite.out_ports.a_out.connect(self.exc.in_ports.g_e_in)
        self.exc.out_ports.s_out.connect(self.relay.in_ports.s_in)
        self.relay.out_ports.a_out.connect(self.inh.in_ports.g_e_in)
        self.inh.out_ports.s_out.connect(self.others.in_ports.s_in)
        self.others.out_ports.a_out.connect(self.exc.in_ports.g_i_in)
        self.exc.out_ports.s_out.connect(proc.out_ports.s_out)
        self.inh.out_ports.s_out.connect(proc.out_ports.s_out_inh)
        if learn:
            self.exc.out_ports.s_out.connect(self.excite.in_ports.post_in)
        for name in ("v", "ge", "gi", "theta"):
            getattr(proc.vars, name).alias(getattr(self.exc.vars, name))
        proc.vars.weights.alias(self.excite.vars.weights)
        proc.vars.v_inh.alias(self.inh.vars.v)

    @staticmethod
    def _synapses(proc: ConductancePlaceNetwork, c: Constants) -> DelayedDense | ConductancePlastic:
        """The input's synapses, frozen or learning."""
        state, config = proc.proc_params["state"], proc.proc_params["config"]
        weights, delays = np.array(state.weights.T, np.float64, order="C"), state.delays.T
        if not proc.proc_params["learn"]:
            return DelayedDense(weights=weights, delays=delays, interval=c.total)
        return ConductancePlastic(
            weights=weights, delays=delays, learning=config.learning, constants=c, dt_ms=config.network.dt_ms
        )
