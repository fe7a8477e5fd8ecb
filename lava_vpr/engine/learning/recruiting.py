"""Recruiting: places that no neuron has made its own are learned, at the end, by neurons that have none.

Winners take all, so that two neurons can share a place, in turns, while a third holds two: of two networks of 100
neurons for 100 places, about one leaves a place without. Thresholds cannot mend that: what the idle one of the two has
learned is its own place, and a threshold that let another place through would let all through. So after the last epoch
the host shows such places again, and lets nobody else spike: it raises all other thresholds as high as they go. The
rule and the network are those of the second phase; the host, which knows which image it shows and counts the spikes,
writes thresholds between presentations, as it does for homeostasis.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import StdpLearning
from lava_vpr.engine.random import derived_key


class Thresholds(NamedTuple):
    """The thresholds of a network that learns.

    Attributes:
        theta: Those of its neurons, (neurons,), live: what is written is what it learns with.
        start: The threshold at the start of learning.
        highest: One that no membrane of the network's range exceeds in practice.
    """

    theta: NDArray[Any]
    start: float
    highest: float


def rounds(learning: StdpLearning) -> int:
    """How often places without a neuron are shown again: as often as the second phase shows all; 0: never."""
    return learning.epochs - learning.competing if learning.recruit else 0


def key_again(key: int, times: int) -> int:
    """The key of an image that is shown for the ``times``-th time more in the epoch with the presentation ``key``."""
    return derived_key(key, f"again {times}") if times else key


def unpaired(counts: NDArray[Any]) -> tuple[list[int], list[int]]:
    """Places without a neuron and neurons without a place.

    A neuron's place is the one that it spikes most for, the first of equal ones. The neuron of a place is, of those
    whose place it is, the one that spikes most; all others, and silent ones, have none.

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
    """Show places without a neuron ``again`` times to neurons without a place; False if that was stopped.

    The first time all of these may spike; the one that spikes most then is the place's, and alone may go on. Of equal
    ones it is the first; where none spikes, the place stays without. Thresholds are put back at the end.

    Args:
        thresholds: Of the network, which learns.
        counts: Spikes in the last epoch, (places, neurons).
        again: Number of times.
        show: Shows the network a place, for the so-many-th time more, and returns its spikes (neurons,); None: stopped.
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
