"""VPRSNN's conductance-based network, as released except for three changes: training with STDP, and frozen responses.

Excitatory neurons (potentials in mV, conductances without unit), Euler with ``dt_ms``::

    dV/dt  = ((-65 - V) + g_e (0 - V) + g_i (-100 - V)) / 100 ms, frozen for 5 ms after a spike
    spike if V > theta - 20 - 52 and its timer, which runs at ``timer_rate`` of real time, exceeds 5 ms
    then V = -65, timer = 0, theta += theta_plus (training); theta decays with ``tau_theta_ms`` (training)

Inhibitory neurons: rest -60, tau 10 ms, threshold -40, reset -45, refractory 2 ms. Input to exc all-to-all with delays;
exc to inh one-to-one, 10.4; inh to every exc but its own, 17. Input spikes read a weight when they *arrive*.

The three differences from the released code are on purpose: every presentation starts with membranes, conductances,
traces and spikes in flight at rest, and with timers run out (theta and weights persist), so that an answer depends on
its query alone; delays are drawn once and belong to the model; a presentation's counts are the spikes of its own steps
with input (the released code adds spikes during the rest to the counts of the *next* image).

Source: Hussaini, Milford, Fischer 2022 (doi 10.1109/LRA.2022.3149030) and the released VPRSNN code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.engine.conductance.kernels import (
    FROZEN,
    PAPER,
    TRIPLET,
    ConductanceDrive,
    Constants,
    normalise,
)
from lava_vpr.engine.conductance.run import present
from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.presentations import check_presentations, check_rates, share
from lava_vpr.engine.random import presentation_key, uniform
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.settings.conductance import ConductanceLearning, ConductanceNetwork

EXC_TAU_MS, INH_TAU_MS = 100.0, 10.0
EXC_REFRACTORY_MS, INH_REFRACTORY_MS = 5.0, 2.0
TRACE_TAUS_MS = (20.0, 20.0, 40.0)
"""Time constants of the traces pre, post1 and post2."""

START_WEIGHT = 0.3
RULES = {"triplet": TRIPLET, "paper": PAPER}


@dataclass
class ConductanceState:
    """The arrays that training changes and a model stores.

    Attributes:
        weights: float64 (inputs, neurons), in [0, w_max] except where normalisation exceeds that.
        theta_mv: Adaptive part of the thresholds in mV, float64 (neurons,).
        delays: Input delays in steps of ``dt_ms``, uint16 (inputs, neurons).
    """

    weights: NDArray[np.float64]
    theta_mv: NDArray[np.float64]
    delays: NDArray[np.uint16]


def _settings(config: Config) -> tuple[ConductanceNetwork, ConductanceLearning]:
    """Network and learning settings of a conductance model, checked for what Euler's method can integrate.

    Raises:
        ConfigError: another network, or a step too long for a time constant.
    """
    network, learning = config.network, config.learning
    if not isinstance(network, ConductanceNetwork) or not isinstance(learning, ConductanceLearning):
        raise ConfigError(f"preset {config.preset!r} has no conductance network; use the preset paper")
    shortest = min(network.tau_ge_ms, network.tau_gi_ms)
    if network.dt_ms >= shortest:
        raise ConfigError(
            f"network.dt_ms is {network.dt_ms}, but must be below the shortest time constant, {shortest} ms; lower it"
        )
    return network, learning


def _timer_steps(network: ConductanceNetwork) -> int:
    """Steps from a spike to the first one at which the timer exceeds 5 ms, added up in floats as the code does."""
    timer, limit, step, k = 0.0, EXC_REFRACTORY_MS * 1e-3, network.dt_ms * 1e-3 * network.timer_rate, 0
    while not timer > limit:
        timer += step
        k += 1
    return k


def constants(config: Config, *, learn: bool) -> Constants:
    """The kernels' constants; without ``learn`` theta neither decays nor grows."""
    network, learning = _settings(config)
    dt = network.dt_ms
    return Constants(
        steps=network.steps,
        total=network.steps + network.rest_steps,
        freeze=round(EXC_REFRACTORY_MS / dt),
        timer=_timer_steps(network),
        inh_freeze=round(INH_REFRACTORY_MS / dt),
        exc_leak=dt / EXC_TAU_MS,
        inh_leak=dt / INH_TAU_MS,
        ge_decay=dt / network.tau_ge_ms,
        gi_decay=dt / network.tau_gi_ms,
        theta_decay=dt / learning.tau_theta_ms if learn else 0.0,
        theta_plus=learning.theta_plus_mv if learn else 0.0,
        eta_pre=learning.eta_pre,
        eta_post=learning.eta_post,
        x_target=learning.x_target,
        mu=learning.mu,
        w_max=learning.w_max,
    )


@lru_cache(maxsize=4)
def trace_table(total: int, dt_ms: float) -> NDArray[np.float64]:
    """Value of each trace k steps after its spike, (3, total + 1)."""
    return np.array([[math.exp(-(k * dt_ms) / tau) for k in range(total + 1)] for tau in TRACE_TAUS_MS])


def initial_state(config: Config, inputs: int) -> ConductanceState:
    """The untrained network: weights 0.3 (U[0, 1) + 0.01), delays U(0, delay_max_ms) rounded to steps.

    Raises:
        ConfigError: the settings are no conductance network, or its delays do not fit 16 bits.
    """
    network, learning = _settings(config)
    shape = (inputs, network.neurons)
    longest = network.delay_max_ms / network.dt_ms
    if longest >= 65535:
        raise ConfigError(
            f"network.delay_max_ms is {longest:.0f} steps long, but at most 65534 fit; raise network.dt_ms"
        )
    start = uniform(presentation_key(config.seed, "start", 0), inputs * network.neurons)
    delay = uniform(presentation_key(config.seed, "delay", 0), inputs * network.neurons)
    return ConductanceState(
        weights=np.asfortranarray((START_WEIGHT * (start + 0.01)).reshape(shape)),  # as training needs and leaves them
        theta_mv=np.full(network.neurons, learning.theta_start_mv),
        delays=np.asfortranarray(np.floor(delay * longest + 0.5).astype(np.uint16).reshape(shape)),
    )


def _check(state: ConductanceState, inputs: int) -> None:
    """Refuse arrays that do not belong together.

    Raises:
        InputError: naming both sizes.
    """
    shape = state.weights.shape
    if state.delays.shape != shape or state.theta_mv.shape != shape[1:]:
        raise InputError(
            f"weights {shape}, delays {state.delays.shape} and thresholds {state.theta_mv.shape} are of different "
            "networks; use those of one model"
        )
    if inputs != shape[0]:
        raise InputError(
            f"rates have {inputs} inputs, but the network has {shape[0]}; encode with the model's settings"
        )
    if state.delays.dtype != np.uint16:
        raise InputError(f"delays of type {state.delays.dtype}, not uint16; use those of a model")


def _own(array: NDArray[np.generic], dtype: type, order: Literal["C", "F"] = "C") -> NDArray[Any]:
    """``array`` as the kernels are compiled for: writeable, of ``dtype`` and memory ``order``; copied only if needed.

    Weights and delays (inputs, neurons) are kept in order F: the kernels walk along the inputs of one neuron.
    """
    return np.require(array, dtype=dtype, requirements=[order, "W"])


def named_events(raw: NDArray[np.int64], neurons: int, n: int, c: Constants) -> dict[str, int]:
    """Event counts by name, summed over ``n`` presentations, the rest included."""
    operations, inputs, exc, inh = (int(x) for x in raw)
    return {
        "synaptic_operations": operations,
        "neuron_updates": 2 * neurons * c.total * n,
        "input_spikes": inputs,
        "exc_spikes": exc,
        "inh_spikes": inh,
        "messages": inputs + exc + inh,
        "steps": c.total * n,
    }


def train_presentation(
    state: ConductanceState, rates: NDArray[np.uint32], key: int, config: Config
) -> tuple[NDArray[np.int32], dict[str, int]]:
    """Show one image to the learning network; ``state`` is changed in place.

    First each neuron's weights are normalised to ``weight_sum``; then weights follow the rule, theta the spikes.

    Args:
        state: Weights, theta and delays.
        rates: Spike probabilities per step in units of 2^-32, uint32 (inputs,).
        key: The presentation's key (`lava_vpr.engine.random.presentation_key`).
        config: Settings with a conductance network.
    Returns:
        Spikes of each excitatory neuron in the steps with input, int32 (neurons,); events by name.
    Raises:
        ConfigError, InputError: settings or arrays of another network.
    """
    _, learning = _settings(config)
    _check(state, len(rates))
    check_rates(rates, np.uint32, (len(rates),))
    state.weights = _own(state.weights, np.float64, "F")
    state.theta_mv = _own(state.theta_mv, np.float64)
    state.delays = _own(state.delays, np.uint16, "F")
    normalise(state.weights.T, learning.weight_sum)
    counts, events = _presented(state, rates[None], np.array([key], np.uint64), config, RULES[learning.rule])
    return counts[0], events


def count_spikes(
    state: ConductanceState,
    rates: NDArray[np.uint32],
    keys: NDArray[np.uint64],
    config: Config,
    *,
    threads: int = 1,
) -> tuple[NDArray[np.int32], dict[str, int]]:
    """Show images to the frozen network; each starts from rest, so order, batches and threads change nothing.

    Args:
        state: Weights, theta and delays; not changed.
        rates: Spike probabilities per step in units of 2^-32, uint32 (n, inputs).
        keys: One key per image (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
        config: Settings with a conductance network.
        threads: Threads that share the images.
    Returns:
        Spikes of each excitatory neuron in the steps with input, int32 (n, neurons); events by name, summed.
    Raises:
        ConfigError, InputError: settings or arrays of another network.
    """
    _check(state, rates.shape[-1])
    check_presentations(rates, keys, np.uint32, rates.shape[-1])
    weights, delays = _own(state.weights, np.float64, "F"), _own(state.delays, np.uint16, "F")
    return _presented(ConductanceState(weights, state.theta_mv, delays), rates, keys, config, FROZEN, threads)


def _presented(
    state: ConductanceState,
    rates: NDArray[np.uint32],
    keys: NDArray[np.uint64],
    config: Config,
    rule: int,
    threads: int = 1,
) -> tuple[NDArray[np.int32], dict[str, int]]:
    """Counts (n, neurons) and events of images; unless ``rule`` is `FROZEN`, ``state`` learns from them."""
    (network, _), c, n = _settings(config), constants(config, learn=rule != FROZEN), len(rates)
    weights, delays, rates, keys = state.weights.T, state.delays.T, _own(rates, np.uint32), _own(keys, np.uint64)
    traces, longest = trace_table(c.total, network.dt_ms), int(delays.max(initial=0))
    counts = np.zeros((n, len(weights)), np.int32)

    def present_some(part: slice) -> NDArray[np.int64]:
        raw = np.zeros(4, np.int64)
        for q in range(part.start, part.stop):
            starts, sources = poisson_spikes(rates[q], keys[q], c.steps)
            when = np.repeat(np.arange(c.steps, dtype=np.int32), np.diff(starts))
            theta = np.array(state.theta_mv, np.float64) if rule == FROZEN else state.theta_mv
            present(ConductanceDrive(weights, delays, when, sources), theta, traces, rule, longest, c, counts[q], raw)
        return raw

    return counts, named_events(sum(share(present_some, n, threads), np.zeros(4, np.int64)), len(weights), n, c)
