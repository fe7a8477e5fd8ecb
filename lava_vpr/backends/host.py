"""The host backend: the compiled engine on this machine's processor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Events, Presentations
from lava_vpr.encoding import draw_trains
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.trains import Trains
from lava_vpr.model import Model, checked_network


@dataclass(frozen=True)
class HostBackend:
    """The compiled engine; results do not depend on the number of threads."""

    threads: int = 1

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `lava_vpr.backends.interface.Backend.count_spikes`."""
        if isinstance(model.network, ConductanceState):
            return conductance.count_spikes(model.network, shown.rates, shown.keys, model.config, threads=self.threads)
        network = checked_network(model, "host")
        counts, events, _ = fixed.count_spikes(network, shown.rates, shown.keys, bias=shown.bias, threads=self.threads)
        return counts, events

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """See `lava_vpr.backends.interface.Backend.trains`.

        The inhibitory neurons' trains follow from those of exc (`fixed.inhibitory_spikes`).
        """
        network = checked_network(model, "host")
        _, _, exc = fixed.count_spikes(
            network, shown.rates, shown.keys, bias=shown.bias, threads=self.threads, raster=True
        )
        inputs = draw_trains(shown.rates, shown.keys, network.steps, network.interval, regular=network.regular)
        return Trains(exc, inputs, fixed.inhibitory_spikes(network, exc))
