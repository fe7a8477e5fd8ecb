"""VPRSNN's network in Brian2, written from its equations: the peer with which the `paper` preset is compared and timed.

Brian2 stands in an environment of its own (`make peers`) and compiles with Cython. Settings come from the same
`Config` as the engine's. `Brian2Network.reset` and `Brian2Network.present_spikes` make the two comparable spike by
spike: one start from rest per presentation, the same delays, and the same input spikes.
"""

from __future__ import annotations

import gc
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.settings.conductance import ConductanceLearning, ConductanceNetwork

try:
    import brian2 as b2
except ImportError:  # the benchmark says so when it is run
    b2 = None

_EXC = """
dv/dt = ((-65*mV - v) + ge * (0*mV - v) + gi * (-100*mV - v)) / (100*ms) : volt (unless refractory)
dge/dt = -ge / tau_ge : 1
dgi/dt = -gi / tau_gi : 1
dtimer/dt = timer_rate : second
"""
_INH = """
dv/dt = ((-60*mV - v) + ge * (0*mV - v)) / (10*ms) : volt (unless refractory)
dge/dt = -ge / tau_ge : 1
"""
_TRACES = """
w : 1
dxpre/dt = -xpre / (20*ms) : 1 (event-driven)
"""
_POST_TRACES = """
dpost1/dt = -post1 / (20*ms) : 1 (event-driven)
dpost2/dt = -post2 / (40*ms) : 1 (event-driven)
"""
# Names that Brian2 or SymPy take otherwise cannot be used: pre, post, trace, x_pre.
_RULES = {
    "triplet": (
        _TRACES + _POST_TRACES,
        "ge_post += w; xpre = 1; w = clip(w + eta_pre * post1, 0, w_max)",
        "w = clip(w + eta_post * xpre * post2, 0, w_max); post1 = 1; post2 = 1",
    ),
    "paper": (
        _TRACES,
        "ge_post += w; xpre = 1",
        "w = clip(w + eta_post * (xpre - x_target) * clip(w_max - w, 0, inf) ** mu, 0, w_max)",
    ),
    "frozen": ("w : 1", "ge_post += w", ""),
}
INH_TO_EXC = 17.0
EXC_TO_INH = 10.4


class Brian2Network:
    """One network, built once and run presentation after presentation.

    Args:
        config: Settings with a conductance network, e.g. ``preset("paper")``.
        state: Weights, thresholds and delays to start from.
        learn: With STDP and homeostasis (training), or frozen.
        inputs: ``poisson``, or ``spikes`` for input spikes given one by one.
    Raises:
        BackendUnavailableError: Brian2 is not installed.
    """

    def __init__(self, config: Config, state: ConductanceState, *, learn: bool, inputs: str = "poisson") -> None:
        if b2 is None:
            raise BackendUnavailableError("Brian2 is not installed; run make peers")
        network, learning = config.network, config.learning
        if not isinstance(network, ConductanceNetwork) or not isinstance(learning, ConductanceLearning):
            raise TypeError("Brian2Network runs the conductance network of the paper preset")
        b2.prefs.codegen.target = "cython"
        b2.defaultclock.dt = network.dt_ms * b2.ms
        self.learn, self.weight_sum, self.shape = learn, learning.weight_sum, state.weights.shape
        self.steps, self.rest_steps = network.steps, network.rest_steps
        self.dt = network.dt_ms * b2.ms
        self.namespace = _namespace(network, learning)
        self.exc, self.inh = _populations(self.namespace, self.shape[1], learn)
        if inputs == "poisson":
            self.source = b2.PoissonGroup(self.shape[0], 0 * b2.Hz)
        else:
            self.source = b2.SpikeGeneratorGroup(self.shape[0], [], [] * b2.ms)
        self.synapses = _input_synapses(self.source, self.exc, self.namespace, learning.rule if learn else "frozen")
        self.synapses.w = state.weights.ravel()
        self.synapses.delay = state.delays.ravel() * self.dt
        excite = b2.Synapses(self.exc, self.inh, "w : 1", on_pre="ge_post += w")
        excite.connect(j="i")
        excite.w = EXC_TO_INH
        inhibit = b2.Synapses(self.inh, self.exc, "w : 1", on_pre="gi_post += w")
        inhibit.connect(condition="i != j")
        inhibit.w = INH_TO_EXC
        self.monitor = b2.SpikeMonitor(self.exc, record=False)
        self.net = b2.Network(self.exc, self.inh, self.source, self.synapses, excite, inhibit, self.monitor)
        self.exc.theta = state.theta_mv * b2.mV
        self.reset()

    @property
    def weights(self) -> NDArray[np.float64]:
        """The present weights, (inputs, neurons)."""
        return np.array(self.synapses.w).reshape(self.shape)

    @property
    def theta_mv(self) -> NDArray[np.float64]:
        """The present adaptive thresholds in mV, (neurons,)."""
        return np.array(self.exc.theta / b2.mV)

    def reset(self) -> None:
        """Put all states at rest and let all refractory timers have run out; weights and theta stay."""
        self.exc.v, self.exc.ge, self.exc.gi, self.exc.timer = -65 * b2.mV, 0, 0, 1 * b2.second
        self.inh.v, self.inh.ge = -60 * b2.mV, 0
        self.exc.lastspike = self.inh.lastspike = -1e4 * b2.second
        if self.learn:
            self.synapses.xpre = 0
            if "post1" in self.synapses.variables:
                self.synapses.post1, self.synapses.post2 = 0, 0

    def _normalise(self) -> None:
        weights = self.weights
        self.synapses.w = (weights * (self.weight_sum / weights.sum(axis=0))).ravel()

    def _run(self) -> NDArray[np.int64]:
        """Run one presentation, input and then rest; returns the spike counts of the part with input."""
        before = np.array(self.monitor.count)
        self.net.run(self.steps * self.dt, namespace=self.namespace)
        counts = np.array(self.monitor.count) - before
        if isinstance(self.source, b2.PoissonGroup):
            self.source.rates = 0 * b2.Hz
        self.net.run(self.rest_steps * self.dt, namespace=self.namespace)
        return counts

    def present(self, rate_hz: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
        """Show an image with Poisson input of ``rate_hz`` (inputs,); spike counts (neurons,) and seconds it took."""
        start = time.perf_counter()
        if self.learn:
            self._normalise()
        self.source.rates = np.asarray(rate_hz) * b2.Hz
        counts = self._run()
        return counts, time.perf_counter() - start

    def present_spikes(self, when: NDArray[np.int64], sources: NDArray[np.int64]) -> tuple[NDArray[np.int64], float]:
        """Show an image from rest with these input spikes: their steps, ascending, and inputs."""
        start = time.perf_counter()
        if self.learn:
            self._normalise()
        self.reset()
        self.source.set_spikes(sources, when * self.dt + self.net.t, sorted=True)
        counts = self._run()
        return counts, time.perf_counter() - start


def _namespace(network: ConductanceNetwork, learning: ConductanceLearning) -> dict[str, Any]:
    """The constants that the equations refer to, by name."""
    return {
        "tau_ge": network.tau_ge_ms * b2.ms,
        "tau_gi": network.tau_gi_ms * b2.ms,
        "timer_rate": network.timer_rate,
        "eta_pre": learning.eta_pre,
        "eta_post": learning.eta_post,
        "x_target": learning.x_target,
        "mu": learning.mu,
        "w_max": learning.w_max,
        "theta_plus": learning.theta_plus_mv * b2.mV,
        "tau_theta": learning.tau_theta_ms * b2.ms,
    }


def _populations(namespace: dict[str, Any], neurons: int, learn: bool) -> tuple[Any, Any]:
    """The excitatory and the inhibitory neurons."""
    theta = "dtheta/dt = -theta / tau_theta : volt" if learn else "theta : volt"
    exc = b2.NeuronGroup(
        neurons,
        _EXC + theta,
        threshold="v > (theta - 20*mV - 52*mV) and timer > 5*ms",
        reset="v = -65*mV; timer = 0*ms" + ("; theta += theta_plus" if learn else ""),
        refractory=5 * b2.ms,
        method="euler",
        namespace=namespace,
    )
    inh = b2.NeuronGroup(
        neurons,
        _INH,
        threshold="v > -40*mV",
        reset="v = -45*mV",
        refractory=2 * b2.ms,
        method="euler",
        namespace=namespace,
    )
    return exc, inh


def _input_synapses(source: Any, exc: Any, namespace: dict[str, Any], rule: str) -> Any:
    """All-to-all input that learns by ``rule``, or not (``frozen``)."""
    model, on_pre, on_post = _RULES[rule]
    synapses = b2.Synapses(source, exc, model, on_pre=on_pre, on_post=on_post or None, namespace=namespace)
    synapses.connect()
    return synapses


def spare_collection() -> None:
    """Let Python's garbage collection pass over all that is alive now.

    Brian2's `Network.run` collects before each run, twice a presentation; in a process with as many objects as numba
    and this project bring, that takes longer than the network itself. VPRSNN's own process has few, so it is timed
    without.
    """
    gc.collect()
    gc.freeze()
