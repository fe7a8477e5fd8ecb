"""How `PlaceNetwork` is composed; the tag of the run picks the arithmetic of its parts."""

from __future__ import annotations

from lava.magma.core.decorator import implements
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol

from lava_vpr.processes.base.wiring import RELAY_WEIGHT, wire
from lava_vpr.processes.dense_synapses.process import DenseSynapses
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF
from lava_vpr.processes.lateral_inhibition.process import LateralInhibition
from lava_vpr.processes.networks.place_network.process import PlaceNetwork
from lava_vpr.processes.one_to_one.process import OneToOne


@implements(proc=PlaceNetwork, protocol=LoihiProtocol)
class SubPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc, exc to inh, one to one, and inh to all other exc. Every arrow takes one step."""

    def __init__(self, proc: PlaceNetwork) -> None:
        network, shape, interval = proc.network, (proc.network.neurons,), proc.interval
        weights, bits, exponent = network.stored
        self.excite = DenseSynapses(weights=weights, num_weight_bits=bits, weight_exp=exponent, sign_mode="excitatory")
        self.exc = ExcitatoryLIF(shape=shape, dv=network.decay, vth=network.threshold, reset_interval=interval)
        self.relay = OneToOne(shape=shape, weight=RELAY_WEIGHT)
        self.inh = InhibitoryLIF(shape=shape, reset_interval=interval)
        self.inhibit = LateralInhibition(shape=shape, inhibition=network.lateral)
        wire(proc, self.excite, self.exc, self.relay, self.inh, self.inhibit)
        proc.vars.inhibition.alias(self.inhibit.inhibition)
