"""What Processes and their models are made of: names of Lava's core, from where Lava 0.10 has them, and `model_of`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeVar

import numpy as np
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
    "model_of",
    "requires",
    "tag",
]

Model = TypeVar("Model", bound=type[Any])

TAGS = {"fixed": ("bit_accurate_loihi", "fixed_pt"), "float": ("floating_pt",)}
"""The tags by which a run picks the models that compute in Loihi's integers, or in floating point."""

_PORTS = {"a_in": PyInPort.VEC_DENSE, "a_out": PyOutPort.VEC_DENSE}


def model_of(
    process: type[Any], *arithmetic: Literal["fixed", "float"], held: Mapping[str, tuple[Any, int]] | None = None
) -> Callable[[Model], Model]:
    """Declare a class as the model of ``process`` in an arithmetic, or in both.

    The decorator stands for Lava's ``implements`` with Loihi's protocol, ``tag`` (`TAGS`) and, unless the class is a
    SubProcessModel, ``requires(CPU)``; it sets the class's ``floating``::

        @model_of(OneToOne, "fixed", held={"a_out": (np.int32, 24)})
        class PyOneToOneFixed(PyLoihiProcessModel): ...

    Args:
        process: The Process.
        *arithmetic: What the class computes in.
        held: Type and bits, in integers, of the ports and Vars that are float64 in floating point, by name.
    """

    def declare(model: Model) -> Model:
        model.floating = arithmetic == ("float",)
        for name, (dtype, bits) in (held or {}).items():
            kind = _PORTS.get(name, np.ndarray)
            setattr(model, name, LavaPyType(kind, float) if model.floating else LavaPyType(kind, dtype, precision=bits))
        tagged = tag(*(name for each in arithmetic for name in TAGS[each]))(model)
        placed = tagged if issubclass(model, AbstractSubProcessModel) else requires(CPU)(tagged)
        return implements(proc=process, protocol=LoihiProtocol)(placed)

    return declare
