"""How `LearningPlaceNetwork` is composed; the tag of the run picks the arithmetic of its parts."""

from __future__ import annotations

import numpy as np

from lava_vpr.processes.base.magma import AbstractSubProcessModel, LoihiProtocol, implements
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, wire
from lava_vpr.processes.dense_synapses.process import DenseSynapses
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF
from lava_vpr.processes.networks.learning_place_network.process import LearningPlaceNetwork
from lava_vpr.processes.one_to_one.process import OneToOne
from lava_vpr.processes.plastic_dense.process import PlasticDense


@implements(proc=LearningPlaceNetwork, protocol=LoihiProtocol)
class SubLearningPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc by synapses that its spikes change, exc to inh, and inh takes from every exc.

    Each exc has a relay, too, which gives it back in the same step what inh takes: winners are spared.
    """

    def __init__(self, proc: LearningPlaceNetwork) -> None:
        learning, shape, interval = proc.learning, proc.s_out.shape, proc.interval
        lif = learning.neurons
        self.excite = PlasticDense(**proc.plasticity)
        self.exc = ExcitatoryLIF(
            shape=shape,
            du=lif.du,
            dv=lif.dv,
            vth=proc.vars.vth.init,
            floor=lif.floor,
            hold_steps=lif.hold_steps,
            theta_plus=0 if learning.late_theta else lif.theta_plus,
            reset_interval=interval,
        )
        self.listen = DenseSynapses(weights=np.full((1, *shape), RELAY_WEIGHT))
        self.inh = InhibitoryLIF(shape=(1,), reset_interval=interval)
        self.inhibit = DenseSynapses(
            weights=proc.vars.lateral_weights.init, weight_exp=proc.exponent, sign_mode="inhibitory"
        )
        self.echo = OneToOne(shape=shape, weight=RELAY_WEIGHT)
        self.own = InhibitoryLIF(shape=shape, reset_interval=interval)
        # Not OneToOne: Lava's fixed-point Sparse fails once its weights were set.
        self.give_back = DenseSynapses(
            weights=proc.vars.own_weights.init, weight_exp=proc.exponent, sign_mode="excitatory"
        )
        wire(proc, self)
        self.exc.s_out.connect(self.excite.s_in_post)
        proc.vars.x1.alias(self.excite.x1)
        proc.vars.own_weights.alias(self.give_back.weights)
