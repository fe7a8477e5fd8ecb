"""The compiled kernel of `lava_vpr.engine.inference.fixed`: all presentations of a network, spike by spike."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import schedule
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY, INPUT_SHIFT, STATE_LIMIT

TOGETHER = 8
"""Rows of weights that are added up at a time, in the weights' own type."""

_PADDING = 32


class KernelNumbers(NamedTuple):
    """The numbers of a `FixedNetwork` as the kernel reads them.

    ``threshold`` is in units of v, ``lateral`` in units of the input sum, ``keep`` what a membrane keeps in units of
    2^-12. ``steps`` are those with input, ``total`` also those without; ``input_delay`` and ``inhibition_delay`` are in
    steps. A leaf listens to ``leaf`` neurons (0: there are none). Inputs spike regularly or by Poisson draws;
    ``rising`` and ``rise`` are the network's.
    """

    threshold: np.int32
    lateral: np.int32
    keep: np.int32
    steps: int
    total: int
    input_delay: int
    inhibition_delay: int
    leaf: int
    regular: bool
    rising: int = 0
    rise: np.int32 = np.int32(0)


def laid_out(weights: NDArray[np.int16]) -> NDArray[Any]:
    """Weights (inputs, neurons) in the layout of `present`, (inputs + 1, width).

    Their type is the narrowest that holds the sum of any `TOGETHER` of them. Silent neurons pad them to whole vector
    registers, and a row of zeros ends them.
    """
    inputs, neurons = weights.shape
    most = TOGETHER * int(np.abs(weights).max(initial=0))
    made = np.zeros((inputs + 1, -(-neurons // _PADDING) * _PADDING), np.int8 if most <= 127 else np.int16)
    made[:-1, :neurons] = weights
    return made


@compiled(inline="always")
def kept(v: np.int32, keep: np.int32) -> np.int32:
    """sign(v) (|v| keep >> 12) within 32 bits: v = 4096 h + l makes it h keep + (l keep >> 12), rounded towards 0."""
    low, bits = np.int32(DECAY_UNITY - 1), np.int32(DECAY_BITS)
    rest = np.int32(np.int32(np.int32(v & low) * keep) + np.int32(np.int32(v >> np.int32(31)) & low))
    return np.int32(np.int32(np.int32(v >> bits) * keep) + np.int32(rest >> bits))


@compiled(inline="always")
def integrate(
    v: NDArray[np.int32],
    drive: NDArray[Any],
    bias: NDArray[np.int32],
    pull: np.int32,
    keep: np.int32,
    bounded: bool,
) -> np.int32:
    """Take one membrane step of all neurons from ``drive`` - ``pull`` and ``bias``; returns the highest membrane.

    ``bounded`` says that no current can wrap and no membrane be clipped, so neither is checked.
    """
    top, span, input_shift = np.int32(STATE_LIMIT), np.int32(2 * STATE_LIMIT), np.int32(INPUT_SHIFT)
    ceiling, bottom = np.int32(STATE_LIMIT - 1), np.int32(1 - STATE_LIMIT)
    highest = bottom
    if bounded:
        for i in range(v.size):
            u = np.int32(np.int32(np.int32(drive[i]) - pull) << input_shift)
            x = np.int32(np.int32(kept(v[i], keep) + u) + bias[i])
            v[i] = x
            highest = x if x > highest else highest
        return highest
    for i in range(v.size):
        u = np.int32(np.int32(np.int32(drive[i]) - pull) << input_shift)
        u = np.int32(u - span) if u > top else u
        u = np.int32(u + span) if u <= -top else u
        x = np.int32(np.int32(kept(v[i], keep) + u) + bias[i])
        x = ceiling if x > ceiling else x
        x = bottom if x < bottom else x
        v[i] = x
        highest = x if x > highest else highest
    return highest


@compiled(inline="always")
def _row(inputs: NDArray[np.int32], s: int, last: int) -> np.uint64:
    """The row of the ``s``-th of ``inputs``, or beyond their end the ``last`` one."""
    return np.uint64(inputs[s] if s < inputs.size else last)


@compiled(inline="always")
def add_rows(weights: NDArray[Any], row_sizes: NDArray[np.int64], inputs: NDArray[np.int32], acc: NDArray[Any]) -> int:
    """Sum the weights of ``inputs`` in ``acc``, `TOGETHER` rows at a time; returns how many of them are not 0."""
    operations, last, narrow = 0, weights.shape[0] - 1, weights.dtype.type
    acc[:] = 0
    for s in range(inputs.size):
        operations += row_sizes[np.uint64(inputs[s])]
    for s in range(0, inputs.size, TOGETHER):
        a, b = _row(inputs, s, last), _row(inputs, s + 1, last)
        c, d = _row(inputs, s + 2, last), _row(inputs, s + 3, last)
        e, f = _row(inputs, s + 4, last), _row(inputs, s + 5, last)
        g, h = _row(inputs, s + 6, last), _row(inputs, s + 7, last)
        for i in range(acc.size):
            half = weights[a, i] + weights[b, i] + weights[c, i] + weights[d, i]
            acc[i] += narrow(half + weights[e, i] + weights[f, i] + weights[g, i] + weights[h, i])
    return operations


@compiled(nogil=True)
def add_weighted(weights: NDArray[Any], rates: NDArray[np.uint16], acc: NDArray[Any], sums: NDArray[np.int64]) -> None:
    """Sum the weights of all inputs, each times its rate; inputs with rate 0 cost nothing.

    Args:
        weights: `laid_out`.
        rates: uint16 (n, inputs).
        acc: Scratch (width,): int32 where no sum of a neuron's weights can leave 16 bits, else int64.
        sums: Filled, int64 (n, neurons).
    """
    wide, last = acc.dtype.type, weights.shape[0] - 1
    factors = np.zeros(weights.shape[0], np.uint16)
    for q in range(rates.shape[0]):
        factors[:last] = rates[q]
        active = np.flatnonzero(factors).astype(np.int32)
        acc[:] = 0
        for s in range(0, active.size, 4):
            a, b = _row(active, s, last), _row(active, s + 1, last)
            c, d = _row(active, s + 2, last), _row(active, s + 3, last)
            w, x, y, z = wide(factors[a]), wide(factors[b]), wide(factors[c]), wide(factors[d])
            for i in range(acc.size):
                half = wide(weights[a, i]) * w + wide(weights[b, i]) * x
                acc[i] += wide(half + wide(weights[c, i]) * y + wide(weights[d, i]) * z)
        sums[q] = acc[: sums.shape[1]]


@compiled(inline="always")
def fire(
    v: NDArray[np.int32], threshold: np.int32, leaf: int, counts: NDArray[np.int32], row: NDArray[np.uint8]
) -> tuple[int, int]:
    """Let all neurons above ``threshold`` spike; returns how many, and how many leaves hear any of them.

    Args:
        v: Membranes, padded; those that spike go to 0.
        threshold: In units of v.
        leaf: Neurons that a leaf listens to, or 0.
        counts: Spikes of each neuron, raised, int32 (neurons,).
        row: The raster's row of this step, filled, uint8 (neurons,) or empty.
    """
    fired, leaves, last = 0, 0, -1
    for i in range(counts.size):
        if v[i] > threshold:
            v[i] = 0
            counts[i] += 1
            fired += 1
            if row.size > 0:
                row[i] = 1
            if leaf > 0 and i // leaf != last:
                last = i // leaf
                leaves += 1
    return fired, leaves


@compiled(nogil=True)
def present(
    weights: NDArray[Any],
    row_sizes: NDArray[np.int64],
    numbers: KernelNumbers,
    bounded: bool,
    rates: NDArray[np.uint16],
    slopes: NDArray[np.int32],
    keys: NDArray[np.uint64],
    bias: NDArray[np.int32],
    acc: NDArray[np.int32],
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
    raster: NDArray[np.uint8],
) -> None:
    """Present every image of ``rates`` to the network.

    Args:
        weights, row_sizes, numbers: The network, `lava_vpr.engine.inference.fixed.FixedNetwork.prepared`.
        bounded: `lava_vpr.engine.inference.fixed.FixedNetwork.bounded` of ``bias``.
        rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
        slopes: The bias of every rate, int32 (65536,), where inputs spike regularly; else empty.
        keys: One key per presentation, uint64 (n,).
        bias: Biases of the neurons in units of v, int32 (n, neurons), or (1, neurons) for all presentations.
        acc: Scratch (width,), int16 where no input sum can leave it, else int32.
        counts: Filled, int32 (n, neurons).
        events: Filled: synaptic operations of the inputs, spikes of inputs, exc, leaves and root.
        raster: Filled if not empty, uint8 (n, total, neurons).
    """
    threshold, lateral, keep, steps = numbers.threshold, numbers.lateral, numbers.keep, numbers.steps
    no_members, no_row = np.zeros(0, np.int32), np.zeros(0, np.uint8)
    width, neurons = weights.shape[1], counts.shape[1]
    v, own, input_bias = np.zeros(width, np.int32), np.zeros(width, np.int32), np.zeros(rates.shape[1], np.int32)
    volleys = np.zeros(numbers.total + numbers.inhibition_delay, np.bool_)  # the steps in which the root inhibits
    operations, input_spikes, exc_spikes, leaf_spikes, root_spikes = 0, 0, 0, 0, 0
    for q in range(rates.shape[0]):
        if numbers.regular:
            for j in range(input_bias.size):
                input_bias[j] = slopes[rates[q, j]]
            starts, members = schedule(input_bias, keys[q], steps)
        else:
            starts, members = poisson_spikes(rates[q], keys[q], steps)
        if q == 0 or bias.shape[0] > 1:
            own[:neurons] = bias[q]
        v[:] = own  # step 0: nothing but the bias has arrived
        volleys[:] = False
        for step in range(1, numbers.total):
            # 1. The input spikes that arrive, and the sums of their weights.
            sent = step - numbers.input_delay
            arriving = members[starts[sent] : starts[sent + 1]] if 0 <= sent < steps else no_members
            operations += add_rows(weights, row_sizes, arriving, acc)
            input_spikes += arriving.size
            # 2. All membranes with the root's inhibition; then this step's spikes.
            pull = lateral if volleys[step] else np.int32(0)
            if integrate(v, acc, own, pull, keep, bounded) > threshold:
                row = raster[q, step] if raster.size > 0 else no_row
                fired, leaves = fire(v, threshold, numbers.leaf, counts[q], row)
                volleys[step + numbers.inhibition_delay] = fired > 0
                exc_spikes += fired
                leaf_spikes += leaves
                root_spikes += fired > 0
    events[0], events[1], events[2] = operations, input_spikes, exc_spikes
    events[3], events[4] = leaf_spikes, root_spikes
