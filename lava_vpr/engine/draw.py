"""Compiled drawing of Poisson input spikes, a hash at a time; equal to `lava_vpr.engine.random.draws`."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.random import GOLDEN, mix
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.kernelcache import compiled

_ZERO, _ONE, _S3, _S32, _S56 = (np.uint64(x) for x in (0, 1, 3, 32, 56))
_BYTE_INDEX = np.uint64(0x0001020304050607)

if sys.byteorder != "little":  # the kernel reads the draws of a hash in memory order
    raise BackendUnavailableError("the host engine needs a little-endian processor; run it on x86-64 or ARM")


@compiled(inline="always")
def _draw(
    lanes: int,
    flags: NDArray[np.uint8],
    occupied: NDArray[np.int32],
    active: NDArray[np.int32],
    spikes: NDArray[np.int32],
    counts: NDArray[np.int64],
) -> None:
    """List the active inputs with a flag by lanes: those of lane l, ascending, in ``spikes[l, :counts[l]]``."""
    groups, counts[:] = flags.view(np.uint64), 0
    last, shift = np.uint64(lanes - 1), np.uint64(lanes // 2)
    # Two passes without unpredictable branches: find the words with a bit set, then the bytes in them.
    n_set = np.uint64(0)  # unsigned indices spare the compiler numpy's wrap-around of negative ones
    for p in range(groups.size):
        occupied[n_set] = np.int32(p)
        n_set += np.uint64(groups[p] != _ZERO)
    for m in range(n_set):
        group = np.uint64(occupied[m])
        left = groups[group]
        while left != _ZERO:
            # The lowest set byte b of a word of 0/1 bytes is 1 << 8b; this product carries b in its top byte.
            lowest = left & (~left + _ONE)
            k = (group << _S3) + ((lowest * _BYTE_INDEX) >> _S56)
            left ^= lowest
            lane = k & last
            spikes[lane, np.uint64(counts[lane])] = active[k >> shift]
            counts[lane] += 1


@compiled()
def poisson_spikes(rates: NDArray[Any], key: np.uint64, steps: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The Poisson spikes of one presentation: those of step t are ``members[starts[t]:starts[t + 1]]``, ascending.

    A hash holds a draw for each of four steps, its lanes, with rates of 16 bits; for two with rates of 32.

    Args:
        rates: Spike probabilities, uint16 (inputs,) in units of 2^-16, or uint32 in units of 2^-32.
        key: Key of the presentation.
        steps: Steps with input.
    """
    lanes = 4 if rates.dtype.type(1 << 16) == 0 else 2  # of either type, decided at compile time
    listed, n = np.empty(rates.size, np.int32), np.uint64(0)
    for j in range(rates.size):
        if rates[j] > 0:
            listed[n] = j
            n += _ONE
    active = listed[:n]
    # Padded with inputs that never spike, so that the flags of all lanes make whole 64-bit words.
    width = -(-active.size // rates.itemsize) * rates.itemsize
    offsets, limits = np.zeros(width, np.uint64), np.zeros(lanes * width, rates.dtype)
    for k in range(active.size):
        offsets[k] = key + GOLDEN * np.uint64(active[k])
        for lane in range(lanes):
            limits[lanes * k + lane] = rates[active[k]]
    words, flags = np.empty(width, np.uint64), np.empty(limits.size, np.uint8)
    occupied, counts = np.empty(flags.size // 8 + 1, np.int32), np.zeros(lanes, np.int64)
    spikes = np.empty((lanes, active.size), np.int32)
    starts, members = np.zeros(steps + 1, np.int64), np.empty(2 * flags.size + 64, np.int32)
    drawn = words.view(rates.dtype)
    for first in range(0, steps, lanes):
        start = GOLDEN * (np.uint64(first // lanes) << _S32)
        for k in range(width):
            words[k] = mix(offsets[k] + start)
        for k in range(flags.size):
            flags[k] = drawn[k] < limits[k]
        _draw(lanes, flags, occupied, active, spikes, counts)
        if members.size < starts[first] + flags.size:
            members = np.concatenate((members, np.empty_like(members)))
        for lane in range(min(lanes, steps - first)):
            begin, end = starts[first + lane], starts[first + lane] + counts[lane]
            members[begin:end] = spikes[lane, : counts[lane]]
            starts[first + lane + 1] = end
    return starts, members[: starts[steps]]
