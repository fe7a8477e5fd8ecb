"""What Processes and their models are made of: names of Lava's core, from where Lava 0.10 has them; `model_of`; and
Processes whose parameters are checked before Lava starts anything, with the checks."""

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
from numpy.typing import DTypeLike, NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.errors import NetworkLimitError

__all__ = [
    "CPU",
    "FIXED_TAG",
    "AbstractProcess",
    "AbstractSubProcessModel",
    "CheckedProcess",
    "InPort",
    "LavaPyType",
    "Loihi2HwCfg",
    "Loihi2SimCfg",
    "LoihiProtocol",
    "OutPort",
    "PyInPort",
    "PyLoihiProcessModel",
    "PyOutPort",
    "RegisterVar",
    "RunConfig",
    "RunSteps",
    "Var",
    "check_outputs",
    "check_presentations",
    "check_shape",
    "implements",
    "model_of",
    "require",
    "requires",
    "tag",
    "vector",
    "whole",
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


FIXED_TAG = "fixed_pt"
"""Tag of the models that compute in Loihi's integers."""


def whole(*values: Any) -> bool:
    """Whether all values are of an integer type: registers, not numbers for the floating-point model."""
    return all(np.asarray(value).dtype.kind in "iub" for value in values)


def require(name: str, values: NDArray[Any], fits: NDArray[np.bool_], limit: str) -> None:
    """Refuse values of which one does not fit, naming the first such.

    Raises:
        NetworkLimitError: naming the parameter, the value and its range.
    """
    need(bool(np.all(fits)), name, "" if np.all(fits) else values[~fits].flat[0], limit)


def check_outputs(name: str, **arrays: tuple[NDArray[Any] | None, tuple[int, ...], DTypeLike]) -> None:
    """Refuse arrays for results that have another shape or type than the results.

    Args:
        name: Name of the Process, for the message.
        **arrays: Array, or None; its shape; its dtype.
    Raises:
        NetworkLimitError: naming the first.
    """
    for key, (array, shape, dtype) in arrays.items():
        if array is not None and (array.shape != shape or array.dtype != np.dtype(dtype)):
            raise NetworkLimitError(
                f"{name}: {key} is {array.dtype} {array.shape}, but must be {np.dtype(dtype)} {shape}; "
                "make it with lava_vpr.processes.base.shared_memory.shared_array"
            )


def check_presentations(
    name: str, rates: NDArray[Any], keys: NDArray[np.uint64], steps: int = 1, silent_steps: int = 0, bits: int = 16
) -> None:
    """Refuse what an input Process cannot present.

    Args:
        name: Name of the Process, for the message.
        rates: Must be unsigned integers (n, inputs) of so many bits.
        keys: Must be uint64 (n,).
        steps, silent_steps: Steps of one presentation with and without input, at least 1 and 0.
        bits: Of a rate, 16 or 32.
    Raises:
        NetworkLimitError: naming the argument and the remedy.
    """
    if rates.dtype != np.dtype(f"uint{bits}") or rates.ndim != 2 or not rates.shape[1]:
        raise NetworkLimitError(
            f"{name}: rates are {rates.dtype} {rates.shape}, but must be uint{bits} (n, inputs) in units of 2^-{bits}; "
            f"use lava_vpr.encoding.rates{bits}"
        )
    if keys.dtype != np.uint64 or keys.shape != rates.shape[:1]:
        raise NetworkLimitError(
            f"{name}: keys are {keys.dtype} {keys.shape}, but must be uint64 ({len(rates)},), one for each row of "
            "rates; use lava_vpr.engine.random.presentation_keys"
        )
    if not whole(steps, silent_steps) or steps < 1 or silent_steps < 0:
        raise NetworkLimitError(
            f"{name}: {steps} steps and {silent_steps} silent ones, but at least 1 and 0 are needed"
        )


def check_shape(name: str, shape: tuple[int, ...]) -> int:
    """The number of neurons of a one-dimensional ``shape``.

    Raises:
        NetworkLimitError: it has more dimensions, or no neurons.
    """
    if len(shape) != 1 or shape[0] < 1:
        raise NetworkLimitError(f"{name}: shape is {shape}, but must be (neurons,) with at least one neuron")
    return int(shape[0])


class CheckedProcess(AbstractProcess):
    """A Process that is checked in the moment in which Lava's compiler picks its model.

    An error inside a running model can hang the program, and one Process serves both float and integer models. The
    compiler names the picked model before it starts anything: the one moment when a parameter that the integer
    model cannot hold is refused as an ordinary exception.
    """

    _runtime: Any = None  # Lava's destructor asks for it, also where a constructor refused its arguments

    def check_fixed(self) -> None:
        """Refuse parameters that Loihi's registers cannot hold.

        Raises:
            NetworkLimitError: naming the parameter, its value and its range.
        """

    def compile_kernels(self) -> None:
        """Compile what the models call, once and before they are forked."""

    @property
    def fixed(self) -> bool:
        """Whether Lava has picked a model that computes in integers."""
        return FIXED_TAG in getattr(self._model_class, "tags", ())

    @property
    def _model_class(self) -> Any:
        return self.__dict__.get("_picked_model")

    @_model_class.setter
    def _model_class(self, model: Any) -> None:
        self.__dict__["_picked_model"] = model
        if model is not None:
            if self.fixed:
                self.check_fixed()
            self.compile_kernels()


class RegisterVar(Var):
    """A Var whose new values are checked when it is set, while the integer model runs.

    Attributes:
        constant: Lava's library runs instead of the Process and has no such Var: it keeps its first value.
    """

    constant = False

    def __init__(self, shape: tuple[int, ...], init: Any, check: Callable[[NDArray[Any]], object]) -> None:
        super().__init__(shape=shape, init=init)
        self.check = check

    def set(self, value: Any, idx: Any = None) -> None:
        """Set the value, as Lava's Var does.

        Raises:
            NetworkLimitError: Loihi's registers cannot hold it, or Lava's library cannot change it.
        """
        if self.constant:
            raise NetworkLimitError(
                f"{type(self.process).__name__}: {self.name} cannot be set with Lava's library; run it without "
                "select_sub_proc_model"
            )
        if getattr(self.process, "fixed", False):
            self.check(np.asarray(value))
        super().set(value, idx)

    def get(self, idx: Any = None) -> Any:
        """The value, as Lava's Var gives it."""
        if not self.constant:
            return super().get(idx)
        value = np.broadcast_to(self.init, self.shape)
        return value.copy() if idx is None else value[idx]


def vector(name: str, value: Any, neurons: int) -> NDArray[Any]:
    """``value``, one for all neurons or one each, as an array (neurons,) of its own type.

    Raises:
        NetworkLimitError: another number of values, or one that is not a finite number.
    """
    array = np.asarray(value)
    if array.dtype.kind not in "iubf":
        raise NetworkLimitError(f"{name} is {value!r}, but must be a number or an array of {neurons} numbers")
    if array.shape not in ((), (1,), (neurons,)):
        raise NetworkLimitError(f"{name} has shape {array.shape}, but must be one number or one each: ({neurons},)")
    require(name, array, np.isfinite(array), "finite")
    return np.broadcast_to(array, (neurons,)).copy()
