"""Poisson input spikes from counter-based random numbers: the same ones on every backend."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.encoding import rates16
from lava_vpr.engine.draw import draw_block, prepare_draws, scratch
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.processes.base.encoders import EncoderProcess


class PoissonEncoder(EncoderProcess):
    """Sends Poisson spikes, one presentation after another; after the last it is silent.

    In step t of the presentation with key k, input j spikes if a random number of 16 bits is below its rate::

        s_j(t) = h(k, t, j) < r_j          so that P(s_j(t) = 1) = r_j 2^-16, independently in every step

    h is a hash (`lava_vpr.engine.random.draws`) and not a stream: the spikes are those of
    `lava_vpr.encoding.draw_spikes`, the same on every backend and with any number of threads. For two images of three
    inputs, 350 steps each::

        rates = np.array([[655, 0, 32768], [6554, 6554, 0]], np.uint16)        # 1 %, never, 50 %; 10 %, 10 %, never
        keys = presentation_keys(0, "query", image_keys(rates))
        encoder = PoissonEncoder(rates=rates, keys=keys, steps=350, silent_steps=network.silent_steps)

    Arguments, port and Var as `lava_vpr.processes.base.encoders.EncoderProcess`.
    """

    @classmethod
    def of_activity(
        cls,
        activity: NDArray[np.float32],
        *,
        spikes_per_step: float,
        seed: int,
        role: str,
        steps: int,
        **kwargs: Any,
    ) -> PoissonEncoder:
        """An encoder of images from the responses of their input channels.

        Args:
            activity: float32 (n, inputs), as `lava_vpr.encoding.EncodedTraverse.activity`.
            spikes_per_step: Expected spikes of all inputs together in one step.
            seed, role: What random numbers depend on beside the rates (`lava_vpr.engine.random.presentation_key`).
            steps: Steps with input.
            **kwargs: As the constructor's.
        """
        rates = rates16(activity, spikes_per_step)
        return cls(rates=rates, keys=presentation_keys(seed, role, image_keys(rates)), steps=steps, **kwargs)

    def compile_kernels(self) -> None:
        """Compile the drawing kernels before the models are forked."""
        arrays = scratch(1)
        n = prepare_draws(np.ones(1, np.uint16), np.uint64(0), *arrays[:3])
        draw_block(0, n, *arrays)
