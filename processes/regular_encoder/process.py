"""Regular input spikes that the host makes and injects: those of input compartments, without the compartments."""

from __future__ import annotations

import numpy as np

from lava_vpr.engine.inference.bias_input import schedule
from lava_vpr.processes.base.encoders import EncoderProcess


class RegularEncoder(EncoderProcess):
    """Sends the spikes of `engine.inference.bias_input.bias_input_spikes`, presentation after presentation, then none.

    Input j spikes every ``LEVEL // bias + 1`` steps, for the first time when its start membrane says. They are the
    spikes of a `lava_vpr.processes.BiasInputs`, whose compartments integrate them on the chip; these come from outside.

    Arguments, port and Var as `lava_vpr.processes.base.encoders.EncoderProcess`.
    """

    def compile_kernels(self) -> None:
        """Compile the kernel before the models are forked."""
        schedule(np.ones(1, np.int32), np.uint64(0), 1)
