"""The names of Lava's core that Processes and their models are made of, each from where Lava 0.10 has it."""

from __future__ import annotations

from lava.magma.core.decorator import implements, requires, tag
from lava.magma.core.model.py.model import PyLoihiProcessModel
from lava.magma.core.model.py.ports import PyInPort, PyOutPort
from lava.magma.core.model.py.type import LavaPyType
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.process import AbstractProcess
from lava.magma.core.process.variable import Var
from lava.magma.core.resources import CPU
from lava.magma.core.run_conditions import RunSteps
from lava.magma.core.run_configs import Loihi2HwCfg, Loihi2SimCfg, RunConfig
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol

__all__ = [
    "CPU",
    "AbstractProcess",
    "AbstractSubProcessModel",
    "InPort",
    "LavaPyType",
    "Loihi2HwCfg",
    "Loihi2SimCfg",
    "LoihiProtocol",
    "OutPort",
    "PyInPort",
    "PyLoihiProcessModel",
    "PyOutPort",
    "RunConfig",
    "RunSteps",
    "Var",
    "implements",
    "requires",
    "tag",
]
