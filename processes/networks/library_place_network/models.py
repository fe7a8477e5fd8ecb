"""How `LibraryPlaceNetwork` is wired."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.decorator import implements
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import identity

from lava_vpr.loihi import DECAY_BITS
from lava_vpr.processes.base.wiring import wire
from lava_vpr.processes.networks.library_place_network.process import LibraryPlaceNetwork
from lava_vpr.processes.networks.place_network.process import RELAY_WEIGHT


@implements(proc=LibraryPlaceNetwork, protocol=LoihiProtocol)
class SubLibraryPlaceNetwork(AbstractSubProcessModel):
    """Input spikes to exc; exc to inh, one to one; inh to all other exc. Every arrow takes one step."""

    def __init__(self, proc: LibraryPlaceNetwork) -> None:
        network, n = proc.network, proc.network.neurons
        excite, bits, exponent = network.stored
        weights: NDArray[Any] = excite
        lateral: NDArray[Any] = network.inhibition * (np.eye(n, dtype=np.int32) - 1)
        relay = RELAY_WEIGHT * identity(n, dtype=np.int32, format="csr")
        no_memory: float = (1 << DECAY_BITS) - 1
        decay: float = network.decay
        if proc.floating:  # exponents into the weights, decays as fractions
            weights, lateral = excite * 2.0**exponent, lateral * 2.0**network.inhibition_exponent
            relay, no_memory, decay = relay.astype(float), 1.0, decay / (1 << DECAY_BITS)
        # Resets fall on the steps 1, interval + 1, ...; thresholds stay int, other types cannot be read back.
        reset = {"reset_interval": proc.interval, "reset_offset": 1}
        self.excite = Dense(weights=weights, num_weight_bits=bits, weight_exp=exponent, sign_mode=SignMode.EXCITATORY)
        self.exc = LIFReset(shape=(n,), du=no_memory, dv=decay, vth=network.threshold, **reset)
        self.relay = Sparse(weights=relay, sign_mode=SignMode.EXCITATORY)
        self.inh = LIFReset(shape=(n,), du=no_memory, dv=no_memory, vth=0, **reset)
        self.inhibit = Dense(weights=lateral, weight_exp=network.inhibition_exponent, sign_mode=SignMode.INHIBITORY)
        wire(proc, self.excite, self.exc, self.relay, self.inh, self.inhibit)
