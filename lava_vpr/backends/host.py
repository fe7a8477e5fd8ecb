"""The host backend: the compiled engine on this machine's processor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Events, Presentations
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.encoding import spike_trains
from lava_vpr.engine.blocks import Block, in_blocks, of_conductances, of_integers
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.presentations import Trains
from lava_vpr.model import Model, checked_network


@dataclass(frozen=True)
class HostBackend:
    """The compiled engine; results do not depend on who counts."""

    pool: Pool = ONE_THREAD

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `lava_vpr.backends.interface.Backend.count_spikes`."""
        block = Block(shown.rates, shown.keys, shown.bias)
        if isinstance(model.network, ConductanceState):
            network = model.network, model.config
            return in_blocks(of_conductances, network, block, pool=self.pool)
        integer = checked_network(model, "host")
        return in_blocks(of_integers, integer, block, pool=self.pool)

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """See `lava_vpr.backends.interface.Backend.trains`."""
        network = checked_network(model, "host")
        return spike_trains(network, shown.rates, shown.keys, bias=shown.bias, threads=self.pool.threads)
