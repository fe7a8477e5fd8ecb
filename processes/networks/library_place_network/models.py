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

from lava_vpr.loihi import DECAY_UNITY, NO_MEMORY_DECAY
from lava_vpr.processes.base.library_parts import relays, reset_each
from lava_vpr.processes.base.wiring import wire
from lava_vpr.processes.networks.library_place_network.process import LibraryPlaceNetwork


@implements(proc=LibraryPlaceNetwork, protocol=LoihiProtocol)
class SubLibraryPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc, exc to inh, one to one, and inh to all other exc. Every arrow takes one step."""

    def __init__(self, proc: LibraryPlaceNetwork) -> None:
        network, n = proc.network, proc.network.neurons
        excite, bits, exponent = network.stored
        weights: NDArray[Any] = excite
        lateral: NDArray[Any] = network.inhibition * (np.eye(n, dtype=np.int32) - 1)
        no_memory: float = NO_MEMORY_DECAY
        decay: float = network.decay
        if proc.floating:  # exponents into the weights, decays as fractions
            weights, lateral = excite * 2.0**exponent, lateral * 2.0**network.inhibition_exponent
            no_memory, decay = 1.0, decay / DECAY_UNITY
        self.excite = Dense(weights=weights, num_weight_bits=bits, weight_exp=exponent, sign_mode=SignMode.EXCITATORY)
        # The threshold stays int: other types cannot be read back.
        self.exc = LIFReset(shape=(n,), du=no_memory, dv=decay, vth=network.threshold, **reset_each(proc.interval))
        self.relay, self.inh = relays(n, proc.interval, proc.floating)
        self.inhibit = Dense(weights=lateral, weight_exp=network.inhibition_exponent, sign_mode=SignMode.INHIBITORY)
        wire(proc, self.excite, self.exc, self.relay, self.inh, self.inhibit)
