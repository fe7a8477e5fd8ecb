"""Input compartments of Lava's own LIF, which a board can run: the host writes bias and membrane once a presentation.

Not in a folder of its own: it is no Process, but one of the library's with what the host does to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.lif.process import LIF
from numpy.typing import NDArray

from lava_vpr.engine.inference.bias_input import THRESHOLD, biases, start_membranes
from lava_vpr.loihi import INPUT_SHIFT, NO_MEMORY_DECAY


class LibraryBiasInputs:
    """A LIF that sends the spikes of `lava_vpr.engine.inference.bias_input.bias_input_spikes`, and writes to it.

    Everything is written in one pause, between the last step with input and the silent ones: the next bias, and a
    membrane from which that bias reaches the next start membrane by the end of the silent steps. Start membranes are
    below the threshold, so nothing spikes on the way, and the threshold itself need not be written: Lava's simulated
    LIF ignores a new one after its first step.

    Attributes:
        lif: The Process, with the first presentation's values.
        sent: Writes of a Var's values so far; each is one message an element.
    """

    def __init__(
        self, *, rates: NDArray[np.uint16], keys: NDArray[np.uint64], silent_steps: int, floating: bool = False
    ) -> None:
        """Make the compartments and give them the bias and start membrane of the first presentation.

        Args:
            rates: Spikes a step in units of 2^-16, uint16 (n, inputs), n at least 1.
            keys: One key per presentation, uint64 (n,).
            silent_steps: Steps without input at the end of a presentation.
            floating: For a run with the tag ``floating_pt``: the library's floating-point model takes decays as
                fractions, ignores bias exponents, and its membrane is in the unit of the threshold.
        """
        self.rates, self.keys, self.silent_steps, self.floating = rates, keys, silent_steps, floating
        self.written = self._values(0)
        no_memory: float = 1.0 if floating else NO_MEMORY_DECAY
        self.lif = LIF(shape=rates.shape[1:], du=no_memory, dv=0, vth=THRESHOLD, **self.written)
        self.sent = 0

    def _values(self, presentation: int, steps_before: int = 0) -> dict[str, NDArray[Any]]:
        """The values of the Vars ``steps_before`` steps before a presentation begins."""
        mantissa, exponent = biases(self.rates[presentation])
        v = start_membranes(int(self.keys[presentation]), self.rates.shape[1])
        v -= steps_before * (mantissa << exponent)
        if not self.floating:
            return {"v": v, "bias_mant": mantissa, "bias_exp": exponent}
        unit = 2.0**-INPUT_SHIFT
        return {"v": v * unit, "bias_mant": (mantissa << exponent) * unit, "bias_exp": np.zeros_like(exponent)}

    def write(self, presentation: int) -> None:
        """Prepare the next presentation, in the pause before the silent steps of the one that runs.

        After the last one, name it again: the silent steps need a membrane that stays below the threshold, too.
        """
        for name, values in self._values(presentation, self.silent_steps).items():
            if name == "v" or not np.array_equal(values, self.written[name]):
                getattr(self.lif, name).set(values)
                self.written[name] = values
                self.sent += 1
