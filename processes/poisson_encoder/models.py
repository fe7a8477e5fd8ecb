"""Models of `PoissonEncoder`: draws are integers, so both send the same spikes."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.model.py.model import PyLoihiProcessModel
from lava.magma.core.model.py.ports import PyOutPort
from lava.magma.core.model.py.type import LavaPyType
from numpy.typing import NDArray

from lava_vpr.engine.draw import LANES, draw_block, prepare_draws, scratch
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.poisson_encoder.process import PoissonEncoder


class _EncoderModel(PyLoihiProcessModel):
    """The model draws the spikes of four steps at a time."""

    s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, bool, precision=1)
    emitted: NDArray[np.int64] = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.rates, self.keys = proc_params["rates"], proc_params["keys"]
        self.steps, self.interval = proc_params["steps"], proc_params["interval"]
        self.shared = proc_params["shared"]
        self.arrays = scratch(self.rates.shape[1])
        self.drawn, self.sizes = self.arrays[-2:]
        self.active = 0
        self.spikes = np.zeros(self.rates.shape[1], bool)
        self.silence = np.zeros(self.rates.shape[1], bool)

    def run_spk(self) -> None:
        """Send the spikes of this step."""
        image, step = divmod(self.time_step - 1, self.interval)
        if image >= len(self.keys) or step >= self.steps:
            self.s_out.send(self.silence)
            return
        if step == 0:
            self.active = prepare_draws(self.rates[image], self.keys[image], *self.arrays[:3])
        lane = step % LANES
        if lane == 0:
            draw_block(step // LANES, self.active, *self.arrays)
        chosen = self.drawn[lane, : self.sizes[lane]]
        self.spikes[:] = False
        self.spikes[chosen] = True
        self.s_out.send(self.spikes)
        self.emitted[chosen] += 1
        if self.shared is not None:
            self.shared[chosen] += 1


@cpu_model(PoissonEncoder, "float")
class PyPoissonEncoderFloat(_EncoderModel):
    """The encoder for networks in float64."""


@cpu_model(PoissonEncoder, "fixed")
class PyPoissonEncoderFixed(_EncoderModel):
    """The encoder for networks in Loihi's integers."""
