"""Recruiting: after the last epoch, neurons without a place learn the places without a neuron.

In winner-take-all competition two neurons can take turns at one place while a third neuron holds two. About every
second network of 100 neurons for 100 places ends with a place that has no neuron. Thresholds cannot repair this: of two
neurons that share a place, both have learned that place, and a threshold low enough for another place would let every
place through. So the host shows each place without a neuron again, and raises the thresholds of all neurons that have a
place so high that they cannot spike. Rule and network are those of the second phase. The host knows which image it
shows and counts the spikes; it writes thresholds between presentations, as it does for homeostasis.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import StdpLearning
from lava_vpr.engine.random import derived_key


class Thresholds(NamedTuple):
    """The thresholds of a learning network, and their range.

    Attributes:
        theta: Thresholds of the neurons, (neurons,); a view, so writing to it changes the network.
        start: The threshold at the start of learning.
        highest: A threshold that no membrane exceeds in practice.
    """

    theta: NDArray[Any]
    start: float
    highest: float


def rounds(learning: StdpLearning) -> int:
    """How often places without a neuron are shown again: the number of epochs of the second phase; 0: never."""
    return learning.epochs - learning.competing if learning.recruit else 0


def key_again(key: int, times: int) -> int:
    """The presentation key of an image's ``times``-th repetition in the epoch in which its key is ``key``."""
    return derived_key(key, f"again {times}") if times else key


def unpaired(counts: NDArray[Any]) -> tuple[list[int], list[int]]:
    """Places without a neuron and neurons without a place.

    A neuron prefers the place for which it spikes most, the first of equal ones. Of the neurons that prefer a place the
    one that spikes most gets it; the others, and silent neurons, have no place.

    Args:
        counts: Spikes of every neuron for every place, (places, neurons).
    """
    best = np.where(counts.any(axis=0), counts.argmax(axis=0), -1)
    own = np.where(best == np.arange(len(counts))[:, None], counts, -1)
    taken = own.max(axis=1) >= 0
    free = np.setdiff1d(np.arange(counts.shape[1]), own.argmax(axis=1)[taken])
    return np.flatnonzero(~taken).tolist(), free.tolist()


def recruit(
    thresholds: Thresholds, counts: NDArray[Any], again: int, show: Callable[[int, int], NDArray[Any] | None]
) -> bool:
    """Show each place without a neuron ``again`` times to the neurons without a place; False if stopped.

    At the first presentation all of these neurons may spike. The one that spikes most, the first of equal ones, gets
    the place, and only it may spike in later presentations. If none spikes, the place stays without a neuron.
    Thresholds are restored at the end.

    Args:
        thresholds: Thresholds of the learning network.
        counts: Spikes in the last epoch, (places, neurons).
        again: Number of presentations of each place.
        show: Function of a place and the number of its repetition; returns the spikes, (neurons,), or None if stopped.
    """
    places, free = unpaired(counts) if again else ([], [])
    theta, before = thresholds.theta, thresholds.theta.copy()
    for place in places:
        if not free:
            break
        candidates = free
        for times in range(1, again + 1):
            theta[:] = thresholds.highest
            theta[candidates] = thresholds.start
            spikes = show(place, times)
            if spikes is None:
                return False
            if times == 1:
                if not spikes[free].any():
                    break
                candidates = [free[int(np.argmax(spikes[free]))]]
        else:
            free = [neuron for neuron in free if neuron not in candidates]
    theta[:] = before
    return True
