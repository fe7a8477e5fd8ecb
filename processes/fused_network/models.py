"""The model of `FusedPlaceNetwork`."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.decorator import implements, requires, tag
from lava.magma.core.model.py.model import PyLoihiProcessModel
from lava.magma.core.model.py.type import LavaPyType
from lava.magma.core.resources import CPU
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from numpy.typing import NDArray

from lava_vpr.engine.fixed import EVENTS, count_spikes
from lava_vpr.processes.fused_network.process import FusedPlaceNetwork


@implements(proc=FusedPlaceNetwork, protocol=LoihiProtocol)
@requires(CPU)
@tag("bit_accurate_loihi", "fixed_pt")
class PyFusedPlaceNetworkFixed(PyLoihiProcessModel):
    """Presents a batch of images in each Lava step, in Loihi's integers."""

    counts: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32)
    events: NDArray[np.int64] = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.network, self.batch = proc_params["network"], proc_params["batch"]
        self.rates, self.keys = proc_params["rates"], proc_params["keys"]
        self.shared: dict[str, NDArray[Any] | None] = proc_params["shared"]

    def run_spk(self) -> None:
        """Present the next images, if any are left."""
        start = (self.time_step - 1) * self.batch
        part = slice(start, min(start + self.batch, len(self.keys)))
        if start >= len(self.keys):
            return
        raster = self.shared["raster"]
        counts, events, film = count_spikes(self.network, self.rates[part], self.keys[part], raster=raster is not None)
        numbers = np.array([events[name] for name in EVENTS], np.int64)
        self.counts[part] = counts
        self.events += numbers
        if raster is not None:
            raster[part] = film
        if self.shared["counts"] is not None:
            self.shared["counts"][part] = counts
        if self.shared["events"] is not None:
            self.shared["events"] += numbers
