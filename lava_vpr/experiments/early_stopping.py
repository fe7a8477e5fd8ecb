"""Early stopping of a query: as soon as the best place leads the second by a margin, the rest of the steps is spared.

Whoever stops must read the counts and decode after every step, which would be the work of the board's embedded
processors. Energy and time are those of the steps that were run and of what is done between two queries; reading and
decoding after every step is not in them. No backend stops
early yet: this is what it would bring.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.model import Model, decode

MARGINS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Leads, in the default decoder's scores (``contrast``: spikes), that a sweep tries."""


def leads(model: Model, total: NDArray[np.int32]) -> NDArray[np.float64]:
    """Best minus second score after each step, float64 (n, steps).

    Args:
        model: With at least two places.
        total: Spikes up to each step, (n, steps, neurons).
    """
    name = model.config.decoder.default
    lead = np.zeros(total.shape[:2])
    for step in range(total.shape[1]):
        scores = decode(model, np.ascontiguousarray(total[:, step]), name)
        top = np.partition(scores, scores.shape[1] - 2, axis=1)
        lead[:, step] = top[:, -1] - top[:, -2]
    return lead


def stops(lead: NDArray[np.float64], margin: float) -> NDArray[np.int64]:
    """Steps that each query is run, int64 (n,): to the first whose lead is above ``margin``; all if there is none."""
    decided = lead > margin
    return np.where(decided.any(axis=1), decided.argmax(axis=1) + 1, lead.shape[1]).astype(np.int64)
