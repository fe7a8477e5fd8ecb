"""The compiled kernel of `lava_vpr.engine.inference.fixed`: all presentations of a network, spike by spike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.draw import draw_block, prepare_draws, scratch
from lava_vpr.engine.inference.bias_input import schedule
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY, INPUT_SHIFT, STATE_LIMIT


class KernelNumbers(NamedTuple):
    """The numbers of a `FixedNetwork` as the kernel reads them.

    ``threshold`` is in units of v, ``lateral`` in units of the shifted input sum, ``keep`` what a membrane keeps in
    units of 2^-12. ``steps`` are those with input, ``total`` also those without. ``chunk`` is how many rows of weights
    fit an 8-bit partial sum.
    """

    shift: np.int32
    threshold: np.int32
    lateral: np.int32
    keep: np.int32
    steps: int
    total: int
    chunk: int
    bias_input: bool


@compiled(inline="always")
def integrate(v: NDArray[np.int32], drive: NDArray[np.int32], shift: np.int32, keep: np.int32) -> np.int32:
    """Take one membrane step of all neurons from ``drive`` >> ``shift``; returns the highest membrane.

    sign(v) (|v| keep >> 12) stays within 32 bits because |v| = 4096 h + l: h keep + (l keep >> 12).
    """
    top, span, low = np.int32(STATE_LIMIT), np.int32(2 * STATE_LIMIT), np.int32(DECAY_UNITY - 1)
    decay_bits, input_shift = np.int32(DECAY_BITS), np.int32(INPUT_SHIFT)
    ceiling, bottom = np.int32(STATE_LIMIT - 1), np.int32(1 - STATE_LIMIT)
    highest = bottom
    for i in range(v.size):
        u = np.int32(np.int32(np.int32(drive[i]) >> shift) << input_shift)
        u = np.int32(u - span) if u > top else u
        u = np.int32(u + span) if u <= -top else u
        x = v[i]
        sign = np.int32(x >> np.int32(31))
        size = np.int32(np.int32(x ^ sign) - sign)
        size = np.int32(
            np.int32(np.int32(size >> decay_bits) * keep)
            + np.int32(np.int32(np.int32(size & low) * keep) >> decay_bits)
        )
        x = np.int32(np.int32(np.int32(size ^ sign) - sign) + u)
        x = ceiling if x > ceiling else x
        x = bottom if x < bottom else x
        v[i] = x
        highest = x if x > highest else highest
    return highest


@compiled(inline="always")
def _add_rows(
    weights: NDArray[np.uint8],
    row_sizes: NDArray[np.int64],
    chunk: int,
    inputs: NDArray[np.int32],
    n: int,
    partial: NDArray[np.uint8],
    acc: NDArray[np.int32],
) -> int:
    """Sum the weights of the ``n`` first ``inputs`` in ``acc``; returns how many of them are not 0.

    Rows are added up in 8 bits (``partial``, scratch) for as long as no sum can overflow, then in ``acc``.
    """
    operations = 0
    acc[:] = 0
    for start in range(0, n, chunk):
        partial[:] = 0
        for s in range(start, min(start + chunk, n)):
            row = np.uint64(inputs[s])
            operations += row_sizes[row]
            for i in range(acc.size):
                partial[i] += weights[row, i]
        for i in range(acc.size):
            acc[i] += partial[i]
    return operations


@compiled(nogil=True)
def present(
    weights: NDArray[np.uint8],
    row_sizes: NDArray[np.int64],
    numbers: KernelNumbers,
    rates: NDArray[np.uint16],
    bias: NDArray[np.int32],
    keys: NDArray[np.uint64],
    acc: NDArray[np.int32],
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
    raster: NDArray[np.uint8],
) -> None:
    """Present every image of ``rates`` to the network.

    Args:
        weights, row_sizes, numbers: The network, `lava_vpr.engine.inference.fixed.FixedNetwork.prepared`.
        rates: Spike probabilities in units of 2^-16, uint16 (n, inputs).
        bias: Stands for ``rates`` if inputs integrate a bias, int32 (n, inputs).
        keys: One key per presentation, uint64 (n,).
        acc: Scratch (width,), int16 where no input sum can leave it, else int32.
        counts: Filled, int32 (n, neurons).
        events: Filled: synaptic operations, input spikes, excitatory spikes.
        raster: Filled if not empty, uint8 (n, total, neurons).
    """
    shift, threshold, lateral, keep = numbers.shift, numbers.threshold, numbers.lateral, numbers.keep
    steps, chunk, bias_input = numbers.steps, numbers.chunk, numbers.bias_input
    nothing, no_members = np.zeros(0, np.int64), np.zeros(0, np.int32)
    (inputs, width), neurons = weights.shape, counts.shape[1]
    partial = np.zeros(width, np.uint8)
    active, offsets, rates4, words, mask, occupied, spikes, spike_counts = scratch(inputs)
    drive = np.zeros(width, np.int32)
    v = np.zeros(width, np.int32)
    fired = np.zeros((3, neurons), np.int32)
    n_fired = np.zeros(3, np.int64)
    operations, input_spikes, exc_spikes = 0, 0, 0
    for q in range(rates.shape[0]):
        if bias_input:
            starts, members = schedule(bias[q], keys[q], steps)
            n = 0
        else:
            starts, members = nothing, no_members
            n = prepare_draws(rates[q], keys[q], active, offsets, rates4)
        v[:] = 0
        n_fired[:] = 0
        # Input drawn at step t reaches the neurons at their step t + 1.
        for step in range(1, numbers.total):
            # 1. The input spikes of the step before: from the schedule, or drawn for four steps at a time.
            lane = (step - 1) & 3
            if step > steps:
                spike_counts[lane] = 0
            elif bias_input:
                begin, spike_counts[lane] = starts[step - 1], starts[step] - starts[step - 1]
                for s in range(spike_counts[lane]):
                    spikes[lane, s] = members[begin + s]
            elif lane == 0:
                draw_block((step - 1) >> 2, n, active, offsets, rates4, words, mask, occupied, spikes, spike_counts)
            # 2. What they bring: sums of weights.
            operations += _add_rows(weights, row_sizes, chunk, spikes[lane], spike_counts[lane], partial, acc)
            input_spikes += spike_counts[lane]
            # 3. All membranes, less what the spikes of two steps ago take from the others; then this step's spikes.
            now, before = step % 3, (step + 1) % 3  # (step - 2) mod 3
            if n_fired[before] == 0:
                highest = integrate(v, acc, shift, keep)
            else:
                pull = np.int32(lateral * np.int32(n_fired[before]))
                for i in range(width):
                    drive[i] = np.int32(np.int32(np.int32(acc[i]) >> shift) - pull)
                for s in range(n_fired[before]):
                    drive[fired[before, s]] += lateral
                highest = integrate(v, drive, np.int32(0), keep)
            n_fired[now] = 0
            if highest > threshold:
                for i in range(neurons):
                    if v[i] > threshold:
                        v[i] = 0
                        fired[now, n_fired[now]] = i
                        n_fired[now] += 1
                        counts[q, i] += 1
                        if raster.size > 0:
                            raster[q, step, i] = 1
                exc_spikes += n_fired[now]
    events[0], events[1], events[2] = operations, input_spikes, exc_spikes
