"""The one model of `FinePoissonEncoder`: draws are integers, whatever the arithmetic of the network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.encoding import draw_spikes
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.encoders import EncoderModel
from lava_vpr.processes.conductance.fine_poisson_encoder.process import FinePoissonEncoder


@cpu_model(FinePoissonEncoder, "float")
class PyFinePoissonEncoder(EncoderModel):
    """The model draws a presentation's spikes when it begins."""

    drawn: NDArray[np.bool_]

    def begin(self, image: int) -> None:
        """Draw the spikes of a presentation."""
        self.drawn = draw_spikes(self.rates[image], int(self.keys[image]), self.steps)

    def members(self, step: int) -> NDArray[np.integer]:
        """The inputs that were drawn for this step."""
        return np.flatnonzero(self.drawn[step])
