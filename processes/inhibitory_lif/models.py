"""Models of `InhibitoryLIF`."""

from __future__ import annotations

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.neurons import LifModelFixed, LifModelFloat
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF


@cpu_model(InhibitoryLIF, "float")
class PyInhibitoryLIFFloat(LifModelFloat):
    """The neurons in float64, without truncation, wrapping and clipping."""


@cpu_model(InhibitoryLIF, "fixed")
class PyInhibitoryLIFFixed(LifModelFixed):
    """The neurons in Loihi's integers, bit-accurate with Lava's LIF."""
