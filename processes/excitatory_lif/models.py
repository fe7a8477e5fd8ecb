"""Models of `ExcitatoryLIF`."""

from __future__ import annotations

from lava_vpr.processes.base.cpu_model import cpu_model
from lava_vpr.processes.base.neurons import LifModelFixed, LifModelFloat
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF


@cpu_model(ExcitatoryLIF, "float")
class PyExcitatoryLIFFloat(LifModelFloat):
    """In float64."""


@cpu_model(ExcitatoryLIF, "fixed")
class PyExcitatoryLIFFixed(LifModelFixed):
    """In Loihi's integers."""
