"""Answers: the matched place of each query, its confidence and its probability.

`Answerer.step` is the one way from scores of places to answers: each query by itself, in sequences, or followed by a
forward filter. State goes in and out, so that a robot's next image, a stream and a whole evaluation share it.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.matching.beliefs import RADIUS, filtered
from lava_vpr.matching.decoders import best, confidence
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.forward_filter import NONE, ForwardFilter, check_motion
from lava_vpr.matching.probability import HALF, PRECISION, Calibration, check_off_map, check_precision
from lava_vpr.matching.sequences import SequenceMatcher

_NOTES = logging.getLogger("lava_vpr")


class Candidates(NamedTuple):
    """The best places of every query, best first.

    Attributes:
        places: int64 (n, k); -1 where a query matches none.
        scores: Their scores, or the sum over a sequence, float64 (n, k).
        probability: Probability that the query is at that very place, float64 (n, k); NaN where it is not known: of
            queries by themselves for all but the best place.
    """

    places: NDArray[np.int64]
    scores: NDArray[np.float64]
    probability: NDArray[np.float64]


class Ranking(NamedTuple):
    """The values by which the places of the last m queries are ranked.

    Attributes:
        by: Scores, sums over sequences, or the filter's probabilities, float64 (m, columns), higher is better.
        scores: The score of each of these places, float64 (m, columns).
        first: Place of column 0.
        probable: Whether ``by`` are probabilities.
    """

    by: Scores
    scores: Scores
    first: int = 0
    probable: bool = False


UNRANKED = Ranking(np.zeros((0, 0)), np.zeros((0, 0)))
"""The ranking of no query."""


class Answers(NamedTuple):
    """Answers of a matcher to n queries.

    Attributes:
        matches: Matched place of each query, -1 for none, int64 (n,).
        confidence: Confidence of the matcher in that query alone, float64 (n,); -inf where nothing matches.
        probability: Probability that the query is there (within `Together.radius` places), float64 (n,); NaN where it
            is not known.
        off_map: Probability that the query is off the map, float64 (n,); None without a filter.
        followed: Probability that the filter follows the robot, float64 (n,); None without one.
        ranking: Of the last of these queries: all but those whose sequence is not complete.
    """

    matches: NDArray[np.int64]
    confidence: NDArray[np.float64]
    probability: NDArray[np.float64]
    off_map: NDArray[np.float64] | None = None
    followed: NDArray[np.float64] | None = None
    ranking: Ranking = UNRANKED

    def told(self, places: NDArray[np.int64]) -> Answers:
        """Sure answers with the known place of each query, -1 for none, int64 (n,)."""
        nowhere = (places < 0).astype(np.float64)
        return self._replace(matches=places, probability=1 - nowhere, off_map=nowhere)

    def candidates(self, count: int) -> Candidates:
        """The ``count`` best places of every query, or all that there are."""
        by, scores, first, probable = self.ranking
        rows, order = np.arange(len(by))[:, None], np.argsort(-by, axis=1, kind="stable")[:, :count]
        unranked = len(self.matches) - len(by)
        shape = (len(self.matches), order.shape[1])
        places, values, chances = np.full(shape, -1, np.int64), np.full(shape, np.nan), np.full(shape, np.nan)
        places[unranked:] = np.where(probable | by.any(axis=1)[:, None], order + first, -1)
        values[unranked:] = scores[rows, order]
        if probable:
            chances[unranked:] = by[rows, order]
        else:
            chances[:, :1] = self.probability[:, None]
        return Candidates(places, values, chances)


def answers_of(matcher: str, scores: Scores, calibration: Calibration | None = None, off_map: float = HALF) -> Answers:
    """The best place of each query by itself.

    Args:
        matcher: Name of the decoder or other matcher whose scores these are.
        scores: Scores (n_queries, n_places), higher is better.
        calibration: Of that decoder; None: probabilities are not known.
        off_map: The share of the queries that is assumed to be off the map.
    """
    probability = np.full(len(scores), np.nan) if calibration is None else calibration.probabilities(scores, off_map)
    return Answers(best(scores), confidence(matcher, scores), probability, ranking=Ranking(scores, scores))


@dataclass(frozen=True, eq=False)
class Together:
    """How queries are matched with those before them.

    Attributes:
        sequence: Queries whose scores are added up at the references' own speed; 1: none.
        motion: How the robot may move from one query to the next (`forward_filter.MOTIONS`); ``none``: unknown.
        calibration: Of the model's decoder; None: probabilities of single queries are not known.
        off_map: The share of the queries that is assumed to be off the map, at least 0 and below 1.
        along: Metres along the route of each place, float64 (places,), for odometry; None: unknown.
    """

    sequence: int = 1
    motion: str = NONE
    calibration: Calibration | None = None
    off_map: float = HALF
    along: NDArray[np.float64] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        check_motion(self.motion)
        check_off_map(self.off_map)
        if self.sequence > 1 and self.motion != NONE:
            raise ConfigError(
                f"--sequence {self.sequence} and --motion {self.motion} both look back; give one of them "
                "(--motion also follows another speed, stops and turns)"
            )

    @property
    def unknown(self) -> str | None:
        """Which answers have no known probabilities, and the remedy; None where they are known."""
        if self.motion != NONE:
            return None
        if self.sequence > 1:
            return f"sequences have no probabilities; give --motion any in place of --sequence {self.sequence}"
        if self.calibration is None:
            return "several views of a query, and preset paper, have no probabilities by themselves; give --motion any"
        return None

    @property
    def radius(self) -> int:
        """Places on either side of an answer that its probability includes."""
        return 0 if self.motion == NONE else RADIUS


ALONE = Together()
"""Each query by itself."""


@dataclass(frozen=True, eq=False)
class Answerer:
    """The state between the queries of a stream; state goes in and out.

    ``state, answers = state.step(scores)``; start a new one where the stream is interrupted.

    Attributes:
        matcher: Name of the decoder or other matcher whose scores are given.
        together: How queries are matched with those before them.
        windows: Sums of the scores of the last queries; None: no sequences.
        filter: The belief after the last query; None: no filter.
    """

    matcher: str
    together: Together = ALONE
    windows: SequenceMatcher | None = None
    filter: ForwardFilter | None = None

    @classmethod
    def of(cls, matcher: str, n_places: int, together: Together = ALONE) -> Answerer:
        """The state before the first query.

        Args:
            matcher: As the attribute.
            n_places: Number of places.
            together: As the attribute.
        Raises:
            InputError: the sequence has no length, or exceeds the places.
        """
        windows = SequenceMatcher(n_places, together.sequence)  # refuses what is no length, too
        if together.motion == NONE:
            return cls(matcher, together, windows if together.sequence > 1 else None)
        known = together.calibration, together.along, together.off_map
        return cls(matcher, together, filter=ForwardFilter.start(n_places, together.motion, *known))

    def step(
        self,
        scores: Scores,
        moving: NDArray[np.bool_] | None = None,
        odometry: float | None = None,
        stamps: NDArray[np.float64] | None = None,
    ) -> tuple[Answerer, Answers]:
        """Take the scores of the next queries.

        Args:
            scores: Scores of single queries (n, n_places), higher is better; how many come at a time changes no answer.
            moving: Whether each shows something else than the one before, bool (n,); None: all do. For the filter.
            odometry: Metres driven before each of them; None: unknown. For the filter.
            stamps: When each was taken, in seconds, float64 (n,); None: unknown. For the filter.
        Returns:
            The next state, and an answer for each of these queries; the first of the stream, whose sequence is not
            complete, have no match.
        Raises:
            InputError: the scores are not those of ``n_places`` places, or the odometry cannot be used.
        """
        if self.windows is not None:
            return self._in_windows(self.windows, scores)
        if self.filter is None:
            return self, answers_of(self.matcher, scores, self.together.calibration, self.together.off_map)
        state, beliefs = filtered(self.filter, scores, moving, odometry, stamps)
        places, near = beliefs.best()
        certainty, ranking = confidence(self.matcher, scores), Ranking(beliefs.places, scores, probable=True)
        return replace(self, filter=state), Answers(places, certainty, near, beliefs.off_map, beliefs.followed, ranking)

    def _in_windows(self, windows: SequenceMatcher, scores: Scores) -> tuple[Answerer, Answers]:
        """`step` where scores are added up over sequences."""
        windows, sums = windows.update(scores)
        ends, first = answers_of("sequence", sums), windows.length - 1
        begun = len(scores) - len(sums)
        matches = np.concatenate([np.full(begun, -1), np.where(ends.matches >= 0, ends.matches + first, -1)])
        certainty = np.concatenate([np.full(begun, -np.inf), ends.confidence])
        unknown = np.full(len(scores), np.nan)
        return replace(self, windows=windows), Answers(matches, certainty, unknown, ranking=Ranking(sums, sums, first))


def least_probability(together: Together, precision: float | None = None) -> float:
    """The probability threshold for accepting an answer, so that a share ``precision`` of the accepted is right.

    It follows from the calibration of single queries and holds for filtered ones, too: a query that is not followed is
    a single one. A filtered one is accepted from the precision itself on in any case.

    Args:
        together: How queries are matched.
        precision: The share; None: `PRECISION`.
    Returns:
        NaN where probabilities are not known, which is reported: nothing is accepted.
    Raises:
        ConfigError: the precision is not above 0 and below 1, or given where probabilities are not known.
    """
    wanted = PRECISION if precision is None else precision
    check_precision(wanted)
    if together.unknown is not None:
        if precision is not None:
            raise ConfigError(f"a target precision of {precision:g} needs probabilities, but {together.unknown}")
        _NOTES.warning(f"no match is accepted: {together.unknown}")
        return float("nan")
    by = together.calibration
    known = math.inf if by is None else by.keeping(wanted, together.off_map).probability
    return known if together.motion == NONE else min(known, wanted)


def accepted(answers: Answers, least: float) -> NDArray[np.bool_]:
    """Which answers are a match of at least the probability ``least``, bool (n,); none of which it is not known."""
    return (answers.matches >= 0) & (answers.probability >= least)


def sure(answers: Answers, least: float) -> NDArray[np.bool_]:
    """Which answers are a match of at least the confidence ``least``, bool (n,)."""
    return (answers.matches >= 0) & (answers.confidence >= least)
