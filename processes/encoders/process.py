"""Processes that send input spikes: drawn, regular, or from compartments that integrate a bias."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from lava.proc.lif.process import LIF
from numpy.typing import NDArray

from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import LEVEL, THRESHOLD, biases, schedule, start_membranes
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT, INPUT_SHIFT, NO_MEMORY_DECAY
from lava_vpr.processes.base.encoders import EncoderModel, EncoderProcess, ListedEncoderModel, ListedEncoderProcess
from lava_vpr.processes.base.library_parts import stand_for
from lava_vpr.processes.base.magma import AbstractSubProcessModel, RegisterVar, model_of, require
from lava_vpr.processes.base.neurons import check_state


class PoissonEncoder(ListedEncoderProcess):
    """Sends Poisson spikes, one presentation after another; after the last it is silent.

    In step t of the presentation with key k, input j spikes if a random number of 16 bits is below its rate::

        s_j(t) = h(k, t, j) < r_j          so that P(s_j(t) = 1) = r_j 2^-16, independently in every step

    h is a hash (`lava_vpr.engine.random.draws`) and not a stream: the spikes are those of
    `lava_vpr.engine.rates.draw_spikes`, the same on every backend and with any number of threads. For two images of
    three inputs, 350 steps each::

        rates = np.array([[655, 0, 32768], [6554, 6554, 0]], np.uint16)        # 1 %, never, 50 %; 10 %, 10 %, never
        keys = presentation_keys(0, "query", image_keys(rates))
        encoder = PoissonEncoder(rates=rates, keys=keys, steps=350, silent_steps=network.silent_steps)

    Arguments, port and Var as `lava_vpr.processes.base.encoders.EncoderProcess`.
    """

    spikes_of = staticmethod(poisson_spikes)


@model_of(PoissonEncoder, "fixed", "float")
class PyPoissonEncoder(ListedEncoderModel):
    """Inputs whose draw is below their rate."""


class RegularEncoder(ListedEncoderProcess):
    """Sends the spikes of `engine.inference.biases.bias_input_spikes`, presentation after presentation, then none.

    Input j spikes every ``LEVEL // bias + 1`` steps; its start membrane decides when it spikes first. The spikes equal
    those of a `lava_vpr.processes.BiasInputs`, whose compartments integrate on the chip; these come from outside.

    Arguments, port and Var as `lava_vpr.processes.base.encoders.EncoderProcess`.
    """

    spikes_of = staticmethod(lambda rates, key, steps: schedule(np.left_shift(*biases(rates)), key, steps))


@model_of(RegularEncoder, "fixed", "float")
class PyRegularEncoder(ListedEncoderModel):
    """Inputs whose interval has passed."""


class FinePoissonEncoder(ListedEncoderProcess):
    """Sends the draws of `lava_vpr.engine.rates.draw_spikes`, one presentation after another; then it is silent.

    Rates are in units of 2^-32. Arguments, port and Var as `lava_vpr.processes.base.encoders.EncoderProcess`.
    """

    rate_bits = 32
    spikes_of = staticmethod(poisson_spikes)


@model_of(FinePoissonEncoder, "float")
class PyFinePoissonEncoder(ListedEncoderModel):
    """Inputs whose draw is below their rate of 32 bits."""


def _check_bias(name: str, largest: int, value: NDArray[Any]) -> None:
    """Refuse biases that the registers of an input compartment cannot hold.

    Raises:
        NetworkLimitError: naming the range.
    """
    fits = (value >= 0) & (value <= largest) & (value == np.floor(value))
    require(name, value, fits, f"a whole number in 0..{largest}")


class BiasInputs(EncoderProcess):
    """Sends the spikes of `engine.inference.biases.bias_input_spikes`, presentation after presentation, then none.

    In the first step of a presentation each compartment's bias and start membrane are written; in each step with
    input ``v' = v + bias_mant 2^bias_exp; spike = v' > THRESHOLD << 6; v'[spike] = 0``. In the silent steps and after
    the last presentation the compartments rest.

    Lava's library uses a LIF instead, and the caller writes to it: in one pause a presentation, between the last step
    with input and the silent ones, `write` sets the next bias, and a membrane from which that bias reaches the next
    start membrane by the end of the silent steps. Start membranes are below the threshold, so nothing spikes on the
    way, and the threshold itself need not be written: Lava's simulated LIF ignores a new one after its first step.

    Port: ``s_out`` spikes (inputs,). Vars (inputs,): ``v``, ``bias_mant``, ``bias_exp``, and ``emitted`` int64, the
    number of spikes that each input has sent (with Lava's library it stays 0). ``interval``: steps of a presentation.
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


class _LibraryInputs(AbstractSubProcessModel):
    floating: bool

    def __init__(self, proc: BiasInputs) -> None:
        if proc.proc_params["shared"] is not None:
            raise NetworkLimitError("BiasInputs: emitted is not counted by Lava's library; count the spikes of s_out")
        proc.written = proc.values(0, floating=self.floating)
        no_memory: float = 1.0 if self.floating else NO_MEMORY_DECAY
        self.neurons = LIF(shape=proc.s_out.shape, du=no_memory, dv=0, vth=THRESHOLD, **proc.written)
        self.neurons.s_out.connect(proc.s_out)
        stand_for(proc, self.neurons, "v", "bias_mant", "bias_exp", constant=("emitted",))


@model_of(BiasInputs, "fixed")
class SubBiasInputsFixed(_LibraryInputs):
    """Lava's LIF, with the first presentation's bias and start membrane; `BiasInputs.write` sets the others."""


@model_of(BiasInputs, "float")
class SubBiasInputsFloat(_LibraryInputs):
    """The same with the numbers that Lava's floating-point models take."""


_HELD = {"v": (np.int32, 24), "bias_mant": (np.int32, 13), "bias_exp": (np.int32, 3)}


class _InputsModel(EncoderModel):
    """The model integrates in the unit of its arithmetic: ``threshold`` is `LEVEL` in units of 1 / ``scale``."""

    v: NDArray[Any]
    bias_mant: NDArray[Any]
    bias_exp: NDArray[Any]
    threshold: float
    scale: float

    def begin(self, image: int) -> None:
        """Write the biases and start membranes of a presentation."""
        self.bias_mant[:], self.bias_exp[:] = biases(self.rates[image])
        self.v[:] = start_membranes(self.keys[image], len(self.v)) * self.scale

    def members(self, step: int) -> NDArray[np.integer]:
        """The compartments whose membrane passes the threshold; it is 0 then."""
        self.v += self.bias_mant * 2**self.bias_exp * self.scale
        spikes = np.flatnonzero(self.v > self.threshold)
        self.v[spikes] = 0
        return spikes


@model_of(BiasInputs, "float", held=_HELD)
class PyBiasInputsFloat(_InputsModel):
    """The compartments in float64, whose v is in the unit of the threshold."""

    threshold, scale = float(THRESHOLD), 2.0**-INPUT_SHIFT


@model_of(BiasInputs, "fixed", held=_HELD)
class PyBiasInputsFixed(_InputsModel):
    """The compartments in Loihi's integers."""

    threshold, scale = LEVEL, 1
