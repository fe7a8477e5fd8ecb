"""Models of `RegularEncoder`: trains are made of integers, so both send the same spikes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.bias_input import biases, schedule
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.encoders import EncoderModel
from lava_vpr.processes.regular_encoder.process import RegularEncoder


class _RegularModel(EncoderModel):
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


@cpu_model(RegularEncoder, "float")
class PyRegularEncoderFloat(_RegularModel):
    """The encoder for networks in float64."""


@cpu_model(RegularEncoder, "fixed")
class PyRegularEncoderFixed(_RegularModel):
    """The encoder for networks in Loihi's integers."""
