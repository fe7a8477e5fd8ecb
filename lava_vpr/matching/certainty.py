"""The best place of a query, and how sure a matcher is of it.

Defined answers: a query without any score (no spike, or none that tells places apart) matches no place: `best` is -1,
and its confidence is -inf. Equal scores go to the lowest place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.equations import Scores, first_most

Confidence = Callable[[Scores], Scores]
"""A function from scores (n_queries, n_places) with a score in every row to how sure the best one is, float64
(n_queries,)."""


@dataclass(frozen=True)
class Matcher:
    """Something that scores the places for a query.

    Attributes:
        name: How options, settings and files call it.
        title: How reports call it.
        confidence: The function of this module that says how sure its best match is.
    """

    name: str
    title: str
    confidence: Confidence

    def confidences(self, scores: Scores) -> Scores:
        """How sure each query's best match is; higher is surer, and only the order within one matcher means anything.

        Args:
            scores: Scores (n_queries, n_places).
        Returns:
            float64 (n_queries,); -inf where nothing matches (`best` is -1).
        """
        return np.where(scores.any(axis=1), self.confidence(scores), -np.inf)


def best(scores: Scores) -> NDArray[np.int64]:
    """The best place of each query.

    Args:
        scores: Scores (n_queries, n_places), higher is better; distances negated.
    Returns:
        int64 (n_queries,): the lowest of the places with the highest score; -1, no match, where all scores are 0.
    """
    return first_most(scores)


def highest(scores: Scores) -> Scores:
    """The best score of each query."""
    return np.asarray(scores.max(axis=1))


def margin(scores: Scores) -> Scores:
    """The best score of each query minus its second."""
    first, second = _top_two(scores)
    return first - second


def contrast(scores: Scores) -> Scores:
    """The margin over sqrt(best + second + 1): the difference of two counts over the deviation it has by chance."""
    first, second = _top_two(scores)
    return (first - second) / np.sqrt(first + second + 1.0)


def _top_two(scores: Scores) -> tuple[Scores, Scores]:
    """Highest and second highest score of each query, equal ones counted twice; the second of one place is 0."""
    if scores.shape[1] == 1:
        return scores[:, 0], np.zeros(len(scores))
    top = np.partition(scores, scores.shape[1] - 2, axis=1)[:, -2:]
    return top[:, 1], top[:, 0]
