"""All-to-all synapses with static weights and a delay each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.magma import AbstractProcess, InPort, OutPort, Var

MAX_DELAY = 65534
"""Steps; delays are kept as 16 bits, as in the model file."""


def check_synapses(owner: str, weights: NDArray[np.float64], delays: NDArray[np.integer], interval: int) -> None:
    """Refuse weights, delays and presentation lengths that make no network.

    Raises:
        NetworkLimitError: naming what is out of range.
    """
    if weights.ndim != 2 or weights.size == 0 or delays.shape != weights.shape:
        raise NetworkLimitError(
            f"{owner}: weights {weights.shape} and delays {delays.shape} must be of one shape, (neurons, inputs)"
        )
    if not np.isfinite(weights).all():
        raise NetworkLimitError(f"{owner}: a weight is not finite; train the model again")
    if not np.issubdtype(delays.dtype, np.integer):
        raise NetworkLimitError(f"{owner}: delays of type {delays.dtype} must be whole steps; round them")
    if delays.min() < 0 or delays.max() > MAX_DELAY:
        raise NetworkLimitError(
            f"{owner}: delays of {delays.min()}..{delays.max()} steps must lie in 0..{MAX_DELAY}; lengthen the step"
        )
    if interval < 0:
        raise NetworkLimitError(f"{owner}: interval is {interval}, but must be at least 0 steps")


class DelayedDense(AbstractProcess):
    """All-to-all synapses; a spike sent at step t reaches neuron i, weighted, at step t + 1 + ``delays[i, j]``.

    The one step is every Lava connection's own. At the first step of a presentation all spikes on their way are lost.

    Ports: ``s_in`` spikes (inputs,), ``a_out`` summed weights (neurons,). Vars: ``weights`` (neurons, inputs).
    """

    def __init__(
        self,
        *,
        weights: NDArray[np.float64],
        delays: NDArray[np.integer],
        interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make the synapses with their weights and delays.

        Args:
            weights: float64 (neurons, inputs), as in Lava's Dense.
            delays: Whole steps in 0..65534, of the same shape.
            interval: Steps of one presentation; 0: nothing is ever lost.
        Raises:
            NetworkLimitError: arrays of different shapes, or a value outside its range.
        """
        super().__init__(weights=weights, delays=delays, interval=interval, **kwargs)
        check_synapses("DelayedDense", weights, delays, interval)
        self.s_in = InPort(shape=(weights.shape[1],))
        self.a_out = OutPort(shape=(weights.shape[0],))
        self.weights = Var(shape=weights.shape, init=weights)
