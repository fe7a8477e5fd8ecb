"""Models of `ExcitatoryLIF`."""

from __future__ import annotations

from lava.magma.core.decorator import implements, requires, tag
from lava.magma.core.resources import CPU
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol

from lava_vpr.processes.base.neurons import LifModelFixed, LifModelFloat
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF


@implements(proc=ExcitatoryLIF, protocol=LoihiProtocol)
@requires(CPU)
@tag("floating_pt")
class PyExcitatoryLIFFloat(LifModelFloat):
    """In float64."""


@implements(proc=ExcitatoryLIF, protocol=LoihiProtocol)
@requires(CPU)
@tag("bit_accurate_loihi", "fixed_pt")
class PyExcitatoryLIFFixed(LifModelFixed):
    """In Loihi's integers."""
