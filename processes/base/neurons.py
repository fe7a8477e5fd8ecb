"""Populations of leaky integrate-and-fire neurons: what the excitatory and the inhibitory Process have in common.

Both models compute `engine.general.lif`'s equations; the floating-point one without its truncation, wrapping and
clipping, and with u and v in the unit of the threshold (2^6 times the integer model's)::

    u' = u (4095 - du) / 4096 + a;   v' = max(v (4096 - dv) / 4096 + u' + b, floor);   spike = v' > vth;   v'[spike] = 0
"""

from __future__ import annotations

from abc import abstractmethod
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters, bias_of, check_thresholds, lif_step, need
from lava_vpr.loihi import DECAY_BITS, INPUT_LIMIT, INPUT_SHIFT, NO_MEMORY_DECAY, STATE_LIMIT
from lava_vpr.processes.base.magma import (
    CheckedProcess,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    RegisterVar,
    check_shape,
    require,
    vector,
    whole,
)

NO_FLOOR = -INPUT_LIMIT
"""What the Var ``floor`` holds when there is none: below every membrane of the integer model."""

_UNITY = 1 << DECAY_BITS


def check_state(name: str, value: NDArray[Any]) -> None:
    """Refuse values of u, v or held that are not whole numbers of 24 bits.

    Raises:
        NetworkLimitError: naming the range.
    """
    low = 0 if name == "held" else 1 - STATE_LIMIT
    fits = (value >= low) & (value < STATE_LIMIT) & (value == np.floor(value))
    require(name, value, fits, f"a whole number in {low}..{STATE_LIMIT - 1}")


def _check_table(table: BiasTable, neurons: int, interval: int) -> None:
    """Refuse biases of presentations that do not fit the population, or its registers.

    Raises:
        NetworkLimitError: naming what does not.
    """
    need(interval > 0, "reset_interval", interval, "at least 1 where biases follow presentations")
    shape = (len(table.exponents), neurons)
    need(table.mantissas.shape == shape, "bias_table's mantissas", table.mantissas.shape, f"of the shape {shape}")
    bias_of(table.mantissas, table.exponents[:, None])


class BiasTable(NamedTuple):
    """Biases of a population in each presentation: mantissas int32 (n, neurons) and exponents int32 (n,)."""

    mantissas: NDArray[np.int32]
    exponents: NDArray[np.int32]

    def write(self, presentation: int, mantissa: NDArray[Any], exponent: NDArray[Any]) -> None:
        """Write the biases of a presentation into these Vars; after the last one its own stay."""
        if presentation < len(self.mantissas):
            mantissa[:], exponent[:] = self.mantissas[presentation], self.exponents[presentation]


class LifProcess(CheckedProcess):
    """A population of leaky integrate-and-fire neurons, the base of the Processes for exc and inh.

    Ports: ``a_in``, ``s_out`` (neurons,). Vars (neurons,): ``u``, ``v``, ``vth``, ``held`` (steps that a membrane still
    stays at 0), ``bias_mant``, ``bias_exp``; Vars (1,): ``du``, ``dv``, ``floor``, ``hold_steps``, ``theta_plus``.
    All can be read whenever the run pauses. With ``reset_interval`` R, u, v and held are 0 at the start of the steps
    1, R + 1, 2 R + 1, ..., before anything is integrated; thresholds are kept.
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        dv: float,
        vth: Any,
        du: float = NO_MEMORY_DECAY,
        bias_mant: Any = 0,
        bias_exp: Any = 0,
        floor: float | None = None,
        hold_steps: int = 0,
        theta_plus: float = 0,
        reset_interval: int = 0,
        bias_table: BiasTable | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the population: its ports, and its Vars with their first values.

        Args:
            shape: (neurons,).
            dv, du: Decays of membrane and current in units of 2^-12, 0..4096 and 0..4095 (4095: no memory).
            vth: Thresholds, 0..131071, one for all or one each.
            bias_mant, bias_exp: Bias mant 2^exp in units of 2^-6 of the threshold's, -4096..4095 and -7..7.
            floor: Lower bound of the membrane in the threshold's unit, -131071..0; None is no bound.
            hold_steps: Steps after a spike in which the membrane stays at 0.
            theta_plus: What a spike adds to its neuron's threshold.
            reset_interval: Steps of a presentation; 0: never reset.
            bias_table: Biases that are written at the start of each presentation, in place of those above.
        Raises:
            NetworkLimitError: shapes that do not fit, or integers that Loihi's registers cannot hold; numbers of a
                float type are checked when Lava picks the integer model for them.
        """
        n = check_shape(type(self).__name__, shape)
        need(whole(hold_steps) and hold_steps >= 0, "hold_steps", hold_steps, "a whole number, at least 0")
        need(whole(reset_interval) and reset_interval >= 0, "reset_interval", reset_interval, "whole, at least 0")
        if bias_table is not None:
            _check_table(bias_table, n, reset_interval)
        super().__init__(shape=shape, reset_interval=int(reset_interval), bias_table=bias_table, **kwargs)
        first_values: dict[str, tuple[Any, int]] = {
            "du": (du, 1),
            "dv": (dv, 1),
            "floor": (NO_FLOOR if floor is None else floor, 1),
            "hold_steps": (hold_steps, 1),
            "theta_plus": (theta_plus, 1),
            "vth": (vth, n),
            "bias_mant": (bias_mant, n),
            "bias_exp": (bias_exp, n),
        }
        init = {name: vector(name, value, size) for name, (value, size) in first_values.items()}
        self.a_in = InPort(shape=shape)
        self.s_out = OutPort(shape=shape)
        for name in ("u", "v", "held"):
            setattr(self, name, RegisterVar((n,), 0, partial(check_state, name)))
        for name, value in init.items():
            setattr(self, name, RegisterVar(value.shape, value, partial(self._check_new, name)))
        if whole(*init.values()):
            self.check_fixed()

    def _check_new(self, name: str, value: NDArray[Any]) -> None:
        self.check_fixed(**{name: value})

    def check_fixed(self, **changed: NDArray[Any]) -> None:
        """Refuse what the registers cannot hold.

        Args:
            **changed: Values that Vars are about to be set to, by name.
        Raises:
            NetworkLimitError: a parameter out of its range, or not a whole number.
        """
        names = ("du", "dv", "floor", "hold_steps", "theta_plus", "vth", "bias_mant", "bias_exp")
        values = {name: np.asarray(changed.get(name, getattr(self, name).init)) for name in names}
        for name, value in values.items():
            require(name, value, value == np.floor(value), "a whole number for the integer model")
        floor = int(values["floor"].flat[0])
        scalars = {name: int(values[name].flat[0]) for name in ("du", "dv", "hold_steps", "theta_plus")}
        LifParameters(floor=None if floor == NO_FLOOR else floor, **scalars).check()
        check_thresholds(values["vth"])
        for extreme in (np.min, np.max):
            bias_of(int(extreme(values["bias_mant"])), int(extreme(values["bias_exp"])))

    def compile_kernels(self) -> None:
        """Compile `lif_step` before the models are forked."""
        state, sums = np.zeros((4, 1), np.int32), np.zeros((2, 1), np.int64)
        lif_step(*state, *sums, LifParameters().constants, np.zeros(1, bool))


HELD = {
    "a_in": (np.int64, 24),
    "u": (np.int32, 24),
    "v": (np.int32, 24),
    "vth": (np.int32, 17),
    "bias_mant": (np.int32, 13),
    "bias_exp": (np.int32, 4),
    "du": (np.int32, 12),
    "dv": (np.int32, 13),
    "floor": (np.int32, 18),
    "theta_plus": (np.int32, 17),
}
"""Types and bits of the integer model, as `model_of` takes them."""


class LifModel(PyLoihiProcessModel):
    """The base of both models: presentations begin at rest and with their biases; each integrates in its arithmetic."""

    s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, bool, precision=1)
    held: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32)
    hold_steps: NDArray[np.int32] = LavaPyType(np.ndarray, np.int32)
    a_in: PyInPort
    u: NDArray[Any]
    v: NDArray[Any]
    vth: NDArray[Any]
    bias_mant: NDArray[Any]
    bias_exp: NDArray[Any]
    du: NDArray[Any]
    dv: NDArray[Any]
    floor: NDArray[Any]
    theta_plus: NDArray[Any]

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.interval: int = proc_params["reset_interval"]
        self.table: BiasTable | None = proc_params.get("bias_table")
        self.spikes = np.zeros(proc_params["shape"], bool)
        self.ready = False

    @abstractmethod
    def prepare(self) -> None:
        """Take over the Vars, at first and when one was set."""

    @abstractmethod
    def biases(self) -> NDArray[Any]:
        """What the neurons integrate besides their input, as the Vars have it."""

    @abstractmethod
    def integrate(self, drive: NDArray[Any]) -> None:
        """Advance all states by one step in which ``drive`` arrived, and set ``spikes``."""

    def on_var_update(self) -> None:
        """Take over the Vars again before the next step: one was set."""
        self.ready = False

    def run_spk(self) -> None:
        """Receive the input sums of one step, integrate them, and send the spikes."""
        if not self.ready:
            self.prepare()
            self.bias, self.ready = self.biases(), True
        drive = self.a_in.recv()
        if self.interval and (self.time_step - 1) % self.interval == 0:
            self.u[:] = self.v[:] = self.held[:] = 0
            if self.table is not None:
                self.table.write((self.time_step - 1) // self.interval, self.bias_mant, self.bias_exp)
                self.bias = self.biases()
        self.integrate(drive)
        self.s_out.send(self.spikes)


class LifModelFixed(LifModel):
    """The neurons in Loihi's integers, by `lif_step`: bit-accurate with Lava's LIF."""

    def prepare(self) -> None:
        """Make the numbers that `lif_step` takes of the Vars."""
        du, dv, floor, hold, plus = (
            int(var[0]) for var in (self.du, self.dv, self.floor, self.hold_steps, self.theta_plus)
        )
        self.constants = LifParameters(du, dv, None if floor == NO_FLOOR else floor, hold, plus).constants

    def biases(self) -> NDArray[Any]:
        """Biases in units of v, int64 (neurons,)."""
        return bias_of(self.bias_mant, self.bias_exp)

    def integrate(self, drive: NDArray[Any]) -> None:
        """Advance all states by `lif_step`."""
        lif_step(self.u, self.v, self.vth, self.held, drive, self.bias, self.constants, self.spikes)


class LifModelFloat(LifModel):
    """The neurons of `LifProcess` in float64: the equations without truncation, wrapping and clipping."""

    def prepare(self) -> None:
        """Make the shares of u and v that stay in a step."""
        self.keep_u = float((_UNITY - 1 - self.du[0]) / _UNITY)
        self.keep_v = float((_UNITY - self.dv[0]) / _UNITY)

    def biases(self) -> NDArray[Any]:
        """Biases in the unit of the threshold, float64 (neurons,)."""
        return np.asarray(self.bias_mant * 2.0 ** (self.bias_exp - INPUT_SHIFT))

    def integrate(self, drive: NDArray[Any]) -> None:
        """Advance all states by the equations."""
        self.u *= self.keep_u
        self.u += drive
        self.v *= self.keep_v
        self.v += self.u
        self.v += self.bias
        if self.floor[0] != NO_FLOOR:
            np.maximum(self.v, self.floor, out=self.v)
        if self.hold_steps[0]:
            waiting = self.held > 0
            self.v[waiting] = 0
            self.held -= waiting
        np.greater(self.v, self.vth, out=self.spikes)
        self.v[self.spikes] = 0
        self.held[self.spikes] = self.hold_steps
        self.vth[self.spikes] += self.theta_plus
