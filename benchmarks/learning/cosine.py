"""Cosine of the network's inputs with the same help: means taken off, the running mean of queries, and gains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.results.rows import TAU
from lava_vpr.config import LifNetwork
from lava_vpr.engine.gains import PRIOR
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.evaluation import Metrics, evaluate

Floats = NDArray[np.float64]


def cosines(
    truth: NDArray[np.bool_], config: LifNetwork, references: Floats, queries: Floats, learning: bool
) -> Metrics:
    """Recall of cosine of the network's inputs with the same help: less what all references share, or the references
    around, and less the running mean of the queries before; and with gains that its own answers teach, those with at
    least the median margin so far, in floating point."""
    own, reach = references - references.mean(axis=0), config.surroundings
    if reach:
        index = np.arange(len(own))
        near = (np.abs(index[:, None] - index) <= reach) & (index[:, None] != index)
        own = own - near @ own / near.sum(axis=1, keepdims=True)
    mean, variance = references.mean(axis=0), (own**2).mean(axis=0)
    prior, sums, gains = PRIOR * variance, np.zeros((3, own.shape[1])), np.ones(own.shape[1])
    scores, margins = np.zeros((len(queries), len(own))), []
    for i, query in enumerate(queries):
        seen = query - mean
        norms = np.sqrt((own**2 @ gains) * (seen**2 @ gains))
        scores[i] = (own * gains) @ seen / np.maximum(norms, 1e-12)
        second, first = np.sort(scores[i])[-2:]
        margins.append(first - second)
        if learning and margins[-1] >= np.median(margins):
            matched = own[scores[i].argmax()]
            sums += (matched**2, seen**2, matched * seen)
            sizes = np.sqrt((sums[0] + prior) * (sums[1] + prior))
            gains = np.maximum((sums[2] + prior) / np.maximum(sizes, 1e-12), 0)
        mean = mean + (query - mean) / TAU
    return evaluate(scores, confidence("cosine", scores), truth)
