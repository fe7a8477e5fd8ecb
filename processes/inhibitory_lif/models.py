"""Models of `InhibitoryLIF`."""

from __future__ import annotations

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.library_parts import LibraryNeurons, library_model
from lava_vpr.processes.base.neurons import LifModelFixed, LifModelFloat
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF


@library_model(InhibitoryLIF, "fixed")
class SubInhibitoryLIFFixed(LibraryNeurons):
    """Lava's LIFReset, or LIF where there are no resets."""


@library_model(InhibitoryLIF, "float")
class SubInhibitoryLIFFloat(LibraryNeurons):
    """The same, with the numbers that Lava's floating-point models take."""

    floating = True


@cpu_model(InhibitoryLIF, "float")
class PyInhibitoryLIFFloat(LifModelFloat):
    """The neurons in float64, without truncation, wrapping and clipping."""


@cpu_model(InhibitoryLIF, "fixed")
class PyInhibitoryLIFFixed(LifModelFixed):
    """The neurons in Loihi's integers, bit-accurate with Lava's LIF."""
