"""Counts the spikes of a population in each presentation, and records them on request."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.processes.base.magma import (
    CheckedProcess,
    InPort,
    LavaPyType,
    PyInPort,
    PyLoihiProcessModel,
    Var,
    check_outputs,
    check_shape,
    model_of,
    whole,
)


class SpikeCounter(CheckedProcess):
    """Counts spikes in the step in which they are sent; spikes after the last presentation are not counted.

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


@model_of(SpikeCounter, "fixed", "float")
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
