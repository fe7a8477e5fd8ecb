"""VPRSNN's network of two conductance-based populations, as one hierarchical Process, and its populations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.engine.conductance.kernels import (
    E_EXC,
    E_INH,
    E_OFFSET,
    E_RESET,
    E_REST,
    E_THRESHOLD,
    EXC_TO_INH,
    I_RESET,
    I_REST,
    I_THRESHOLD,
    INH_TO_EXC,
    Constants,
)
from lava_vpr.engine.conductance.model import ConductanceState, constants
from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.magma import (
    AbstractProcess,
    AbstractSubProcessModel,
    InPort,
    LavaPyType,
    OutPort,
    PyInPort,
    PyLoihiProcessModel,
    PyOutPort,
    Var,
    check_shape,
    implements,
    model_of,
    tag,
)
from lava_vpr.processes.conductance.delayed_synapses.process import ConductancePlastic, DelayedDense, check_synapses
from lava_vpr.processes.conductance.neurons import ConductanceNeuron
from lava_vpr.processes.synapses.process import LateralInhibition, OneToOne

READY = 1 << 40
"""Steps since the last spike of a neuron that has never spiked."""


class ConductanceLIF(AbstractProcess):
    """A population of conductance-based neurons; floating point only::

        v += leak ((rest - v) + ge (e_exc - v) + gi (e_inh - v)), frozen for ``freeze`` steps after a spike
        spike if v > (theta - offset) + threshold, at least ``refractory`` steps after the last one
        then v = reset, theta += theta_plus

    Input that arrives in a Lava step was sent by spikes of the previous step and is added to the conductances *first*:
    this equals adding it at the end of that step, after its thresholds, as Brian2's schedule does. So Lava's
    connections, which take one step, give Brian2's timing without any change. In the first step of a presentation all
    states but theta return to rest, and input that arrives then is lost.

    Ports, all (neurons,): ``g_e_in`` excitatory conductance; ``g_i_in`` *minus the number* of inhibitory spikes, as
    `LateralInhibition` sends with an inhibition of 1, since each adds ``g_inh`` on its own; ``s_out`` spikes.
    Vars, all (neurons,): ``v``, ``ge``, ``gi``, ``theta``, ``since_spike`` (steps).
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        neuron: ConductanceNeuron,
        theta: float | NDArray[np.float64] = 0.0,
        interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make a population at rest.

        Args:
            shape: ``(neurons,)``.
            neuron: What they have in common.
            theta: Adaptive part of each threshold in mV, one value or (neurons,).
            interval: Steps of one presentation; 0: states are never reset.
        Raises:
            NetworkLimitError: a value outside its range.
        """
        super().__init__(shape=shape, neuron=neuron, theta=theta, interval=interval, **kwargs)
        check_shape("ConductanceLIF", shape)
        if interval < 0:
            raise NetworkLimitError(f"ConductanceLIF: interval is {interval}, but must be at least 0 steps")
        values = np.asarray(theta, np.float64)
        if values.shape not in ((), shape) or not np.isfinite(values).all():
            raise NetworkLimitError(
                f"ConductanceLIF: theta of shape {values.shape} must be finite, one value or of shape {shape}"
            )
        self.g_e_in = InPort(shape=shape)
        self.g_i_in = InPort(shape=shape)
        self.s_out = OutPort(shape=shape)
        self.v = Var(shape=shape, init=neuron.rest)
        self.ge = Var(shape=shape, init=0.0)
        self.gi = Var(shape=shape, init=0.0)
        self.theta = Var(shape=shape, init=np.broadcast_to(values, shape).copy())
        self.since_spike = Var(shape=shape, init=READY)


@model_of(ConductanceLIF, "float")
class PyConductanceLIFFloat(PyLoihiProcessModel):
    """Euler's method in float64, operation by operation as `lava_vpr.engine.conductance.kernels` does it."""

    g_e_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, float)
    g_i_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, float)
    s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, bool, precision=1)
    v: np.ndarray = LavaPyType(np.ndarray, float)
    ge: np.ndarray = LavaPyType(np.ndarray, float)
    gi: np.ndarray = LavaPyType(np.ndarray, float)
    theta: np.ndarray = LavaPyType(np.ndarray, float)
    since_spike: np.ndarray = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.neuron: ConductanceNeuron = proc_params["neuron"]
        self.interval: int = proc_params["interval"]

    def run_spk(self) -> None:
        """Run one step: receive what arrives, advance the states, send the spikes, reset the neurons that fired."""
        excited, inhibiting = self.g_e_in.recv(), -self.g_i_in.recv()
        if self.interval > 0 and (self.time_step - 1) % self.interval == 0:
            self._rest()
        else:
            self.ge += excited
            # One spike after another: floating-point sums depend on how they are grouped.
            for spike in range(int(inhibiting.max())):
                self.gi += np.where(inhibiting > spike, self.neuron.g_inh, 0.0)
        fired = self._step(self.neuron)
        self.s_out.send(fired)
        self.v[fired] = self.neuron.reset
        self.theta[fired] += self.neuron.theta_plus
        self.since_spike[fired] = 0

    def _rest(self) -> None:
        """Bring all states but theta to rest, as a presentation begins with them."""
        self.v[:] = self.neuron.rest
        self.ge[:] = 0.0
        self.gi[:] = 0.0
        self.since_spike[:] = READY

    def _step(self, n: ConductanceNeuron) -> np.ndarray:
        """Advance all states by one step and return which neurons spike, bool (neurons,)."""
        self.since_spike += 1
        change = n.leak * ((n.rest - self.v) + self.ge * (n.e_exc - self.v) + self.gi * (n.e_inh - self.v))
        np.add(self.v, change, out=self.v, where=self.since_spike >= n.freeze)
        self.ge -= n.ge_decay * self.ge
        self.gi -= n.gi_decay * self.gi
        self.theta -= n.theta_decay * self.theta
        return (self.v > (self.theta - n.offset) + n.threshold) & (self.since_spike >= n.refractory)


def excitatory_neuron(c: Constants) -> ConductanceNeuron:
    """The excitatory population of the ``paper`` preset."""
    return ConductanceNeuron(
        leak=c.exc_leak,
        ge_decay=c.ge_decay,
        gi_decay=c.gi_decay,
        rest=E_REST,
        reset=E_RESET,
        threshold=E_THRESHOLD,
        offset=E_OFFSET,
        e_exc=E_EXC,
        e_inh=E_INH,
        freeze=c.freeze,
        refractory=c.timer,
        g_inh=INH_TO_EXC,
        theta_plus=c.theta_plus,
        theta_decay=c.theta_decay,
    )


def inhibitory_neuron(c: Constants) -> ConductanceNeuron:
    """The inhibitory population; nothing inhibits it, and its thresholds are fixed."""
    return ConductanceNeuron(
        leak=c.inh_leak,
        ge_decay=c.ge_decay,
        gi_decay=c.gi_decay,
        rest=I_REST,
        reset=I_RESET,
        threshold=I_THRESHOLD,
        offset=0.0,
        e_exc=0.0,
        e_inh=-85.0,
        freeze=c.inh_freeze,
        refractory=c.inh_freeze,
    )


class ConductancePlaceNetwork(AbstractProcess):
    """Input -> excitatory (all to all, delayed), excitatory -> inhibitory -> all *other* excitatory neurons.

    Runs the spec of `engine.conductance.model`, every spike, weight and theta equal to that engine's: step k of a
    presentation is Lava step k of it, for the input, both populations and every connection. With ``learn`` weights and
    thetas change as in training, else they are frozen.

    Ports: ``s_in`` input spikes (inputs,), ``s_out`` and ``s_out_inh`` spikes of the populations (neurons,).
    Vars: ``v``, ``ge``, ``gi``, ``theta`` of the excitatory, ``v_inh`` of the inhibitory population, all (neurons,);
    ``weights`` (neurons, inputs).
    Run it with ``Loihi2SimCfg(select_tag="floating_pt")``.
    """

    def __init__(self, *, state: ConductanceState, config: Config, learn: bool = False, **kwargs: Any) -> None:
        """Make the network with the weights, delays and thetas of ``state``.

        Args:
            state: Weights and delays (inputs, neurons), thetas (neurons,).
            config: Settings with a conductance network.
            learn: Whether weights and thetas change.
        Raises:
            ConfigError: settings of another network.
            NetworkLimitError: arrays that do not fit each other or hold values out of range.
        """
        super().__init__(state=state, config=config, learn=learn, **kwargs)
        check_synapses("ConductancePlaceNetwork", state.weights.T, state.delays.T, 0)
        constants(config, learn=learn)
        inputs, neurons = state.weights.shape
        if state.theta_mv.shape != (neurons,) or not np.isfinite(state.theta_mv).all():
            raise NetworkLimitError(
                f"ConductancePlaceNetwork: theta {state.theta_mv.shape} must be finite, for {neurons} neurons"
            )
        self.s_in = InPort(shape=(inputs,))
        self.s_out = OutPort(shape=(neurons,))
        self.s_out_inh = OutPort(shape=(neurons,))
        self.v = Var(shape=(neurons,), init=E_REST)
        self.ge = Var(shape=(neurons,), init=0.0)
        self.gi = Var(shape=(neurons,), init=0.0)
        self.theta = Var(shape=(neurons,), init=state.theta_mv)
        self.v_inh = Var(shape=(neurons,), init=I_REST)
        self.weights = Var(shape=(neurons, inputs), init=np.array(state.weights.T, np.float64, order="C"))


@implements(proc=ConductancePlaceNetwork)
@tag("floating_pt")
class SubConductancePlaceNetwork(AbstractSubProcessModel):
    """Two populations, the input's synapses, and the loop through the inhibitory population."""

    def __init__(self, proc: ConductancePlaceNetwork) -> None:
        state, learn = proc.proc_params["state"], proc.proc_params["learn"]
        c = constants(proc.proc_params["config"], learn=learn)
        neurons, total = len(state.theta_mv), c.total
        self.excite = self._synapses(proc, c)
        self.exc = ConductanceLIF(shape=(neurons,), neuron=excitatory_neuron(c), theta=state.theta_mv, interval=total)
        self.relay = OneToOne(shape=(neurons,), weight=EXC_TO_INH)
        self.inh = ConductanceLIF(shape=(neurons,), neuron=inhibitory_neuron(c), interval=total)
        self.others = LateralInhibition(shape=(neurons,), inhibition=1.0)  # minus the number that spiked
        for source, target in (
            (proc.in_ports.s_in, self.excite.in_ports.s_in),
            (self.excite.out_ports.a_out, self.exc.in_ports.g_e_in),
            (self.exc.out_ports.s_out, self.relay.in_ports.s_in),
            (self.relay.out_ports.a_out, self.inh.in_ports.g_e_in),
            (self.inh.out_ports.s_out, self.others.in_ports.s_in),
            (self.others.out_ports.a_out, self.exc.in_ports.g_i_in),
            (self.exc.out_ports.s_out, proc.out_ports.s_out),
            (self.inh.out_ports.s_out, proc.out_ports.s_out_inh),
        ):
            source.connect(target)
        if learn:
            self.exc.out_ports.s_out.connect(self.excite.in_ports.post_in)
        for name in ("v", "ge", "gi", "theta"):
            getattr(proc.vars, name).alias(getattr(self.exc.vars, name))
        proc.vars.weights.alias(self.excite.vars.weights)
        proc.vars.v_inh.alias(self.inh.vars.v)

    @staticmethod
    def _synapses(proc: ConductancePlaceNetwork, c: Constants) -> DelayedDense | ConductancePlastic:
        """The input's synapses, frozen or learning."""
        state, config = proc.proc_params["state"], proc.proc_params["config"]
        weights, delays = np.array(state.weights.T, np.float64, order="C"), state.delays.T
        if not proc.proc_params["learn"]:
            return DelayedDense(weights=weights, delays=delays, interval=c.total)
        return ConductancePlastic(
            weights=weights, delays=delays, learning=config.learning, constants=c, dt_ms=config.network.dt_ms
        )
