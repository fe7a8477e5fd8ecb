"""Stand-in for the models on neuron cores; `standin_chip.chip` runs Lava's own instead."""

from lava.magma.core.decorator import implements, requires
from lava.magma.core.model.nc.model import AbstractNcProcessModel
from lava.magma.core.resources import Loihi2NeuroCore
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from lava.proc.dense.process import Dense, LearningDense


@implements(proc=Dense, protocol=LoihiProtocol)
@requires(Loihi2NeuroCore)
class NcModelDense(AbstractNcProcessModel):
    """Dense on the chip."""


@implements(proc=LearningDense, protocol=LoihiProtocol)
@requires(Loihi2NeuroCore)
class NcModelLearningDense(AbstractNcProcessModel):
    """LearningDense on the chip: it can be selected, but the stand-in refuses to run it."""
