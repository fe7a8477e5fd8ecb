"""Answers: the matched place of each query and how sure that match is, from the scores of one matcher."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.certainty import best
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.matchers import confidence
from lava_vpr.matching.sequences import SequenceMatcher


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


@dataclass(frozen=True, eq=False)
class LookingBack:
    """The answers of a stream of queries, each matched with those before it; state goes in and out.

    ``state, answers = state.update(scores)``; start a new one where the stream is interrupted.

    Attributes:
        matcher: Name of the decoder or other matcher whose scores are given.
        windows: Adds up the scores of the last queries; None: each query is matched alone.
    """

    matcher: str
    windows: SequenceMatcher | None

    @classmethod
    def of(cls, matcher: str, n_places: int, sequence: int) -> LookingBack:
        """The state before the first query.

        Args:
            matcher: As the attribute.
            n_places: Number of places.
            sequence: Queries that are matched together; 1: each alone.
        Raises:
            InputError: the sequence has no length, or exceeds the places.
        """
        windows = SequenceMatcher(n_places, sequence)
        return cls(matcher, windows if sequence > 1 else None)

    def update(self, scores: Scores) -> tuple[LookingBack, Answers]:
        """Take the scores of the next queries.

        Args:
            scores: Scores of single queries (n, n_places), higher is better; how many come at a time changes no answer.
        Returns:
            The next state, and an answer for each of these queries; the first of the stream, whose sequence is not
            complete, have no match.
        Raises:
            InputError: the scores are not those of ``n_places`` places.
        """
        if self.windows is None:
            return self, answers_of(self.matcher, scores)
        windows, sums = self.windows.update(scores)
        ends = answers_of("sequence", sums)
        matches = np.full(len(scores), -1, np.int64)
        certainty = np.full(len(scores), -np.inf)
        begun = len(scores) - len(sums)
        matches[begun:] = np.where(ends.matches >= 0, ends.matches + windows.length - 1, -1)
        certainty[begun:] = ends.confidence
        return replace(self, windows=windows), Answers(matches, certainty)
