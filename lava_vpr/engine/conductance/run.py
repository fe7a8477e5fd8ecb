"""One presentation of the conductance network, compiled, from `engine.conductance.kernels` and `plastic`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.conductance.kernels import (
    E_OFFSET,
    E_RESET,
    E_REST,
    E_THRESHOLD,
    EXC_TO_INH,
    FROZEN,
    I_RESET,
    I_REST,
    I_THRESHOLD,
    INH_TO_EXC,
    NEVER,
    TRIPLET,
    ConductanceDrive,
    Constants,
    Plastic,
    arrive,
    calm,
    input_drive,
    learn,
    new_plastic,
    recruit,
    update_exc,
    with_room,
)
from lava_vpr.kernelcache import compiled

_CHUNK_STEPS = 256  # steps for which input is summed ahead: the sums of 400 neurons then fit the second-level cache
_CALM_CHECK_STEPS = 32
_PLASTIC_SLOTS = 16
_RECENT, _AWAKE, _PLASTIC, _EXC_SPIKES, _INH_SPIKES = range(5)
"""Names of the counters in ``tally``."""


class Exc(NamedTuple):
    """The states of the excitatory neurons, each (neurons,).

    Attributes:
        v, ge, gi, theta: Membrane, conductances and adaptive threshold.
        block: Infinite while the refractory timer runs, else 0.
        last: Step of the last spike, or NEVER.
        recent: The neurons whose timer runs.
        slot: Index among the plastic neurons, or -1.
    """

    v: NDArray[np.float64]
    ge: NDArray[np.float64]
    gi: NDArray[np.float64]
    theta: NDArray[np.float64]
    block: NDArray[np.float64]
    last: NDArray[np.int64]
    recent: NDArray[np.int64]
    slot: NDArray[np.int64]


class Inh(NamedTuple):
    """The states of the inhibitory neurons, each (neurons,).

    ``awake`` lists those that ever received a spike, as flagged in ``woken``.
    """

    v: NDArray[np.float64]
    ge: NDArray[np.float64]
    last: NDArray[np.int64]
    awake: NDArray[np.int64]
    woken: NDArray[np.uint8]


@compiled(nogil=True)
def _release(exc: Exc, tally: NDArray[np.int64], step: int, timer: int) -> None:
    """Allow neurons whose timer has run out to fire again."""
    kept = 0
    for r in range(tally[_RECENT]):
        i = exc.recent[r]
        if step - exc.last[i] >= timer:
            exc.block[i] = 0.0
        else:
            exc.recent[kept] = i
            kept += 1
    tally[_RECENT] = kept


@compiled(nogil=True)
def _update_inh(inh: Inh, gi: NDArray[np.float64], tally: NDArray[np.int64], step: int, c: Constants) -> None:
    """Take one Euler step of the awake inhibitory neurons; each spike raises ``gi`` of all other neurons."""
    for r in range(tally[_AWAKE]):
        i = inh.awake[r]
        active = step - inh.last[i] >= c.inh_freeze
        v, ge = inh.v[i], inh.ge[i]
        if active:
            v += c.inh_leak * ((I_REST - v) + ge * (0.0 - v))
        inh.ge[i] = ge - c.ge_decay * ge
        if active and v > I_THRESHOLD:
            tally[_INH_SPIKES] += 1
            v = I_RESET
            inh.last[i] = step
            for m in range(gi.size):
                gi[m] += INH_TO_EXC if m != i else 0.0
        inh.v[i] = v


@compiled(nogil=True)
def _fire(exc: Exc, inh: Inh, i: int, step: int, tally: NDArray[np.int64], theta_plus: float) -> None:
    """Neuron ``i`` spikes: reset, refractory timer, theta, and its inhibitory neuron."""
    exc.v[i] = E_RESET
    exc.theta[i] += theta_plus
    exc.block[i] = np.inf
    exc.last[i] = step
    exc.recent[tally[_RECENT]] = i
    tally[_RECENT] += 1
    tally[_EXC_SPIKES] += 1
    inh.ge[i] += EXC_TO_INH
    if not inh.woken[i]:
        inh.woken[i] = 1
        inh.awake[tally[_AWAKE]] = i
        tally[_AWAKE] += 1


@compiled(nogil=True)
def _recruit(
    plastic: Plastic, exc: Exc, i: int, step: int, net: ConductanceDrive, tally: NDArray[np.int64], total: int
) -> Plastic:
    """Give neuron ``i`` a slot among the plastic ones, unless it has one."""
    if exc.slot[i] < 0:
        exc.slot[i] = tally[_PLASTIC]
        tally[_PLASTIC] += 1
        plastic = with_room(plastic, exc.slot[i])
        recruit(plastic, exc.slot[i], i, step, net, total)
    return plastic


@compiled(nogil=True)
def _recruit_clipped(
    plastic: Plastic, exc: Exc, net: ConductanceDrive, tally: NDArray[np.int64], c: Constants
) -> Plastic:
    """Neurons with a weight outside [0, w_max] are plastic from the start: under the triplet rule arrivals clip it."""
    before = NEVER
    for i in range(exc.v.size):
        if net.weights[i].max() > c.w_max or net.weights[i].min() < 0.0:
            plastic = _recruit(plastic, exc, i, before, net, tally, c.total)
    return plastic


@compiled(nogil=True)
def _undelivered(net: ConductanceDrive, longest: int, total: int) -> int:
    """Number of synaptic arrivals that would come after the end of the presentation."""
    lost = 0
    for p in range(np.searchsorted(net.when, total - longest), net.when.size):
        for i in range(net.delays.shape[0]):
            lost += net.when[p] + np.int64(net.delays[i, net.sources[p]]) >= total
    return lost


@compiled(nogil=True)
def _arrivals(
    plastic: Plastic,
    exc: Exc,
    n: int,
    step: int,
    weights: NDArray[np.float64],
    trace: NDArray[np.float64],
    rule: int,
    c: Constants,
    row: NDArray[np.float64],
) -> None:
    """Recompute the input sums in ``row`` of the ``n`` plastic neurons with their current weights."""
    for s in range(n):
        i = plastic.neuron[s]
        change = -1.0
        if rule == TRIPLET:
            change = c.eta_pre * trace[step - exc.last[i]] if exc.last[i] != NEVER else 0.0
        row[i] = arrive(plastic, s, step, weights, change, c.w_max)


@compiled(nogil=True)
def _calm(exc: Exc, inh: Inh, c: Constants) -> bool:
    """Whether nothing will spike any more before the next input."""
    none = np.zeros(inh.v.size)
    return calm(inh.v, inh.ge, none, none[:0], c.inh_leak, c, I_REST, I_THRESHOLD) and calm(
        exc.v, exc.ge, exc.gi, exc.theta, c.exc_leak, c, E_REST, E_THRESHOLD - E_OFFSET
    )


@compiled(nogil=True)
def _decay_theta(theta: NDArray[np.float64], steps: int, decay: float) -> None:
    """Decay theta over steps that need no simulation; theta is the only state that outlasts a presentation."""
    for _ in range(steps if decay > 0.0 else 0):
        for i in range(theta.size):
            theta[i] -= decay * theta[i]


@compiled(nogil=True)
def _at_rest(n: int, theta: NDArray[np.float64]) -> tuple[Exc, Inh]:
    """Bring both populations to rest, ready to fire."""
    exc = Exc(
        np.full(n, E_REST), np.zeros(n), np.zeros(n), theta, np.zeros(n),
        np.full(n, NEVER), np.empty(n, np.int64), np.full(n, -1),
    )  # fmt: skip
    return exc, Inh(np.full(n, I_REST), np.zeros(n), np.full(n, NEVER), np.empty(n, np.int64), np.zeros(n, np.uint8))


@compiled(nogil=True)
def present(
    net: ConductanceDrive,
    theta: NDArray[np.float64],
    traces: NDArray[np.float64],
    rule: int,
    longest: int,
    c: Constants,
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
) -> None:
    """Run one presentation from rest.

    Args:
        net: Network and input spikes; the weights change in place unless ``rule`` is FROZEN.
        theta: Adaptive thresholds (neurons,), changed in place.
        traces: What is left of the traces pre, post1 and post2 after k steps, (3, total + 1).
        rule: FROZEN, TRIPLET or PAPER. With FROZEN, ``c.theta_decay`` and ``c.theta_plus`` must be 0.
        longest: The longest delay.
        c: The settings.
        counts: Gets the spikes in the steps with input, (neurons,).
        events: Synaptic operations, input, exc and inh spikes are added, (4,).
    """
    n, n_inputs = net.weights.shape
    exc, inh = _at_rest(n, theta)
    tally = np.zeros(5, np.int64)
    plastic = new_plastic(_PLASTIC_SLOTS, n_inputs, net.sources.size if rule != FROZEN else 0)
    if rule == TRIPLET:
        plastic = _recruit_clipped(plastic, exc, net, tally, c)
    drive, carry = np.empty((_CHUNK_STEPS, n)), np.zeros((n, longest))
    for step in range(c.total):
        if step % _CHUNK_STEPS == 0:
            input_drive(net, step, carry, drive)
        row = drive[step % _CHUNK_STEPS]
        _arrivals(plastic, exc, tally[_PLASTIC], step, net.weights, traces[1], rule, c, row)
        _release(exc, tally, step, c.timer)
        above = update_exc(exc.v, exc.ge, exc.gi, exc.theta, row, c, exc.block)
        for r in range(tally[_RECENT]):
            if step - exc.last[exc.recent[r]] < c.freeze:
                exc.v[exc.recent[r]] = E_RESET
        _update_inh(inh, exc.gi, tally, step, c)
        for i in range(n if above > 0 else 0):
            if exc.v[i] > ((exc.theta[i] - E_OFFSET) + E_THRESHOLD) + exc.block[i]:
                if rule != FROZEN:
                    plastic = _recruit(plastic, exc, i, step, net, tally, c.total)
                    post2 = traces[2, step - exc.last[i]] if exc.last[i] != NEVER else 0.0
                    learn(net.weights[i], plastic.arrived[exc.slot[i]], step, traces[0], post2, rule, c)
                _fire(exc, inh, i, step, tally, c.theta_plus)
                counts[i] += step < c.steps
        if step >= c.steps + longest and step % _CALM_CHECK_STEPS == 0 and _calm(exc, inh, c):
            _decay_theta(theta, c.total - step - 1, c.theta_decay)
            break
    delivered = net.sources.size * n - _undelivered(net, longest, c.total)
    events[0] += delivered + tally[_EXC_SPIKES] + tally[_INH_SPIKES] * (n - 1)
    events[1] += net.sources.size
    events[2] += tally[_EXC_SPIKES]
    events[3] += tally[_INH_SPIKES]
