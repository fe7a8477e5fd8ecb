"""Models of `InhibitoryLIF`."""

from __future__ import annotations

from lava.magma.core.decorator import implements, requires, tag
from lava.magma.core.resources import CPU
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol

from lava_vpr.processes.base.neurons import LifModelFixed, LifModelFloat
from lava_vpr.processes.inhibitory_lif.process import InhibitoryLIF


@implements(proc=InhibitoryLIF, protocol=LoihiProtocol)
@requires(CPU)
@tag("floating_pt")
class PyInhibitoryLIFFloat(LifModelFloat):
    """In float64."""


@implements(proc=InhibitoryLIF, protocol=LoihiProtocol)
@requires(CPU)
@tag("bit_accurate_loihi", "fixed_pt")
class PyInhibitoryLIFFixed(LifModelFixed):
    """In Loihi's integers."""
