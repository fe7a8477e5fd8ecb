"""The one registry of backends: a name and an object that counts spikes.

Every backend runs the model's own network spec and has no parameters of its own; equal model, rates and seed give equal
counts, bit for bit, on every fixed-point backend.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.configfile import update
from lava_vpr.engine import conductance, fixed
from lava_vpr.engine.random import presentation_keys
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.model import Model


class Backend(Protocol):
    """Counts spikes of a model's excitatory neurons."""

    def count_spikes(
        self,
        model: Model,
        rates: NDArray[Any],
        *,
        image_ids: NDArray[np.int64],
        role: str,
        seed: int,
        steps: int | None = None,
    ) -> tuple[NDArray[np.int32], dict[str, int]]:
        """Present ``rates`` (n, inputs) for ``steps`` steps with input (default: the model's own).

        Returns:
            Counts int (n, neurons), and the events of the run, summed.
        """
        ...


class HostBackend:
    """The compiled engine on this machine's processor."""

    def __init__(self, threads: int = 1) -> None:
        self.threads = threads

    def count_spikes(
        self,
        model: Model,
        rates: NDArray[Any],
        *,
        image_ids: NDArray[np.int64],
        role: str,
        seed: int,
        steps: int | None = None,
    ) -> tuple[NDArray[np.int32], dict[str, int]]:
        """See `Backend.count_spikes`; the result does not depend on the number of threads."""
        keys = presentation_keys(seed, role, image_ids)
        if isinstance(model.network, fixed.FixedNetwork):
            network = model.network if steps is None else replace(model.network, steps=steps)
            network.check()
            counts, events, _ = fixed.count_spikes(network, rates, keys, threads=self.threads)
            return counts, events
        config = model.config if steps is None else update(model.config, {"network": {"steps": steps}})
        return conductance.count_spikes(model.network, rates, keys, config, threads=self.threads)


BACKENDS: dict[str, str] = {"host": "compiled engine on this machine's processor, bit-exact integers"}


def get(name: str, threads: int = 1) -> Backend:
    """The backend called ``name``.

    Raises:
        BackendUnavailableError: unknown, or its software or device is missing.
    """
    if name not in BACKENDS:
        raise BackendUnavailableError(f"there is no backend {name!r}; choose from {', '.join(BACKENDS)}")
    return HostBackend(threads)
