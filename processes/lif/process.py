"""The excitatory and the inhibitory population, and relays: leaky integrate-and-fire neurons."""

from __future__ import annotations

from typing import Any

from lava_vpr.loihi import NO_MEMORY_DECAY
from lava_vpr.processes.base.library_parts import LibraryNeurons
from lava_vpr.processes.base.magma import model_of
from lava_vpr.processes.base.neurons import HELD, LifModelFixed, LifModelFloat, LifProcess


class ExcitatoryLIF(LifProcess):
    """Leaky integrate-and-fire neurons; ports, Vars and arithmetic as `LifProcess`.

    Beyond Lava's LIF they have one threshold for each neuron, a floor, a hold after spikes, rising thresholds, and
    biases that follow presentations.
    """


@model_of(ExcitatoryLIF, "fixed")
class SubExcitatoryLIFFixed(LibraryNeurons):
    """Lava's LIFReset, or LIF where there are no resets."""


@model_of(ExcitatoryLIF, "float")
class SubExcitatoryLIFFloat(LibraryNeurons):
    """The same, with the numbers that Lava's floating-point models take."""


@model_of(ExcitatoryLIF, "float", held=HELD)
class PyExcitatoryLIFFloat(LifModelFloat):
    """The excitatory neurons in float64, without truncation, wrapping and clipping."""


@model_of(ExcitatoryLIF, "fixed", held=HELD)
class PyExcitatoryLIFFixed(LifModelFixed):
    """The excitatory neurons in Loihi's integers, bit-accurate with Lava's LIF."""


class InhibitoryLIF(LifProcess):
    """Neurons without memory: with the defaults any positive input makes one spike in the same step.

    Ports, Vars and arithmetic as `LifProcess`.
    """

    def __init__(self, *, dv: float = NO_MEMORY_DECAY, vth: Any = 0, **kwargs: Any) -> None:
        """Make the population, by default of neurons that any positive input makes spike.

        Args:
            dv: Decay of the membrane in units of 2^-12.
            vth: Thresholds, 0..131071, one for all or one each.
            **kwargs: The other arguments of `LifProcess`: ``shape``, ``du``, ``reset_interval`` and so on.
        Raises:
            NetworkLimitError: as `LifProcess`.
        """
        super().__init__(dv=dv, vth=vth, **kwargs)


@model_of(InhibitoryLIF, "fixed")
class SubInhibitoryLIFFixed(LibraryNeurons):
    """Lava's LIFReset, or LIF where there are no resets."""


@model_of(InhibitoryLIF, "float")
class SubInhibitoryLIFFloat(LibraryNeurons):
    """The same, with the numbers that Lava's floating-point models take."""


@model_of(InhibitoryLIF, "float", held=HELD)
class PyInhibitoryLIFFloat(LifModelFloat):
    """The neurons in float64, without truncation, wrapping and clipping."""


@model_of(InhibitoryLIF, "fixed", held=HELD)
class PyInhibitoryLIFFixed(LifModelFixed):
    """The neurons in Loihi's integers, bit-accurate with Lava's LIF."""
