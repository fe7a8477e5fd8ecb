"""Input compartments that integrate a bias, written once a presentation: trains without spike traffic."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.bias_input import biases, start_membranes
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, INPUT_SHIFT
from lava_vpr.processes.base.checked import RegisterVar, require
from lava_vpr.processes.base.encoders import EncoderProcess
from lava_vpr.processes.base.neurons import check_state


def _check_bias(name: str, largest: int, value: NDArray[Any]) -> None:
    """Refuse biases that the registers of an input compartment cannot hold.

    Raises:
        NetworkLimitError: naming the range.
    """
    fits = (value >= 0) & (value <= largest) & (value == np.floor(value))
    require(name, value, fits, f"a whole number in 0..{largest}")


class BiasInputs(EncoderProcess):
    """Sends the spikes of `engine.inference.bias_input.bias_input_spikes`, presentation after presentation, then none.

    In the first step of a presentation each compartment's bias and start membrane are written; in each step with
    input ``v' = v + bias_mant 2^bias_exp; spike = v' > THRESHOLD << 6; v'[spike] = 0``. In the silent steps and after
    the last presentation the compartments rest.

    Lava's library has a LIF in their place, and who runs it writes to it: in one pause a presentation, between the last
    step with input and the silent ones, `write` sets the next bias, and a membrane from which that bias reaches the
    next start membrane by the end of the silent steps. Start membranes are below the threshold, so nothing spikes on
    the way, and the threshold itself need not be written: Lava's simulated LIF ignores a new one after its first step.

    Port: ``s_out`` spikes (inputs,). Vars (inputs,): ``v``, ``bias_mant``, ``bias_exp``, and ``emitted`` int64, how
    many spikes each input has sent (with Lava's library it stays 0). ``interval``: steps of a presentation.
    ``sent``: Vars that `write` has set so far; each is one message an element.
    """

    def __init__(self, *, silent_steps: int, **kwargs: Any) -> None:
        """Make the compartments, which send the spikes of all presentations one after another.

        Args:
            silent_steps: Steps without input at the end of a presentation (`FixedNetwork.silent_steps`).
            **kwargs: The other arguments of `EncoderProcess`; start membranes depend on the keys.
        Raises:
            NetworkLimitError: as `EncoderProcess`.
        """
        super().__init__(silent_steps=silent_steps, **kwargs)
        self.rates, self.keys, self.silent_steps = kwargs["rates"], kwargs["keys"], int(silent_steps)
        shape = self.s_out.shape
        self.v = RegisterVar(shape, 0, partial(check_state, "v"))
        self.bias_mant = RegisterVar(shape, 0, partial(_check_bias, "bias_mant", (1 << BIAS_BITS) - 1))
        self.bias_exp = RegisterVar(shape, 0, partial(_check_bias, "bias_exp", BIAS_EXPONENT_LIMIT))
        self.written: dict[str, NDArray[Any]] = {}
        self.sent = 0

    def values(self, presentation: int, steps_before: int = 0, floating: bool = False) -> dict[str, NDArray[Any]]:
        """What the Vars of Lava's LIF hold ``steps_before`` steps before a presentation begins.

        Args:
            presentation: Its number.
            steps_before: Steps in which the membrane still rises by the bias.
            floating: For the library's floating-point model, which ignores exponents of biases and has the membrane in
                the unit of the threshold.
        """
        mantissa, exponent = biases(self.rates[presentation])
        v = start_membranes(int(self.keys[presentation]), self.rates.shape[1])
        v -= steps_before * (mantissa << exponent)
        if not floating:
            return {"v": v, "bias_mant": mantissa, "bias_exp": exponent}
        unit = 2.0**-INPUT_SHIFT
        return {"v": v * unit, "bias_mant": (mantissa << exponent) * unit, "bias_exp": np.zeros_like(exponent)}

    def write(self, presentation: int) -> None:
        """Prepare the next presentation of Lava's LIF, in the pause before the silent steps of the one that runs.

        After the last one, name it again: the silent steps need a membrane that stays below the threshold, too.

        Raises:
            NetworkLimitError: the compartments are this project's own, which write for themselves.
        """
        if not self.written:
            raise NetworkLimitError("BiasInputs: write is for Lava's library; the CPU models write for themselves")
        for name, values in self.values(presentation, self.silent_steps, not self.fixed).items():
            if name == "v" or not np.array_equal(values, self.written[name]):
                getattr(self, name).set(values)
                self.written[name] = values
                self.sent += 1
