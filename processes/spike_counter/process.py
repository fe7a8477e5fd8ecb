"""Counts the spikes of a population, presentation by presentation, and records them if asked to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.processes.base.checked import CheckedProcess, check_outputs, check_shape, whole
from lava_vpr.processes.base.magma import InPort, Var


class SpikeCounter(CheckedProcess):
    """Counts spikes in the step in which they are sent; what comes after the last presentation is not counted.

    Port: ``s_in`` (neurons,). Var: ``counts`` int32 (presentations, neurons). Reading a large Var is slow; give a
    shared array instead.
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        presentations: int,
        interval: int,
        counts: NDArray[np.int32] | None = None,
        raster: NDArray[np.uint8] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the counter of one population's spikes in some presentations.

        Args:
            shape: (neurons,).
            presentations: Number of presentations that will follow each other.
            interval: Steps of one, the silent ones included.
            counts: Shared array to count in, besides the Var; int32 (presentations, neurons).
            raster: Shared array that records every spike, uint8 (presentations, interval, neurons).
        Raises:
            NetworkLimitError: sizes out of range, or arrays of another type or shape.
        """
        n = check_shape("SpikeCounter", shape)
        need(whole(presentations) and presentations >= 1, "presentations", presentations, "a whole number, at least 1")
        need(whole(interval) and interval >= 1, "interval", interval, "a whole number, at least 1")
        check_outputs(
            "SpikeCounter",
            counts=(counts, (presentations, n), np.int32),
            raster=(raster, (presentations, interval, n), np.uint8),
        )
        super().__init__(
            shape=shape,
            presentations=int(presentations),
            interval=int(interval),
            shared=counts,
            raster=raster,
            **kwargs,
        )
        self.s_in = InPort(shape=shape)
        self.counts = Var(shape=(presentations, n), init=0)
