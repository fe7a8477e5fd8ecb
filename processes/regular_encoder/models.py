"""The model of `RegularEncoder`: trains are made of integers, so it sends the same spikes in every arithmetic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.bias_input import biases, schedule
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.encoders import EncoderModel
from lava_vpr.processes.regular_encoder.process import RegularEncoder


@cpu_model(RegularEncoder, "fixed", "float")
class PyRegularEncoder(EncoderModel):
    """The model works out a presentation's spikes at its start."""

    starts: NDArray[np.int64]
    listed: NDArray[np.int32]

    def begin(self, image: int) -> None:
        """List the spikes of a presentation, step by step."""
        slopes = np.left_shift(*biases(self.rates[image]))
        self.starts, self.listed = schedule(slopes, self.keys[image], self.steps)

    def members(self, step: int) -> NDArray[np.int32]:
        """The inputs whose turn it is."""
        return self.listed[self.starts[step] : self.starts[step + 1]]
