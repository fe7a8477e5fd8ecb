"""Loops over events: a window is gathered; pixels rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

NEVER = -(1 << 62)
"""The time of the last event of a pixel that has had none, microseconds."""


@compiled(nogil=True)
def gather(
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    begin: int,
    stop: int,
    quota: int,
    refractory: int,
    hot: NDArray[np.bool_],
    last: NDArray[np.int64],
    counts: NDArray[np.uint32],
    seen: NDArray[np.int64],
    totals: NDArray[np.int64],
) -> int:
    """Count events into ``counts`` until one comes at ``stop`` or ``quota`` of them are kept.

    Args:
        t, x, y: The events, each (n,), microseconds and pixels.
        begin: The first event that is taken.
        stop: Microseconds; events from there on are left.
        quota: Events that may still be kept.
        refractory: An event that comes less than so many microseconds after the last one kept of its pixel is left out.
        hot: Pixels whose events are left out, (h, w).
        last: Time of the last event kept of each pixel, (h, w); written.
        counts: Events of each pixel in the window, (h, w); written.
        seen: Events of each pixel, whatever becomes of them, (h, w); added to.
        totals: Events kept, of hot pixels, and too soon, (3,); added to.
    Returns:
        The first event that was not taken.
    """
    i, kept, of_hot, soon = begin, 0, 0, 0
    while i < len(t) and t[i] < stop and kept < quota:
        row, column = y[i], x[i]
        seen[row, column] += 1
        if hot[row, column]:
            of_hot += 1
        elif t[i] - last[row, column] < refractory:
            soon += 1
        else:
            last[row, column] = t[i]
            counts[row, column] += np.uint32(1)
            kept += 1
        i += 1
    totals[0] += kept
    totals[1] += of_hot
    totals[2] += soon
    return i


@compiled(nogil=True)
def rest(
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    refractory: int,
    last: NDArray[np.int64],
    keep: NDArray[np.bool_],
) -> None:
    """Say which events come ``refractory`` microseconds or more after the last one kept of their pixel.

    Args:
        t, x, y: The events, each (n,), microseconds and pixels.
        refractory: Microseconds.
        last: Time of the last event kept of each pixel, (h, w); written.
        keep: Whether an event is kept, (n,); written.
    """
    for i in range(len(t)):
        keep[i] = t[i] - last[y[i], x[i]] >= refractory
        if keep[i]:
            last[y[i], x[i]] = t[i]
