"""Sequence matching: the scores of L consecutive queries at L consecutive places, added up along the diagonal.

``score_L(q, r) = sum_{k < L} n(q + k, r + k)`` with n the scores of a query divided by their sum, so that every query
has the same say (Hussaini et al. 2022, section VI.C, after SeqSLAM, Milford and Wyeth 2012, at the speed of
the learned traverse). Only queries and places with a full window count. The causal form, for streams, looks back
instead: ``sum_k n(q - k, r - k)``. It holds the same numbers, named after the window's last pair.

Places must follow each other in travelling order. Where routes that do not continue each other were joined into one
list, a window across the joint adds up places that nobody passes in turn, and the last L - 1 places of one route (first
L - 1 of the next, in the causal form) have no window of their own: match each route apart to be sure of them. Stretches
of one route need no such care.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching.decoders import contrast

Scores = NDArray[np.float64]


def normalise_scores(scores: Scores) -> Scores:
    """Each query's scores divided by the sum of their absolute values.

    For scores of at least 0 that is their sum; for negated distances -d it gives ``-d / sum d``.

    Args:
        scores: Scores (n_queries, n_places).
    Returns:
        float64 of the same shape; all 0 for a query whose scores are all 0.
    """
    values = np.ascontiguousarray(scores, dtype=np.float64)
    # The rows' own order of summation is kept: a query alone and in a batch gives the same bits.
    totals = np.abs(values).sum(axis=1, keepdims=True)
    return np.divide(values, totals, out=np.zeros_like(values), where=totals > 0)


def _check_length(length: int, n_queries: int | None, n_places: int) -> None:
    """Refuse a sequence without length, or longer than what it is laid over."""
    if length < 1:
        raise InputError(f"sequence length is {length}, must be at least 1 (1: single images)")
    for number, what in ((n_queries, "queries"), (n_places, "places")):
        if number is not None and length > number:
            raise InputError(
                f"sequence length {length} exceeds the {number} {what}; use a shorter sequence or more images"
            )


def sequence_scores(scores: Scores, length: int, *, normalise: bool = True) -> Scores:
    """Scores of sequences that start at query q and place r: ``sum_{k < length} n(q + k, r + k)``.

    Args:
        scores: Scores of single queries (n_queries, n_places), higher is better; distances negated.
        length: L, the number of consecutive queries; 1 gives the normalised scores.
        normalise: Whether to `normalise_scores` first; off for scores that are normalised already.
    Returns:
        float64 (n_queries - L + 1, n_places - L + 1); row and column are the *first* query and place of the window. In
        the causal form they are the last ones: row j is query j + L - 1, column c is place c + L - 1.
    Raises:
        InputError: L is below 1 or exceeds the queries or the places.
    """
    n_queries, n_places = scores.shape
    _check_length(length, n_queries, n_places)
    values = normalise_scores(scores) if normalise else np.asarray(scores, dtype=np.float64)
    rows, columns = n_queries - length + 1, n_places - length + 1
    total = values[:rows, :columns].copy()
    for k in range(1, length):
        total += values[k : k + rows, k : k + columns]
    return total


def sequence_truth(truth: NDArray[np.bool_], length: int) -> NDArray[np.bool_]:
    """Ground truth of windows, laid out as the scores of `sequence_scores`: named after their first pair.

    A window answers where its first query is. It is right when that query is truly at that place, whatever the window's
    other pairs; with one-to-one ground truth, and with a tolerance, all pairs of a window agree anyway. A true place
    without a full window is none that can be found.

    Args:
        truth: bool (n_queries, n_places), see `lava_vpr.matching.evaluation`.
        length: L.
    Returns:
        bool (n_queries - L + 1, n_places - L + 1).
    Raises:
        InputError: L is below 1 or exceeds the queries or the places.
    """
    n_queries, n_places = truth.shape
    _check_length(length, n_queries, n_places)
    shift = length - 1
    return truth[: n_queries - shift, : n_places - shift]


@dataclass(frozen=True, eq=False)
class SequenceMatcher:
    """`sequence_scores`, causal, for a stream, some queries at a time and the same bit for bit; state goes in and out.

    ``matcher, scores = matcher.update(rows)``; start a new one where the stream is interrupted.

    Attributes:
        n_places: Number of places.
        length: L.
        rows: The scores of the last queries, oldest first, at most L - 1 (m, n_places); None before the first.
    """

    n_places: int
    length: int
    rows: Scores | None = None

    def __post_init__(self) -> None:
        _check_length(self.length, None, self.n_places)

    def update(self, scores: Scores) -> tuple[SequenceMatcher, Scores]:
        """Take the scores of the next queries.

        Args:
            scores: Scores of single queries (n, n_places); how many come at a time changes no result.
        Returns:
            The next state; and the scores (m, n_places - L + 1) of the sequences that end at the last m of these
            queries, element c for place c + L - 1: at all of them, but for the first L - 1 of the stream.
        Raises:
            InputError: the scores are not those of ``n_places`` places.
        """
        if scores.shape[1:] != (self.n_places,):
            raise InputError(
                f"scores of shape {scores.shape} given to a matcher of {self.n_places} places; use one model throughout"
            )
        values = normalise_scores(scores)
        known = values if self.rows is None else np.concatenate([self.rows, values])
        if len(known) < self.length:
            return replace(self, rows=known), np.zeros((0, self.n_places - self.length + 1))
        last = known[len(known) - self.length + 1 :].copy()
        return replace(self, rows=last), sequence_scores(known, self.length, normalise=False)


class Pace:
    """Whether queries move along the places at the references' own speed, as sequences take for granted.

    Queries that are sure by themselves (`decoders.contrast` of at least `SURE`) tell their places. Two of them,
    at most `APART` queries apart, give a step in places a query.
    """

    SURE, APART, FEWEST = 2.0, 10, 10

    def __init__(self) -> None:
        self._seen, self._last, self._steps = 0, (-self.APART - 1, 0), list[float]()

    def update(self, scores: Scores) -> None:
        """Take the scores (n, places) of the next single queries."""
        sure = scores.any(axis=1) & (contrast(scores) >= self.SURE)
        places = scores.argmax(axis=1)
        for number in np.flatnonzero(sure):
            query, place = self._seen + int(number), int(places[number])
            apart = query - self._last[0]
            if apart <= self.APART:
                self._steps.append((place - self._last[1]) / apart)
            self._last = (query, place)
        self._seen += len(scores)

    def contradiction(self, length: int) -> str | None:
        """One line, if most steps are not about one place a query; None if they are, or if too few are known.

        Args:
            length: Queries in a sequence.
        """
        steps = np.array(self._steps)
        if len(steps) < self.FEWEST or np.count_nonzero(np.abs(steps - 1.0) <= 0.25) * 2 >= len(steps):
            return None
        return (
            f"--sequence {length} takes the queries to move by one place each, but the surest of them "
            f"move by {np.median(steps):.2g}; use --motion any, which follows any speed, stops and turns"
        )
