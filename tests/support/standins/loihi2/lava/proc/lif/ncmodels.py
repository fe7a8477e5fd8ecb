"""Stand-in for the models on neuron cores; `standin_chip.chip` runs Lava's own instead."""

from lava.magma.core.decorator import implements, requires
from lava.magma.core.model.nc.model import AbstractNcProcessModel
from lava.magma.core.resources import Loihi2NeuroCore
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from lava.proc.lif.process import LIF, LIFReset


@implements(proc=LIF, protocol=LoihiProtocol)
@requires(Loihi2NeuroCore)
class NcModelLIF(AbstractNcProcessModel):
    """LIF on the chip."""


@implements(proc=LIFReset, protocol=LoihiProtocol)
@requires(Loihi2NeuroCore)
class NcModelLIFReset(AbstractNcProcessModel):
    """LIFReset on the chip."""
