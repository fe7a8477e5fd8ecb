"""The model of `FusedPlaceNetwork`."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import EVENTS, count_spikes
from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.magma import LavaPyType, PyLoihiProcessModel
from lava_vpr.processes.networks.fused_place_network.process import FusedPlaceNetwork


@cpu_model(FusedPlaceNetwork, "fixed")
class PyFusedPlaceNetworkFixed(PyLoihiProcessModel):
    """Presents a batch of images in each Lava step, in Loihi's integers.

    While Lava turns from one step to the next, a thread already computes the next batch; its results appear in the step
    that they belong to.
    """

    counts: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32)
    events: NDArray[np.int64] = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.network, self.batch = proc_params["network"], proc_params["batch"]
        self.rates, self.keys = proc_params["rates"], proc_params["keys"]
        self.bias = proc_params["bias"]
        self.shared: dict[str, NDArray[Any] | None] = proc_params["shared"]
        self.look_ahead = bool(proc_params["ahead"])
        self.pool: ThreadPoolExecutor | None = None  # made in the forked process, which would not inherit its thread
        self.ahead: Future[Any] | None = None

    def _present(self, part: slice) -> Any:
        """What `count_spikes` makes of the images ``part``."""
        raster, bias = self.shared["raster"] is not None, None if self.bias is None else self.bias[part]
        return count_spikes(self.network, self.rates[part], self.keys[part], bias=bias, raster=raster)

    def run_spk(self) -> None:
        """Present the next images, if any are left."""
        start, n = (self.time_step - 1) * self.batch, len(self.keys)
        if start >= n:
            return
        part, then = (slice(k, min(k + self.batch, n)) for k in (start, start + self.batch))
        counts, events, film = self.ahead.result() if self.ahead is not None else self._present(part)
        if then.start < n and self.look_ahead:
            self.pool = self.pool or ThreadPoolExecutor(1)
            self.ahead = self.pool.submit(self._present, then)
        raster = self.shared["raster"]
        numbers = np.array([events[name] for name in EVENTS], np.int64)
        self.counts[part] = counts
        self.events += numbers
        if raster is not None:
            raster[part] = film
        if self.shared["counts"] is not None:
            self.shared["counts"][part] = counts
        if self.shared["events"] is not None:
            self.shared["events"] += numbers
