"""How `PlaceNetwork` is composed; the tag of the run picks the arithmetic of its parts."""

from __future__ import annotations

from lava_vpr.engine.inference.neuron_bias import bias_registers
from lava_vpr.processes.base.magma import AbstractSubProcessModel, LoihiProtocol, implements
from lava_vpr.processes.base.neurons import BiasTable
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, gathering, inhibiting, listening, wire
from lava_vpr.processes.dense_synapses.process import DenseSynapses
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF
from lava_vpr.processes.networks.place_network.process import PlaceNetwork
from lava_vpr.processes.one_to_one.process import OneToOne


@implements(proc=PlaceNetwork, protocol=LoihiProtocol)
class SubPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc, exc to inh, and inh takes from every exc. Every arrow takes one step."""

    def __init__(self, proc: PlaceNetwork) -> None:
        network, interval = proc.network, proc.interval
        weights, bits, exponent = network.stored
        bias, bias_exponent = network.bias_registers
        self.excite = DenseSynapses(
            weights=weights,
            num_weight_bits=bits,
            weight_exp=exponent,
            sign_mode="mixed" if network.signed else "excitatory",
        )
        self.exc = ExcitatoryLIF(
            shape=(network.neurons,),
            dv=network.decay,
            vth=network.threshold,
            bias_mant=bias,
            bias_exp=bias_exponent,
            reset_interval=interval,
            bias_table=None if proc.bias is None else BiasTable(*bias_registers(proc.bias)),
        )
        sparse = network.leaves > 0
        self.listen = DenseSynapses(weights=listening(network), sparse=sparse)
        self.inh = InhibitoryLIF(shape=(network.inhibitory,), reset_interval=interval)
        self.inhibit = DenseSynapses(
            weights=inhibiting(network),
            weight_exp=network.inhibition_exponent,
            sign_mode="inhibitory",
            sparse=sparse,
        )
        if network.leaves:
            self.gather = DenseSynapses(weights=gathering(network), sparse=True)
        if network.relayed:
            self.forward = OneToOne(shape=(network.inputs,), weight=RELAY_WEIGHT)
            self.relays = InhibitoryLIF(shape=(network.inputs,), reset_interval=interval)
        wire(proc, self)
        proc.vars.bias_mant.alias(self.exc.bias_mant)
        proc.vars.bias_exp.alias(self.exc.bias_exp)
