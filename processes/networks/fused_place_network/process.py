"""The whole inference network in one leaf Process, for throughput: one Lava step is a batch of whole presentations."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.engine.inference.fixed import EVENTS, FixedNetwork, count_spikes
from lava_vpr.processes.base.checked import CheckedProcess, check_outputs, check_presentations, whole
from lava_vpr.processes.base.magma import LavaPyType, PyLoihiProcessModel, Var, model_of


class FusedPlaceNetwork(CheckedProcess):
    """`FixedNetwork` with its input, by the compiled kernel of the host engine: bit-exact integers only.

    **One Lava step is a whole presentation, of ``batch`` images at once**: step t presents the images
    (t - 1) batch .. t batch - 1, and `batches` steps present all. It has no ports. Vars: ``counts`` int32 (n, neurons),
    ``events`` int64, as `EVENTS`. Reading a large Var is slow; give shared arrays instead.
    """

    def __init__(
        self,
        *,
        network: FixedNetwork,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        bias: NDArray[np.int32] | None = None,
        batch: int = 64,
        ahead: bool = True,
        counts: NDArray[np.int32] | None = None,
        raster: NDArray[np.uint8] | None = None,
        events: NDArray[np.int64] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the Process that presents all images to ``network``.

        Args:
            network: What to run.
            rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
            keys: One key per presentation, uint64 (n,).
            bias: Biases in units of v of each presentation, int32 (n, neurons); None: always the network's.
            batch: Images of one Lava step.
            ahead: Compute the next step's images while Lava turns to it; else each step does its own, to be timed.
            counts, events: Shared arrays for the results, besides the Vars; the Vars' shapes and types.
            raster: Shared array for every excitatory spike, uint8 (n, interval, neurons).
        Raises:
            NetworkLimitError: a network that could overflow Loihi's registers, biases that they cannot hold, or arrays
                of another type or shape.
            InputError: biases of another type or shape.
        """
        network.check()
        check_presentations("FusedPlaceNetwork", rates, keys)
        fits = len(rates) > 0 and rates.shape[1] == network.inputs
        need(fits, "FusedPlaceNetwork: rates' shape", rates.shape, f"(n, {network.inputs}), n at least 1")
        if bias is not None:
            network.check_presented(bias, len(rates))
        need(whole(batch) and batch >= 1, "batch", batch, "a whole number, at least 1")
        n, shape = len(rates), (len(rates), network.neurons)
        check_outputs(
            "FusedPlaceNetwork",
            counts=(counts, shape, np.int32),
            raster=(raster, (n, network.interval, network.neurons), np.uint8),
            events=(events, (len(EVENTS),), np.int64),
        )
        super().__init__(
            network=network,
            rates=np.ascontiguousarray(rates),
            keys=keys,
            bias=bias,
            batch=int(batch),
            ahead=bool(ahead),
            shared={"counts": counts, "raster": raster, "events": events},
            **kwargs,
        )
        self.batches = -(-n // int(batch))
        self.network = network
        self.counts = Var(shape=shape, init=0)
        self.events = Var(shape=(len(EVENTS),), init=0)

    def compile_kernels(self) -> None:
        """Compile the kernel before the model is forked, and prepare what it reads: by a silent presentation."""
        count_spikes(self.network, np.zeros((1, self.network.inputs), np.uint16), np.zeros(1, np.uint64))


@model_of(FusedPlaceNetwork, "fixed")
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
