"""Compiled drawing of Poisson input spikes, four steps at a time; equal to `lava_vpr.engine.random.draws`."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.random import GOLDEN, mix
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.kernelcache import compiled

LANES = 4
_ZERO, _ONE, _S2, _S3, _S32, _S56 = (np.uint64(x) for x in (0, 1, 2, 3, 32, 56))
_BYTE_INDEX = np.uint64(0x0001020304050607)

if sys.byteorder != "little":  # the kernel reads the four 16-bit draws of a hash in memory order
    raise BackendUnavailableError("the host engine needs a little-endian processor; run it on x86-64 or ARM")


@compiled()
def scratch(
    inputs: int,
) -> tuple[
    NDArray[np.int32],
    NDArray[np.uint64],
    NDArray[np.uint16],
    NDArray[np.uint64],
    NDArray[np.uint8],
    NDArray[np.int32],
    NDArray[np.int32],
    NDArray[np.int64],
]:
    """Arrays that `prepare_draws` (the first three) and `draw_block` work in, for one presentation after another."""
    return (
        np.empty(inputs + 1, np.int32),  # active inputs
        np.empty(inputs + 1, np.uint64),  # start of their counters
        np.empty(LANES * (inputs + 1), np.uint16),  # their rates, once a lane
        np.empty(inputs + 1, np.uint64),  # hashes
        np.empty((LANES * (inputs + 1) + 7) // 8 * 8, np.uint8),  # which draws are below their rate
        np.empty(inputs // 2 + 2, np.int32),  # words of that mask with any set
        np.empty((LANES, inputs + 1), np.int32),  # spiking inputs of each lane
        np.zeros(LANES, np.int64),  # how many
    )


@compiled(inline="always")
def prepare_draws(
    rates: NDArray[np.uint16],
    key: np.uint64,
    active: NDArray[np.int32],
    offsets: NDArray[np.uint64],
    rates4: NDArray[np.uint16],
) -> int:
    """List the inputs with a rate, the start of their counters, and their rate once per lane; returns how many.

    Padded to an even number with an input that never spikes, so that the mask splits into whole 64-bit words.
    """
    n = 0
    for j in range(rates.size):
        if rates[j] > 0:
            active[n] = j
            offsets[n] = key + GOLDEN * np.uint64(j)
            for lane in range(LANES):
                rates4[LANES * n + lane] = rates[j]
            n += 1
    if n % 2 == 1:
        active[n] = 0
        offsets[n] = key
        for lane in range(LANES):
            rates4[LANES * n + lane] = 0
        n += 1
    return n


@compiled(inline="always")
def draw_block(
    block: int,
    n: int,
    active: NDArray[np.int32],
    offsets: NDArray[np.uint64],
    rates4: NDArray[np.uint16],
    words: NDArray[np.uint64],
    mask: NDArray[np.uint8],
    occupied: NDArray[np.int32],
    spikes: NDArray[np.int32],
    counts: NDArray[np.int64],
) -> None:
    """Draw steps 4 ``block`` .. 4 ``block`` + 3: lane l's spiking inputs, ascending, in ``spikes[l, :counts[l]]``."""
    start = GOLDEN * (np.uint64(block) << _S32)
    for k in range(n):
        words[k] = mix(offsets[k] + start)
    lanes = words.view(np.uint16)
    for k in range(LANES * n):
        mask[k] = lanes[k] < rates4[k]
    pairs = mask.view(np.uint64)
    for lane in range(LANES):
        counts[lane] = 0
    # Two passes without unpredictable branches: where the mask is set at all, then which of its bytes.
    n_set = np.uint64(0)  # unsigned indices spare the compiler numpy's wrap-around of negative ones
    for p in range(np.uint64(n // 2)):
        occupied[n_set] = np.int32(p)
        n_set += np.uint64(pairs[p] != _ZERO)
    for m in range(n_set):
        pair = np.uint64(occupied[m])
        flags = pairs[pair]
        while flags != _ZERO:
            # The lowest set byte b of a word of 0/1 bytes is 1 << 8b; this product carries b in its top byte.
            lowest = flags & (~flags + _ONE)
            k = (pair << _S3) + ((lowest * _BYTE_INDEX) >> _S56)
            flags ^= lowest
            lane = k & _S3
            spikes[lane, np.uint64(counts[lane])] = active[k >> _S2]
            counts[lane] += 1
