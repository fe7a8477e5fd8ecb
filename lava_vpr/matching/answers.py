"""Answers: the matched place of each query and how sure that match is, from the scores of one matcher."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.certainty import best
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.matchers import confidence
from lava_vpr.matching.sequences import causal_sequence_scores


class Answers(NamedTuple):
    """What a matcher says of every query.

    Attributes:
        matches: The matched place of each query, -1 for none, int64 (n,).
        confidence: Confidence of those matches, float64 (n,); -inf where nothing matches.
    """

    matches: NDArray[np.int64]
    confidence: NDArray[np.float64]


def answers_of(matcher: str, scores: Scores) -> Answers:
    """The best place of each query.

    Args:
        matcher: Name of the decoder or other matcher whose scores these are.
        scores: Scores (n_queries, n_places), higher is better.
    """
    return Answers(best(scores), confidence(matcher, scores))


def answers_looking_back(matcher: str, scores: Scores, sequence: int) -> Answers:
    """The best place of each query, matched together with the ``sequence - 1`` queries before it.

    Args:
        matcher: Name of the decoder or other matcher whose scores these are.
        scores: Scores of single queries (n_queries, n_places), higher is better.
        sequence: Queries that are matched together; 1: each alone.
    Returns:
        An answer for each query; the first ``sequence - 1`` have no match.
    Raises:
        InputError: the sequence exceeds the queries or the places.
    """
    if sequence == 1:
        return answers_of(matcher, scores)
    ends = answers_of("sequence", causal_sequence_scores(scores, sequence))
    matches = np.full(len(scores), -1, np.int64)
    certainty = np.full(len(scores), -np.inf)
    matches[sequence - 1 :] = np.where(ends.matches >= 0, ends.matches + sequence - 1, -1)
    certainty[sequence - 1 :] = ends.confidence
    return Answers(matches, certainty)
