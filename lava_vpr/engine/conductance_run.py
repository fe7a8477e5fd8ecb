"""One presentation of the conductance network, compiled from the parts in `lava_vpr.engine.conductance_kernels`."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.conductance_kernels import (
    CALM_CHECK_STEPS,
    E_RESET,
    E_REST,
    E_THRESHOLD,
    E_OFFSET,
    EXC_TO_INH,
    FROZEN,
    I_RESET,
    I_REST,
    I_THRESHOLD,
    INH_TO_EXC,
    NEVER,
    TRIPLET,
    Constants,
    _arrive,
    _calm,
    _depart,
    _learn,
    _schedule,
    _update_exc,
    draw_spikes,
)

_PLASTIC_START = 16


class Exc(NamedTuple):
    """Excitatory states, each (neurons,); ``recent`` lists the neurons whose refractory timer runs."""

    v: NDArray[np.float64]
    ge: NDArray[np.float64]
    gi: NDArray[np.float64]
    theta: NDArray[np.float64]
    block: NDArray[np.float64]
    last: NDArray[np.int64]
    recent: NDArray[np.int32]


class Inh(NamedTuple):
    """Inhibitory states, each (neurons,); ``awake`` lists those that ever received a spike, as flagged in ``woken``."""

    v: NDArray[np.float64]
    ge: NDArray[np.float64]
    last: NDArray[np.int64]
    awake: NDArray[np.int32]
    woken: NDArray[np.uint8]


class Plastic(NamedTuple):
    """The neurons whose weights can change, one slot each, with the input still to arrive (`_schedule`)."""

    neuron: NDArray[np.int64]
    cursor: NDArray[np.int64]
    arrived: NDArray[np.int64]
    times: NDArray[np.int32]
    inputs: NDArray[np.int32]


@nb.njit(cache=True, nogil=True)
def _plastic(slots: int, inputs: int, spikes: int) -> Plastic:
    """Room for ``slots`` plastic neurons."""
    return Plastic(
        np.zeros(slots, np.int64),
        np.zeros(slots, np.int64),
        np.empty((slots, inputs), np.int64),
        np.empty((slots, spikes), np.int32),
        np.empty((slots, spikes), np.int32),
    )


@nb.njit(cache=True, nogil=True)
def _with_room(old: Plastic, n: int) -> Plastic:
    """``old`` with at least one slot after its first ``n``."""
    if n < old.neuron.size:
        return old
    new = _plastic(2 * n, old.arrived.shape[1], old.times.shape[1])
    new.neuron[:n] = old.neuron[:n]
    new.cursor[:n] = old.cursor[:n]
    new.arrived[:n] = old.arrived[:n]
    new.times[:n] = old.times[:n]
    new.inputs[:n] = old.inputs[:n]
    return new


@nb.njit(cache=True, nogil=True)
def _outside(weights: NDArray[np.float64], w_max: float) -> NDArray[np.uint8]:
    """Which neurons have a weight outside [0, w_max], that the first arriving spike of the triplet rule clips."""
    flags = np.zeros(weights.shape[1], np.uint8)
    for j in range(weights.shape[0]):
        for i in range(weights.shape[1]):
            flags[i] |= np.uint8(weights[j, i] > w_max) | np.uint8(weights[j, i] < 0.0)
    return flags


@nb.njit(cache=True, nogil=True)
def _release(exc: Exc, n_recent: int, step: int, timer: int) -> int:
    """Let neurons fire again whose timer has run out; returns how many timers still run."""
    kept = 0
    for r in range(n_recent):
        i = exc.recent[r]
        if step - exc.last[i] >= timer:
            exc.block[i] = 0.0
        else:
            exc.recent[kept] = i
            kept += 1
    return kept


@nb.njit(cache=True, nogil=True)
def _update_inh(inh: Inh, n_awake: int, step: int, c: Constants, gi: NDArray[np.float64]) -> int:
    """One Euler step of the awake inhibitory neurons; their spikes raise ``gi`` of all others. Returns the spikes."""
    spikes = 0
    for r in range(n_awake):
        i = inh.awake[r]
        active = step - inh.last[i] >= c.inh_freeze
        v, ge = inh.v[i], inh.ge[i]
        if active:
            v += c.inh_leak * ((I_REST - v) + ge * (0.0 - v))
        inh.ge[i] = ge - c.ge_decay * ge
        if active and v > I_THRESHOLD:
            spikes += 1
            v = I_RESET
            inh.last[i] = step
            for m in range(i):
                gi[m] += INH_TO_EXC
            for m in range(i + 1, gi.size):
                gi[m] += INH_TO_EXC
        inh.v[i] = v
    return spikes


@nb.njit(cache=True, nogil=True)
def _find_spikes(exc: Exc, spiking: NDArray[np.int32]) -> int:
    """List the neurons above threshold, ascending, in ``spiking``; returns how many."""
    n = 0
    for i in range(exc.v.size):
        if exc.v[i] > ((exc.theta[i] - E_OFFSET) + E_THRESHOLD) + exc.block[i]:
            spiking[n] = i
            n += 1
    return n


@nb.njit(cache=True, nogil=True)
def _excite(exc: Exc, inh: Inh, n_awake: int, spiking: NDArray[np.int32]) -> int:
    """Spikes reach their inhibitory neurons; returns how many of those are awake now."""
    for s in range(spiking.size):
        i = spiking[s]
        inh.ge[i] += EXC_TO_INH
        if not inh.woken[i]:
            inh.woken[i] = 1
            inh.awake[n_awake] = i
            n_awake += 1
    return n_awake


@nb.njit(cache=True, nogil=True)
def _undelivered(delays: NDArray[np.uint16], starts: NDArray[np.int64], sources: NDArray[np.int32], total: int) -> int:
    """Input spikes times synapses that the presentation ends before."""
    lost = 0
    for t in range(max(0, total - 65536), starts.size - 1):
        for p in range(starts[t], starts[t + 1]):
            for i in range(delays.shape[1]):
                lost += t + np.int64(delays[sources[p], i]) >= total
    return lost


@nb.njit(cache=True, nogil=True)
def present(
    weights: NDArray[np.float64],
    delays: NDArray[np.uint16],
    theta: NDArray[np.float64],
    starts: NDArray[np.int64],
    sources: NDArray[np.int32],
    traces: NDArray[np.float64],
    rule: int,
    longest: int,
    c: Constants,
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
) -> None:
    """Run one presentation from rest.

    ``traces`` (3, total + 1): what is left of the traces pre, post1 and post2 after k steps. ``rule``: FROZEN (nothing
    changes; ``c.theta_decay`` and ``c.theta_plus`` are 0), TRIPLET or PAPER (``weights`` and ``theta`` change in place).
    ``longest``: the longest delay. Fills ``counts`` with the spikes of the steps with input; adds to ``events``:
    synaptic operations, input spikes, exc and inh spikes.
    """
    n_inputs, n = weights.shape
    shift, rows = 0, 1
    while (1 << shift) < n:
        shift += 1
    while rows <= longest:
        rows *= 2
    ring = np.zeros(rows << shift)
    exc = Exc(
        np.full(n, E_REST), np.zeros(n), np.zeros(n), theta, np.zeros(n), np.full(n, NEVER), np.empty(n, np.int32)
    )
    inh = Inh(np.full(n, I_REST), np.zeros(n), np.full(n, NEVER), np.empty(n, np.int32), np.zeros(n, np.uint8))
    n_recent, n_awake, n_plastic, exc_spikes, inh_spikes = 0, 0, 0, 0, 0
    plastic = _plastic(_PLASTIC_START if rule != FROZEN else 0, n_inputs, sources.size if rule != FROZEN else 0)
    slot = np.full(n, -1)
    spiking = np.empty(n, np.int32)
    nothing = np.zeros(n)
    if rule == TRIPLET:
        outside = _outside(weights, c.w_max)
        for i in range(n):
            if outside[i]:
                plastic = _with_room(plastic, n_plastic)
                slot[i], plastic.neuron[n_plastic], plastic.cursor[n_plastic] = n_plastic, i, 0
                _schedule(
                    i, -1, delays, starts, sources, c.total,
                    plastic.arrived[n_plastic], plastic.times[n_plastic], plastic.inputs[n_plastic],
                )
                n_plastic += 1
    step = 0
    while step < c.total:
        if step < c.steps:
            _depart(sources[starts[step] : starts[step + 1]], step, weights, delays, shift, ring)
        begin = (step << shift) & (ring.size - 1)
        row = ring[begin : begin + n]
        for s in range(n_plastic):
            i = plastic.neuron[s]
            change = c.eta_pre * traces[1, step - exc.last[i]] if exc.last[i] != NEVER else 0.0
            row[i], plastic.cursor[s] = _arrive(
                i, step, plastic.cursor[s], plastic.times[s], plastic.inputs[s], plastic.arrived[s],
                weights, change, rule == TRIPLET, c.w_max,
            )
        n_recent = _release(exc, n_recent, step, c.timer)
        above = _update_exc(exc.v, exc.ge, exc.gi, exc.theta, exc.block, row, c)
        for r in range(n_recent):
            if step - exc.last[exc.recent[r]] < c.freeze:
                exc.v[exc.recent[r]] = E_RESET
        inh_spikes += _update_inh(inh, n_awake, step, c, exc.gi)
        if above > 0:
            found = _find_spikes(exc, spiking)
            exc_spikes += found
            n_awake = _excite(exc, inh, n_awake, spiking[:found])
            for s in range(found):
                i = np.int64(spiking[s])
                if rule != FROZEN:
                    if slot[i] < 0:
                        plastic = _with_room(plastic, n_plastic)
                        slot[i], plastic.neuron[n_plastic], plastic.cursor[n_plastic] = n_plastic, i, 0
                        _schedule(
                            i, step, delays, starts, sources, c.total,
                            plastic.arrived[n_plastic], plastic.times[n_plastic], plastic.inputs[n_plastic],
                        )
                        n_plastic += 1
                    post2 = traces[2, step - exc.last[i]] if exc.last[i] != NEVER else 0.0
                    _learn(i, step, plastic.arrived[slot[i]], weights, traces[0], post2, rule, c)
                    exc.theta[i] += c.theta_plus
                exc.v[i] = E_RESET
                exc.block[i] = np.inf
                exc.last[i] = step
                exc.recent[n_recent] = i
                n_recent += 1
                counts[i] += step < c.steps
        step += 1
        if step >= c.steps + longest and step % CALM_CHECK_STEPS == 0 and step < c.total:
            if _calm(inh.v, inh.ge, nothing, nothing[:0], c.inh_leak, c, I_REST, I_THRESHOLD) and _calm(
                exc.v, exc.ge, exc.gi, exc.theta, c.exc_leak, c, E_REST, E_THRESHOLD - E_OFFSET
            ):
                break
    # Nothing spikes any more: of what is kept, only theta still changes.
    if c.theta_decay > 0:
        for _ in range(step, c.total):
            for i in range(n):
                exc.theta[i] -= c.theta_decay * exc.theta[i]
    events[0] += sources.size * n - _undelivered(delays, starts, sources, c.total) + exc_spikes + inh_spikes * (n - 1)
    events[1] += sources.size
    events[2] += exc_spikes
    events[3] += inh_spikes


@nb.njit(cache=True, nogil=True)
def present_frozen(
    weights: NDArray[np.float64],
    delays: NDArray[np.uint16],
    theta: NDArray[np.float64],
    rates: NDArray[np.uint32],
    keys: NDArray[np.uint64],
    traces: NDArray[np.float64],
    longest: int,
    c: Constants,
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
) -> None:
    """`present` for each row of ``rates`` (n, inputs), nothing learned; fills ``counts`` (n, neurons)."""
    for q in range(rates.shape[0]):
        starts, sources = draw_spikes(rates[q], keys[q], c.steps)
        present(weights, delays, theta.copy(), starts, sources, traces, FROZEN, longest, c, counts[q], events)
