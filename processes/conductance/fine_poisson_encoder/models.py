"""The one model of `FinePoissonEncoder`: draws are integers, whatever the arithmetic of the network."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.model.py.model import PyLoihiProcessModel
from lava.magma.core.model.py.ports import PyOutPort
from lava.magma.core.model.py.type import LavaPyType

from lava_vpr.encoding import draw_spikes
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.conductance.fine_poisson_encoder.process import FinePoissonEncoder


@cpu_model(FinePoissonEncoder, "float")
class PyFinePoissonEncoder(PyLoihiProcessModel):
    """The model draws a presentation's spikes when it begins."""

    s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, bool, precision=1)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.rates, self.keys = proc_params["rates"], proc_params["keys"]
        self.steps: int = proc_params["steps"]
        self.interval: int = proc_params["steps"] + proc_params["rest_steps"]
        self.silence = np.zeros(self.rates.shape[1], bool)
        self.spikes = np.zeros((0, self.rates.shape[1]), bool)

    def run_spk(self) -> None:
        """Send the spikes of this step."""
        image, step = divmod(self.time_step - 1, self.interval)
        if step == 0 and image < len(self.keys):
            self.spikes = draw_spikes(self.rates[image], int(self.keys[image]), self.steps)
        playing = step < self.steps and image < len(self.keys)
        self.s_out.send(self.spikes[step] if playing else self.silence)
