"""How `LearningPlaceNetwork` is composed; the tag of the run picks the arithmetic of its parts."""

from __future__ import annotations

from lava.magma.core.decorator import implements
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol

from lava_vpr.processes.base.wiring import RELAY_WEIGHT, wire
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF
from lava_vpr.processes.lateral_inhibition.process import LateralInhibition
from lava_vpr.processes.networks.learning_place_network.process import LearningPlaceNetwork
from lava_vpr.processes.one_to_one.process import OneToOne
from lava_vpr.processes.plastic_dense.process import PlasticDense


@implements(proc=LearningPlaceNetwork, protocol=LoihiProtocol)
class SubLearningPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc by synapses that its spikes change, exc to inh, one to one, and inh to all other exc."""

    def __init__(self, proc: LearningPlaceNetwork) -> None:
        learning, shape, interval = proc.learning, proc.s_out.shape, proc.interval
        lif = learning.neurons
        self.plastic = PlasticDense(**proc.plasticity)
        self.exc = ExcitatoryLIF(
            shape=shape,
            du=lif.du,
            dv=lif.dv,
            vth=proc.theta,
            floor=lif.floor,
            hold_steps=lif.hold_steps,
            theta_plus=0 if learning.late_theta else lif.theta_plus,
            reset_interval=interval,
        )
        self.relay = OneToOne(shape=shape, weight=RELAY_WEIGHT)
        self.inh = InhibitoryLIF(shape=shape, reset_interval=interval)
        self.inhibit = LateralInhibition(shape=shape, inhibition=learning.inhibition)
        wire(proc, self.plastic, self.exc, self.relay, self.inh, self.inhibit)
        self.exc.s_out.connect(self.plastic.s_in_post)
        proc.vars.x1.alias(self.plastic.x1)
