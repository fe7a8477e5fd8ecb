"""The model of `SpikeCounter`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel
from lava_vpr.processes.spike_counter.process import SpikeCounter


@cpu_model(SpikeCounter, "fixed", "float")
class PySpikeCounter(PyLoihiProcessModel):
    """The counter, of networks in either arithmetic."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    counts: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.interval, self.presentations = proc_params["interval"], proc_params["presentations"]
        self.shared, self.raster = proc_params["shared"], proc_params["raster"]

    def run_spk(self) -> None:
        """Count the spikes of this step for the presentation that it belongs to, and record them if asked to."""
        spikes = np.flatnonzero(self.s_in.recv())
        image, step = divmod(self.time_step - 1, self.interval)
        if not len(spikes) or image >= self.presentations:
            return
        self.counts[image, spikes] += 1
        if self.shared is not None:
            self.shared[image, spikes] += 1
        if self.raster is not None:
            self.raster[image, step, spikes] = 1
