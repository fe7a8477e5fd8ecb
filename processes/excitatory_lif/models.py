"""Models of `ExcitatoryLIF`."""

from __future__ import annotations

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.library_parts import LibraryNeurons, library_model
from lava_vpr.processes.base.neurons import LifModelFixed, LifModelFloat
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF


@library_model(ExcitatoryLIF, "fixed")
class SubExcitatoryLIFFixed(LibraryNeurons):
    """Lava's LIFReset, or LIF where there are no resets."""


@library_model(ExcitatoryLIF, "float")
class SubExcitatoryLIFFloat(LibraryNeurons):
    """The same, with the numbers that Lava's floating-point models take."""

    floating = True


@cpu_model(ExcitatoryLIF, "float")
class PyExcitatoryLIFFloat(LifModelFloat):
    """The excitatory neurons in float64, without truncation, wrapping and clipping."""


@cpu_model(ExcitatoryLIF, "fixed")
class PyExcitatoryLIFFixed(LifModelFixed):
    """The excitatory neurons in Loihi's integers, bit-accurate with Lava's LIF."""
