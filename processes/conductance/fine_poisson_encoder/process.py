"""Poisson input spikes of fine time steps, drawn with 32 bits."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import OutPort
from lava.magma.core.process.process import AbstractProcess
from numpy.typing import NDArray

from lava_vpr.errors import NetworkLimitError


class FinePoissonEncoder(AbstractProcess):
    """Sends the draws of `lava_vpr.encoding.draw_spikes`, one presentation after another; then it is silent.

    A presentation is ``steps`` steps with input and ``rest_steps`` without. Port: ``s_out`` spikes (inputs,).
    """

    def __init__(
        self,
        *,
        rates: NDArray[np.uint32],
        keys: NDArray[np.uint64],
        steps: int,
        rest_steps: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make the encoder of some presentations, which it sends one after another.

        Args:
            rates: Spike probabilities per step in units of 2^-32, uint32 (n, inputs).
            keys: One key per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
            steps: Steps with input, at least 1.
            rest_steps: Steps without.
        Raises:
            NetworkLimitError: arrays of another type or shape, or no steps.
        """
        super().__init__(rates=rates, keys=keys, steps=steps, rest_steps=rest_steps, **kwargs)
        if rates.dtype != np.uint32 or rates.ndim != 2 or rates.size == 0:
            raise NetworkLimitError(
                f"FinePoissonEncoder: rates are {rates.dtype} {rates.shape}, but must be uint32 (n, inputs) "
                "in units of 2^-32; use lava_vpr.encoding.rates32"
            )
        if keys.dtype != np.uint64 or keys.shape != rates.shape[:1]:
            raise NetworkLimitError(
                f"FinePoissonEncoder: keys are {keys.dtype} {keys.shape}, but must be uint64 ({len(rates)},), "
                "one for each row of rates"
            )
        if steps < 1 or rest_steps < 0:
            raise NetworkLimitError(
                f"FinePoissonEncoder: {steps} steps and {rest_steps} at rest, but at least 1 and 0 are needed"
            )
        self.s_out = OutPort(shape=rates.shape[1:])
