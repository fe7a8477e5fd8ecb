"""Answers: the matched place of each query, how sure that match is, and how likely it is right."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.matching.certainty import best
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.forward_filter import NONE, Belief, ForwardFilter, check_motion
from lava_vpr.matching.matchers import confidence
from lava_vpr.matching.probability import Calibration, check_precision
from lava_vpr.matching.sequences import SequenceMatcher


class Candidates(NamedTuple):
    """The best places of every query, best first.

    Attributes:
        places: int64 (n, k); -1 where a query matches none.
        scores: Their scores, or the sum over a sequence, float64 (n, k).
        probability: How likely the query is at that very place, float64 (n, k). By itself only the best place's is
            known; NaN where it is not.
    """

    places: NDArray[np.int64]
    scores: NDArray[np.float64]
    probability: NDArray[np.float64]


class Answers(NamedTuple):
    """What a matcher says of every query.

    Attributes:
        matches: The matched place of each query, -1 for none, int64 (n,).
        confidence: Confidence of those matches, float64 (n,); -inf where nothing matches.
        probability: How likely the query is there (within `forward_filter.RADIUS` places, if it was filtered), float64
            (n,); NaN where that was not asked or is not known.
        candidates: The best places, if they were asked for.
    """

    matches: NDArray[np.int64]
    confidence: NDArray[np.float64]
    probability: NDArray[np.float64]
    candidates: Candidates | None = None


def answers_of(matcher: str, scores: Scores, calibration: Calibration | None = None) -> Answers:
    """The best place of each query.

    Args:
        matcher: Name of the decoder or other matcher whose scores these are.
        scores: Scores (n_queries, n_places), higher is better.
        calibration: Of that decoder; None: probabilities are not known.
    """
    unknown = np.full(len(scores), np.nan)
    probability = unknown if calibration is None else calibration.probabilities(scores)
    return Answers(best(scores), confidence(matcher, scores), probability)


def ranked(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """The places (n, count) with the highest of ``values`` (n, places), best first, equal ones by their number."""
    return np.argsort(-values, axis=1, kind="stable")[:, :count].astype(np.int64)


def _by_score(scores: Scores, count: int, first: int = 0) -> Candidates:
    """The places with the highest scores (n, places), numbered from ``first``; their probabilities are not known."""
    order = ranked(scores, count)
    places = np.where(scores.any(axis=1)[:, None], order + first, -1)
    return Candidates(places, np.take_along_axis(scores, order, axis=1), np.full(order.shape, np.nan))


@dataclass(frozen=True, eq=False)
class Together:
    """How queries are matched with those before them.

    Attributes:
        sequence: Queries whose scores are added up at the references' own speed; 1: none.
        motion: How the robot may move from one query to the next (`forward_filter.MOTIONS`); ``none``: unknown.
        calibration: Of the model's decoder; None: probabilities of single queries are not known.
        along: Metres along the route of each place, float64 (places,), for odometry; None: unknown.
        candidates: Number of best places that each answer names; 0: none.
    """

    sequence: int = 1
    motion: str = NONE
    calibration: Calibration | None = None
    along: NDArray[np.float64] | None = None
    candidates: int = 0

    def __post_init__(self) -> None:
        check_motion(self.motion)
        if self.sequence > 1 and self.motion != NONE:
            raise ConfigError(
                f"--sequence {self.sequence} and --motion {self.motion} both look back; give one of them "
                "(--motion also follows another speed, stops and turns)"
            )


ALONE = Together()
"""Each query by itself."""


@dataclass(frozen=True, eq=False)
class LookingBack:
    """The answers of a stream of queries, each matched with those before it; state goes in and out.

    ``state, answers = state.update(scores)``; start a new one where the stream is interrupted.

    Attributes:
        matcher: Name of the decoder or other matcher whose scores are given.
        calibration: Of that decoder; None: probabilities of single queries are not known.
        windows: Adds up the scores of the last queries; None: it does not.
        filter: What is believed after the last query; None: that is not asked.
        candidates: Number of best places that each answer names; 0: none.
        begun: Whether a query was seen.
    """

    matcher: str
    calibration: Calibration | None = None
    windows: SequenceMatcher | None = None
    filter: ForwardFilter | None = None
    candidates: int = 0
    begun: bool = False

    @classmethod
    def of(cls, matcher: str, n_places: int, together: Together = ALONE) -> LookingBack:
        """The state before the first query.

        Args:
            matcher: As the attribute.
            n_places: Number of places.
            together: How queries are matched.
        Raises:
            InputError: the sequence has no length, or exceeds the places.
        """
        windows = SequenceMatcher(n_places, together.sequence)  # refuses what is no length, too
        following = None
        if together.motion != NONE:
            following = ForwardFilter(Belief.unknown(n_places), together.motion, together.along)
        adding = windows if together.sequence > 1 else None
        return cls(matcher, together.calibration, adding, following, min(together.candidates, n_places))

    def update(self, scores: Scores, moving: NDArray[np.bool_] | None = None) -> tuple[LookingBack, Answers]:
        """Take the scores of the next queries.

        Args:
            scores: Scores of single queries (n, n_places), higher is better; how many come at a time changes no answer.
            moving: Whether each shows something else than the one before, bool (n,); None: all do. For the filter.
        Returns:
            The next state, and an answer for each of these queries; the first of the stream, whose sequence is not
            complete, have no match.
        Raises:
            InputError: the scores are not those of ``n_places`` places.
        """
        if self.windows is not None:
            return self._in_windows(self.windows, scores)
        alone = answers_of(self.matcher, scores, self.calibration)
        if self.filter is None:
            if not self.candidates:
                return self, alone
            named = _by_score(scores, self.candidates)
            named.probability[:, 0] = alone.probability
            return self, alone._replace(candidates=named)
        state, places, probability = self.filter, np.empty(len(scores), np.int64), np.empty(len(scores))
        moves = np.ones(len(scores), np.bool_) if moving is None else moving
        order = np.zeros((len(scores), self.candidates), np.int64)
        chances = np.zeros(order.shape)
        for number, row in enumerate(scores):
            state = state.update(row, moving=bool(moves[number]), first=not self.begun and number == 0)
            places[number] = state.belief.places.argmax()
            probability[number] = round(state.belief.near(int(places[number])), 9)
            if self.candidates:
                order[number] = ranked(state.belief.places[None], self.candidates)[0]
                chances[number] = state.belief.places[order[number]]
        named = Candidates(order, np.take_along_axis(scores, order, axis=1), chances)
        answers = Answers(places, alone.confidence, probability, named if self.candidates else None)
        return replace(self, filter=state, begun=True), answers

    def _in_windows(self, windows: SequenceMatcher, scores: Scores) -> tuple[LookingBack, Answers]:
        """`update` of who adds up scores over sequences."""
        windows, sums = windows.update(scores)
        ends = answers_of("sequence", sums)
        matches = np.full(len(scores), -1, np.int64)
        certainty = np.full(len(scores), -np.inf)
        begun = len(scores) - len(sums)
        matches[begun:] = np.where(ends.matches >= 0, ends.matches + windows.length - 1, -1)
        certainty[begun:] = ends.confidence
        answers = Answers(matches, certainty, np.full(len(scores), np.nan))
        if self.candidates:
            answers = answers._replace(candidates=self._of_windows(sums, windows.length, begun))
        return replace(self, windows=windows), answers

    def _of_windows(self, sums: Scores, length: int, begun: int) -> Candidates:
        """The best places by the ``sums`` of whole sequences; the first ``begun`` queries have none yet."""
        count = min(self.candidates, sums.shape[1])
        some = _by_score(sums, count, length - 1)
        before = np.full((begun, count), -1, np.int64), *(np.full((begun, count), np.nan) for _ in range(2))
        return Candidates(*(np.concatenate(pair) for pair in zip(before, some, strict=True)))


def least_probability(together: Together, precision: float) -> float:
    """The least probability with which an answer is accepted, so that ``precision`` of the accepted are right.

    Of single queries the calibration says it. Filtered ones are sure or not, with little between: of probabilities
    spread evenly from 1 - 2 (1 - precision) to 1 the mean is the precision.

    Returns:
        NaN where probabilities are not known.
    Raises:
        ConfigError: the precision is not above 0 and below 1.
    """
    check_precision(precision)
    if together.motion != NONE:
        return max(0.0, 1.0 - 2.0 * (1.0 - precision))
    return float("nan") if together.calibration is None else together.calibration.keeping(precision).probability


def accepted(answers: Answers, least: float) -> NDArray[np.bool_]:
    """Which answers are a match of at least the probability ``least``, bool (n,); of any, where that is NaN."""
    known = ~np.isnan(answers.probability)
    return (answers.matches >= 0) & (~known | np.isnan(least) | (answers.probability >= least))
