"""The model of `LateralInhibition`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.magma import LavaPyType, PyInPort, PyLoihiProcessModel, PyOutPort
from lava_vpr.processes.lateral_inhibition.process import LateralInhibition


@cpu_model(LateralInhibition, "float")
class PyLateralInhibitionFloat(PyLoihiProcessModel):
    """The inhibition between neurons in float64, with any strength."""

    s_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, bool, precision=1)
    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, float)
    inhibition: NDArray[np.float64] = LavaPyType(np.ndarray, float)
    a_buff: NDArray[np.float64] = LavaPyType(np.ndarray, float)

    def run_spk(self) -> None:
        """Send what the spikes of the step before take, then take this step's."""
        self.a_out.send(self.a_buff)
        spikes: NDArray[Any] = np.flatnonzero(self.s_in.recv())
        self.a_buff[:] = -self.inhibition * len(spikes)
        self.a_buff[spikes] += self.inhibition
