"""Input compartments that integrate a bias, written once a presentation: trains without spike traffic."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import OutPort
from lava.magma.core.process.variable import Var
from numpy.typing import NDArray

from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT
from lava_vpr.processes.base.checked import CheckedProcess, RegisterVar, check_outputs, check_presentations, require
from lava_vpr.processes.base.neurons import check_state


def _check_bias(name: str, largest: int, value: NDArray[Any]) -> None:
    """Refuse biases that the registers of an input compartment cannot hold.

    Raises:
        NetworkLimitError: naming the range.
    """
    fits = (value >= 0) & (value <= largest) & (value == np.floor(value))
    require(name, value, fits, f"a whole number in 0..{largest}")


class BiasInputs(CheckedProcess):
    """Sends the spikes of `engine.inference.bias_input.bias_input_spikes`, presentation after presentation, then none.

    In the first step of a presentation each compartment's bias and start membrane are written; in each step with
    input ``v' = v + bias_mant 2^bias_exp; spike = v' > THRESHOLD << 6; v'[spike] = 0``. In the silent steps and after
    the last presentation the compartments rest.

    Port: ``s_out`` spikes (inputs,). Vars (inputs,): ``v``, ``bias_mant``, ``bias_exp``, and ``emitted`` int64, how
    many spikes each input has sent. ``interval``: steps of a presentation. It can stand wherever an encoder
    can.
    """

    def __init__(
        self,
        *,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        steps: int,
        silent_steps: int,
        emitted: NDArray[np.int64] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the compartments, which send the spikes of all presentations one after another.

        Args:
            rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
            keys: One key per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,); start
                membranes depend on it.
            steps: Steps with input, at least 1.
            silent_steps: Steps without (`FixedNetwork.silent_steps`).
            emitted: Shared array to count in, besides the Var; int64 (inputs,).
        Raises:
            NetworkLimitError: arrays of another type or shape, or numbers of steps out of range.
        """
        check_presentations("BiasInputs", rates, keys, steps, silent_steps)
        shape = rates.shape[1:]
        check_outputs("BiasInputs", emitted=(emitted, shape, np.int64))
        self.interval = int(steps + silent_steps)
        super().__init__(
            rates=np.ascontiguousarray(rates),
            keys=keys,
            steps=int(steps),
            interval=self.interval,
            shared=emitted,
            **kwargs,
        )
        self.s_out = OutPort(shape=shape)
        self.v = RegisterVar(shape, 0, partial(check_state, "v"))
        self.bias_mant = RegisterVar(shape, 0, partial(_check_bias, "bias_mant", (1 << BIAS_BITS) - 1))
        self.bias_exp = RegisterVar(shape, 0, partial(_check_bias, "bias_exp", BIAS_EXPONENT_LIMIT))
        self.emitted = Var(shape=shape, init=0)
