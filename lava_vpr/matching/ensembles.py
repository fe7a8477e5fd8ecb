"""Ensembles: members that learned the same places with other seeds, or in another order, answer together.

The score of a place is the sum of its scores by all members (Hussaini, Milford and Fischer, "Applications of spiking
neural networks in visual place recognition", T-RO 2024, doi 10.1109/TRO.2024.3508053).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching.equations import Scores


def in_order(scores: Scores, order: NDArray[np.int64]) -> Scores:
    """Scores of a member that learned the places in another order, in the places' own order.

    Args:
        scores: The member's scores, float64 (n, places): column k is the place that it learned as its k-th.
        order: Which place that was, int64 (places,), each place once.
    Returns:
        float64 (n, places): column l is place l.
    Raises:
        InputError: the order does not hold every place once.
    """
    if scores.ndim != 2 or not np.array_equal(np.sort(order), np.arange(scores.shape[1])):
        raise InputError(f"the order of {len(order)} places does not fit scores {scores.shape}; name each place once")
    found = np.empty_like(scores)
    found[:, order] = scores
    return found


def together(members: Sequence[Scores]) -> Scores:
    """The sum of the scores of all members, added in the order given, float64 (n, places).

    Args:
        members: Scores of each member, all of the same queries and places, in the places' own order.
    Raises:
        InputError: no member, or members of different shapes.
    """
    if not members or any(scores.shape != members[0].shape for scores in members):
        shapes = ", ".join(str(scores.shape) for scores in members) or "none"
        raise InputError(f"the members of an ensemble have scores of shapes {shapes}; give one shape, at least once")
    total = np.zeros(members[0].shape)
    for scores in members:
        total += scores
    return total
