"""The literal model of float arithmetic: VPRSNN's conductance network.

Used by engine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.random import draws


@dataclass
class Slow:
    """What `slow_presentation` returns."""

    counts: NDArray[np.int64]
    weights: NDArray[np.float64]
    theta: NDArray[np.float64]
    operations: int = 0
    inputs: int = 0
    exc: int = 0
    inh: int = 0


def slow_presentation(
    state: ConductanceState, rates: NDArray[np.uint32], key: int, config: Config, learn: bool
) -> Slow:
    """One presentation, every synapse and every step spelt out, in the order of Brian2's schedule."""
    net, rule = config.network, config.learning
    dt, total = net.dt_ms, net.steps + net.rest_steps
    w, theta = [list(row) for row in state.weights], list(state.theta_mv)
    n_in, n = state.weights.shape
    exc, inh = range(n), range(n)
    if learn:
        for i in exc:
            factor = sum(w[j][i] for j in range(n_in))
            factor = rule.weight_sum / factor if factor > 0 else 1.0
            for j in range(n_in):
                w[j][i] *= factor
    spikes = draws(key, net.steps, n_in, bits=32) < rates
    arriving: list[list[list[int]]] = [[[] for _ in exc] for _ in range(total + int(state.delays.max()))]
    for departure, j in np.argwhere(spikes):
        for i in exc:
            arriving[departure + int(state.delays[j, i])][i].append(j)
    v, ge, gi = [-65.0] * n, [0.0] * n, [0.0] * n
    vi, gei = [-60.0] * n, [0.0] * n
    timer, last, last_inh = [1.0] * n, [-(10**9)] * n, [-(10**9)] * n
    arrived: list[list[int | None]] = [[None] * n for _ in range(n_in)]
    post: list[int | None] = [None] * n
    out = Slow(np.zeros(n, np.int64), state.weights, state.theta_mv, inputs=int(spikes.sum()))

    def trace(since: int | None, now: int, tau: float) -> float:
        return 0.0 if since is None else math.exp(-((now - since) * dt) / tau)

    def clip(x: float) -> float:
        return min(max(x, 0.0), rule.w_max)

    for t in range(total):
        for i in exc:  # states, from the values of the step before
            if t - last[i] >= round(5.0 / dt):
                v[i] += (dt / 100.0) * ((-65.0 - v[i]) + ge[i] * (0.0 - v[i]) + gi[i] * (-100.0 - v[i]))
            ge[i] -= (dt / net.tau_ge_ms) * ge[i]
            gi[i] -= (dt / net.tau_gi_ms) * gi[i]
            timer[i] += dt * 1e-3 * net.timer_rate
            if learn:
                theta[i] -= (dt / rule.tau_theta_ms) * theta[i]
        for i in inh:
            if t - last_inh[i] >= round(2.0 / dt):
                vi[i] += (dt / 10.0) * ((-60.0 - vi[i]) + gei[i] * (0.0 - vi[i]))
            gei[i] -= (dt / net.tau_ge_ms) * gei[i]
        # thresholds
        fired = [i for i in exc if v[i] > ((theta[i] - 20.0) + -52.0) and timer[i] > 5e-3]
        relayed = [i for i in inh if vi[i] > -40.0 and t - last_inh[i] >= round(2.0 / dt)]
        # synapses: input arrivals in the order of departure; the weight is read before it changes
        for i in exc:
            drive = 0.0
            for j in arriving[t][i]:
                drive += w[j][i]
                out.operations += 1
                arrived[j][i] = t
                if learn and rule.rule == "triplet":
                    w[j][i] = clip(w[j][i] + rule.eta_pre * trace(post[i], t, 20.0))
            ge[i] += drive
        for i in fired:
            gei[i] += 10.4
            out.operations += 1
        for m in relayed:
            for i in exc:
                if i != m:
                    gi[i] += 17.0
                    out.operations += 1
        if learn:
            for i in fired:
                for j in range(n_in):
                    x = trace(arrived[j][i], t, 20.0)
                    if rule.rule == "triplet":
                        w[j][i] = clip(w[j][i] + rule.eta_post * x * trace(post[i], t, 40.0))
                    else:
                        up = math.pow(max(rule.w_max - w[j][i], 0.0), rule.mu)
                        w[j][i] = clip(w[j][i] + rule.eta_post * (x - rule.x_target) * up)
        # resets
        for i in fired:
            v[i], timer[i], last[i], post[i] = -65.0, 0.0, t, t
            theta[i] += rule.theta_plus_mv if learn else 0.0
            out.counts[i] += t < net.steps
        for i in relayed:
            vi[i], last_inh[i] = -45.0, t
        out.exc += len(fired)
        out.inh += len(relayed)
    out.weights, out.theta = np.array(w), np.array(theta)
    return out
