"""How `LibraryPlaceNetwork` is wired."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.decorator import implements
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIFReset
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.loihi import DECAY_UNITY, NO_MEMORY_DECAY
from lava_vpr.processes.base.library_parts import bias_vars, fixed_synapses, reset_each, without_memory
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, gathering, inhibiting, listening, wire
from lava_vpr.processes.networks.library_place_network.process import LibraryPlaceNetwork


def _neurons(network: FixedNetwork, bias: NDArray[np.int32], floating: bool) -> dict[str, Any]:
    """The arguments of the excitatory LIFReset besides shape and resets."""
    # The threshold stays int in both: other types cannot be read back.
    numbers: dict[str, Any] = {**bias_vars(bias, floating), "vth": network.threshold}
    if floating:
        return numbers | {"du": 1.0, "dv": network.decay / DECAY_UNITY}
    return numbers | {"du": NO_MEMORY_DECAY, "dv": network.decay}


@implements(proc=LibraryPlaceNetwork, protocol=LoihiProtocol)
class SubLibraryPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc, exc to inh, and inh takes from every exc. Every arrow takes one step."""

    def __init__(self, proc: LibraryPlaceNetwork) -> None:
        network, interval, floating = proc.network, proc.interval, proc.floating
        weights, bits, exponent = network.stored
        self.excite = Dense(
            weights=weights * 2.0**exponent if floating else weights,
            num_weight_bits=bits,
            weight_exp=exponent,
            sign_mode=SignMode.MIXED if network.signed else SignMode.EXCITATORY,
        )
        numbers = _neurons(network, proc.first_bias, floating)
        self.exc = LIFReset(shape=(network.neurons,), **numbers, **reset_each(interval))
        self.listen = fixed_synapses(listening(network), 0, floating)
        self.inh = without_memory(network.inhibitory, interval, floating)
        self.inhibit = fixed_synapses(
            inhibiting(network), network.inhibition_exponent, floating, sign_mode=SignMode.INHIBITORY
        )
        if network.leaves:
            self.gather = fixed_synapses(gathering(network), 0, floating)
        if network.relayed:
            one_to_one = RELAY_WEIGHT * np.eye(network.inputs, dtype=np.int32)
            self.forward = fixed_synapses(one_to_one, 0, floating)
            self.relays = without_memory(network.inputs, interval, floating)
        wire(proc, self)
        proc.vars.bias_mant.alias(self.exc.bias_mant)
        proc.vars.bias_exp.alias(self.exc.bias_exp)
