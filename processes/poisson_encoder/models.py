"""The model of `PoissonEncoder`: draws are integers, so it sends the same spikes in every arithmetic."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.draw import LANES, draw_block, prepare_draws, scratch
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.encoders import EncoderModel
from lava_vpr.processes.poisson_encoder.process import PoissonEncoder


@cpu_model(PoissonEncoder, "fixed", "float")
class PyPoissonEncoder(EncoderModel):
    """The model draws the spikes of four steps at a time."""

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.arrays = scratch(self.rates.shape[1])
        self.drawn, self.sizes = self.arrays[-2:]
        self.active = 0

    def begin(self, image: int) -> None:
        """Prepare the draws of a presentation."""
        self.active = prepare_draws(self.rates[image], self.keys[image], *self.arrays[:3])

    def members(self, step: int) -> NDArray[np.int32]:
        """The inputs whose draw is below their rate."""
        lane = step % LANES
        if lane == 0:
            draw_block(step // LANES, self.active, *self.arrays)
        chosen: NDArray[np.int32] = self.drawn[lane, : self.sizes[lane]]
        return chosen
