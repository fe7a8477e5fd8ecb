"""Poisson input spikes from counter-based random numbers: the same ones on every backend."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import OutPort
from lava.magma.core.process.variable import Var
from numpy.typing import NDArray

from lava_vpr.encoding import rates16
from lava_vpr.engine.draw import draw_block, prepare_draws, scratch
from lava_vpr.engine.inference.fixed import SILENT_STEPS
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.processes.base.checked import CheckedProcess, check_outputs, check_presentations


@lru_cache(maxsize=1)
def compile_draws() -> None:
    """Compile the drawing kernels, or load them."""
    arrays = scratch(1)
    n = prepare_draws(np.ones(1, np.uint16), np.uint64(0), *arrays[:3])
    draw_block(0, n, *arrays)


class PoissonEncoder(CheckedProcess):
    """Sends Poisson spikes, one presentation after another; after the last it is silent.

    In step t of the presentation with key k, input j spikes if a random number of 16 bits is below its rate::

        s_j(t) = h(k, t, j) < r_j          so that P(s_j(t) = 1) = r_j 2^-16, independently in every step

    h is a hash (`lava_vpr.engine.random.draws`) and not a stream: the spikes are those of
    `lava_vpr.encoding.draw_spikes`, the same on every backend and with any number of threads. For two images of three
    inputs, 350 steps each::

        rates = np.array([[655, 0, 32768], [6554, 6554, 0]], np.uint16)        # 1 %, never, 50 %; 10 %, 10 %, never
        encoder = PoissonEncoder(rates=rates, keys=presentation_keys(0, "query", image_keys(rates)), steps=350)
        encoder.s_out.connect(network.s_in)

    A presentation is ``steps`` steps with input and ``silent_steps`` without. Port: ``s_out`` spikes (inputs,). Var:
    ``emitted`` int64 (inputs,), how many spikes each input has sent. ``interval``: steps of a presentation.
    """

    def __init__(
        self,
        *,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        steps: int,
        silent_steps: int = SILENT_STEPS,
        emitted: NDArray[np.int64] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the encoder of some presentations, which it sends one after another.

        Args:
            rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
            keys: One key per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
            steps: Steps with input, at least 1.
            silent_steps: Steps without.
            emitted: Shared array to count in, besides the Var; int64 (inputs,).
        Raises:
            NetworkLimitError: arrays of another type or shape, or numbers of steps out of range.
        """
        check_presentations("PoissonEncoder", rates, keys, steps, silent_steps)
        check_outputs("PoissonEncoder", emitted=(emitted, rates.shape[1:], np.int64))
        super().__init__(
            rates=np.ascontiguousarray(rates),
            keys=keys,
            steps=int(steps),
            interval=int(steps + silent_steps),
            shared=emitted,
            **kwargs,
        )
        self.interval = int(steps + silent_steps)
        self.s_out = OutPort(shape=rates.shape[1:])
        self.emitted = Var(shape=rates.shape[1:], init=0)

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
        compile_draws()
