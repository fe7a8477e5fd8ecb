"""One declaration for the ProcessModels that run in Python on this machine's processor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

from lava_vpr.processes.base.magma import CPU, LoihiProtocol, implements, requires, tag

Model = TypeVar("Model", bound=type[Any])

TAGS = {"fixed": ("bit_accurate_loihi", "fixed_pt"), "float": ("floating_pt",)}
"""The tags by which a run picks the models that compute in Loihi's integers, or in floating point."""


def cpu_model(process: type[Any], *arithmetic: Literal["fixed", "float"]) -> Callable[[Model], Model]:
    """Declare a class as the model of ``process`` in an arithmetic, or in both.

    The decorator stands for Lava's ``implements`` with Loihi's protocol, ``requires(CPU)`` and ``tag`` (`TAGS`)::

        @cpu_model(OneToOne, "fixed")
        class PyOneToOneFixed(PyLoihiProcessModel): ...
    """

    def declare(model: Model) -> Model:
        tagged = requires(CPU)(tag(*(name for each in arithmetic for name in TAGS[each]))(model))
        return implements(proc=process, protocol=LoihiProtocol)(tagged)

    return declare
