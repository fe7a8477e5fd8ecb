"""Ground truth, recall and exact precision-recall curves.

Every query gets one answer, its best place, and a confidence. A rejected query is not recalled, so that
**recall = correct / all queries**. Queries enter by falling confidence, equal confidences together; the curve runs from
(recall 0, precision 1) to the point where every query is answered, and its area is the trapezoid's. R@100P is the
largest recall with precision 1. Hussaini et al. 2022, section V.C, use the same measures; their code's thresholds are
kept as ``pr="vprsnn"`` for comparison with it.

Defined answers:

* A query that matches no place (all its scores 0) is never correct, and ranks last whatever its confidence.
* A query without a true place should be rejected: any answer to it is a false positive. It counts among all queries,
  so that recall cannot reach 1 on such a set; `Metrics.without_place` says how many there are.
* Equal scores rank by the lower place. With fewer than N places, recall at N looks at all of them.
* Without queries nothing can be computed: every figure is NaN (``null`` in JSON).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError

Scores = NDArray[np.float64]
Truth = NDArray[np.bool_]
VPRSNN_THRESHOLDS = 99
_BLOCK = 256
"""Queries at a time: bounds what is needed beside the scores themselves."""


@dataclass(frozen=True)
class Metrics:
    """One matcher's figures, fractions in 0..1 or NaN.

    Attributes:
        recall_at_1: Share of the queries whose best place is a true one.
        recall_at_n: By N, share of the queries with a true place among the N best.
        recall_at_100_precision: R@100P.
        precision_at_100_recall: Precision when every query is answered.
        auc: Area under the precision-recall curve.
        queries: Number of queries.
        without_place: How many of them have no true place.
        recall, precision: The curve, each (n_points,), from (0, 1) on, least confident last.
        threshold: Lowest confidence that is accepted at each point, (n_points,), +inf at the first.
    """

    recall_at_1: float
    recall_at_n: dict[int, float]
    recall_at_100_precision: float
    precision_at_100_recall: float
    auc: float
    queries: int
    without_place: int
    recall: Scores = field(repr=False, compare=False)
    precision: Scores = field(repr=False, compare=False)
    threshold: Scores = field(repr=False, compare=False)

    def as_json(self) -> dict[str, Any]:
        """The figures as plain JSON values; NaN becomes None."""

        def plain(value: float) -> float | None:
            return None if math.isnan(value) else float(value)

        return {
            "recall_at_1": plain(self.recall_at_1),
            "recall_at_n": {str(n): plain(value) for n, value in self.recall_at_n.items()},
            "recall_at_100_precision": plain(self.recall_at_100_precision),
            "precision_at_100_recall": plain(self.precision_at_100_recall),
            "auc": plain(self.auc),
        }

    def curve_json(self) -> dict[str, list[float | None]]:
        """The precision-recall curve as plain JSON values, lists of equal length; infinite thresholds become None."""
        return {
            "recall": self.recall.tolist(),
            "precision": self.precision.tolist(),
            "threshold": [value if math.isfinite(value) else None for value in self.threshold.tolist()],
        }


def truth_from_indices(query_idx: NDArray[Any], place_idx: NDArray[Any], tolerance: int = 0) -> Truth:
    """Ground truth of sequences that show the same route: equal indices, or at most ``tolerance`` apart.

    Args:
        query_idx: Index of each query along the route, int (n_queries,).
        place_idx: Index of each place, int (n_places,).
        tolerance: Largest difference that counts as the same place, at least 0.
    Returns:
        bool (n_queries, n_places).
    Raises:
        InputError: negative tolerance.
    """
    if tolerance < 0:
        raise InputError(f"tolerance is {tolerance}, must be at least 0 (0: exact match)")
    queries, places = np.asarray(query_idx, np.int64), np.asarray(place_idx, np.int64)
    truth = np.empty((len(queries), len(places)), np.bool_)
    for start in range(0, len(queries), _BLOCK):
        rows = slice(start, start + _BLOCK)
        truth[rows] = np.abs(queries[rows, None] - places[None, :]) <= tolerance
    return truth


def leaps(truth: Truth, furthest: int) -> bool:
    """Whether most queries show no place within ``furthest`` of those that the query before shows: they are no drive.

    Args:
        truth: bool (n_queries, n_places); queries that show no place, and those after them, do not count.
        furthest: Places that a drive may go from one query to the next.
    """
    first, last = truth.argmax(axis=1), truth.shape[1] - 1 - truth[:, ::-1].argmax(axis=1)
    between = np.maximum(first[1:] - last[:-1], first[:-1] - last[1:])
    placed = truth.any(axis=1)
    between = between[placed[1:] & placed[:-1]]
    return bool(2 * np.count_nonzero(between > furthest) > len(between))


def truth_from_positions(ref_xy: NDArray[Any], query_xy: NDArray[Any], radius: float) -> Truth:
    """Ground truth from positions: places at most ``radius`` from where the query was taken.

    Args:
        ref_xy: Position of each place, float (n_places, 2) or more coordinates, in metres on a plane.
        query_xy: Position of each query, float (n_queries, same), in the same frame.
        radius: In metres, at least 0.
    Returns:
        bool (n_queries, n_places).
    Raises:
        InputError: positions that are no finite numbers, of different dimensions, or a radius that is none.
    """
    if not 0 <= radius < math.inf:
        raise InputError(f"radius is {radius}, must be at least 0 m; correct it (--radius)")
    arrays = []
    for name, xy in (("reference", ref_xy), ("query", query_xy)):
        array = np.asarray(xy, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] < 1:
            raise InputError(f"{name} positions: shape {array.shape}, must be one row of coordinates for each image")
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if len(bad):
            raise InputError(
                f"{name} positions: row {bad[0]} is not finite; give each image a position, or leave it out"
            )
        arrays.append(array)
    if arrays[0].shape[1] != arrays[1].shape[1]:
        dims = " and ".join(str(array.shape[1]) for array in arrays)
        raise InputError(f"reference and query positions have {dims} coordinates; use the same frame for both")
    from scipy.spatial.distance import cdist  # a query needs no scipy

    places, queries = arrays
    truth = np.empty((len(queries), len(places)), np.bool_)
    for start in range(0, len(queries), _BLOCK):
        rows = slice(start, start + _BLOCK)
        truth[rows] = cdist(queries[rows], places) <= radius
    return truth


def _true_rank(scores: Scores, truth: Truth) -> NDArray[np.int64]:
    """Rank of each query's best-ranked true place, 0 is best; n_places without one, and for a query without match."""
    n_queries, n_places = scores.shape
    rank = np.full(n_queries, n_places, np.int64)
    known = np.flatnonzero(truth.any(axis=1) & scores.any(axis=1))
    for some in (known[start : start + _BLOCK] for start in range(0, len(known), _BLOCK)):
        answered = scores[some]
        place = np.where(truth[some], answered, -np.inf).argmax(axis=1)
        value = answered[np.arange(len(some)), place][:, None]
        better = (answered > value) | ((answered == value) & (np.arange(n_places) < place[:, None]))
        rank[some] = np.count_nonzero(better, axis=1)
    return rank


def _exact_curve(confidence: Scores, correct: NDArray[np.bool_]) -> tuple[Scores, Scores, Scores]:
    """Recall, precision and threshold of every point, one for each distinct confidence, after (0, 1)."""
    order = np.argsort(-confidence, kind="stable")
    falling = confidence[order]
    last = np.flatnonzero(np.append(falling[1:] != falling[:-1], True))
    hits = np.cumsum(correct[order])[last]
    recall = np.concatenate([[0.0], hits / len(correct)])
    precision = np.concatenate([[1.0], hits / (last + 1)])
    return recall, precision, np.concatenate([[np.inf], falling[last]])


def _vprsnn_curve(most: Scores, least: float, correct: NDArray[np.bool_]) -> tuple[Scores, Scores, Scores]:
    """The released code's curve: 99 even thresholds on the distance max S - S, recall = TP / (TP + rejected).

    Recall is 0 where nothing is either correct or rejected. ``most`` is the highest score of each query, ``least`` the
    lowest of all.
    """
    top = most.max()
    distance = top - most
    limits = np.linspace(0.0, top - least, VPRSNN_THRESHOLDS)
    accepted = distance[None, :] <= limits[:, None]
    hits = np.count_nonzero(accepted & correct, axis=1)
    answered = np.count_nonzero(accepted, axis=1)
    correct_or_rejected = hits + (len(correct) - answered)
    recall = np.divide(hits, correct_or_rejected, out=np.zeros(len(limits)), where=correct_or_rejected > 0)
    return (
        np.concatenate([[0.0], recall]),
        np.concatenate([[1.0], hits / answered]),
        np.concatenate([[np.inf], top - limits]),
    )


def _checked(scores: Scores, confidence: Scores, truth: Truth) -> tuple[Scores, Scores]:
    """Scores and confidence as float64, refused where they are no numbers or do not belong together."""
    scores, confidence = np.asarray(scores, np.float64), np.asarray(confidence, np.float64)
    if scores.ndim != 2 or scores.shape != truth.shape or scores.shape[1] < 1:
        raise InputError(f"scores {scores.shape} and ground truth {truth.shape} must both be (queries, places)")
    if confidence.shape != scores.shape[:1]:
        raise InputError(
            f"confidence of shape {confidence.shape}, must be one number for each of {len(scores)} queries"
        )
    if truth.dtype != np.bool_:
        raise InputError(f"ground truth is of type {truth.dtype}, must be bool; compare it with a tolerance first")
    if not np.isfinite(scores).all():
        raise InputError("scores hold NaN or infinite values; mend the matcher that made them")
    if np.isnan(confidence).any():
        raise InputError("confidence holds NaN; mend the matcher that made it")
    return scores, confidence


class Tally:
    """What is counted of the queries of one matcher, some at a time; then its figures.

    Args:
        queries: Number of queries; each must be added once before `metrics` is asked for.
    """

    def __init__(self, queries: int) -> None:
        self._places = 0
        self._rank = np.zeros(queries, np.int64)
        self._confidence, self._most, self._least = (np.zeros(queries) for _ in range(3))
        self._has_place = np.zeros(queries, np.bool_)

    def add(self, rows: slice, scores: Scores, confidence: Scores, truth: Truth) -> None:
        """Count some queries.

        Args:
            rows: Which of the queries they are.
            scores, confidence, truth: Theirs, as in `evaluate`.
        Raises:
            InputError: arrays that do not belong together, or NaN.
        """
        scores, confidence = _checked(scores, confidence, truth)
        self._places = scores.shape[1]
        self._rank[rows] = _true_rank(scores, truth)
        self._confidence[rows] = np.where(scores.any(axis=1), confidence, -np.inf)
        self._most[rows], self._least[rows] = scores.max(axis=1), scores.min(axis=1)
        self._has_place[rows] = truth.any(axis=1)

    def metrics(self, n: Sequence[int] = (5, 10), pr: Literal["exact", "vprsnn"] = "exact") -> Metrics:
        """The figures of all queries, as `evaluate` gives them.

        Raises:
            InputError: an N below 1.
        """
        if min(n, default=1) < 1:
            raise InputError(f"recall at {min(n)} is not defined; N must be at least 1")
        n_queries, correct = len(self._rank), self._rank == 0
        if n_queries == 0:
            nan, none = math.nan, np.zeros(0)
            return Metrics(nan, {k: nan for k in n}, nan, nan, nan, 0, 0, recall=none, precision=none, threshold=none)
        if pr == "vprsnn":
            recall, precision, threshold = _vprsnn_curve(self._most, float(self._least.min()), correct)
        else:
            recall, precision, threshold = _exact_curve(self._confidence, correct)
        recall_at_1 = float(np.count_nonzero(correct) / n_queries)
        return Metrics(
            recall_at_1=recall_at_1,
            # Looking at more places than there are would count the rank that stands for "no true place".
            recall_at_n={k: float(np.count_nonzero(self._rank < min(k, self._places)) / n_queries) for k in n},
            recall_at_100_precision=float(recall[precision == 1.0].max()),
            precision_at_100_recall=recall_at_1,  # every query is answered, so all queries stand below the line
            auc=float(np.sum(np.diff(recall) * (precision[1:] + precision[:-1]) / 2.0)),
            queries=n_queries,
            without_place=int(np.count_nonzero(~self._has_place)),
            recall=recall,
            precision=precision,
            threshold=threshold,
        )


def evaluate(
    scores: Scores,
    confidence: Scores,
    truth: Truth,
    *,
    n: Sequence[int] = (5, 10),
    pr: Literal["exact", "vprsnn"] = "exact",
) -> Metrics:
    """Recall and precision-recall figures of one matcher.

    Args:
        scores: Scores (n_queries, n_places), finite, higher is better; distances negated.
        confidence: Confidence of each query's best match (n_queries,); -inf is allowed.
        truth: bool (n_queries, n_places), True where the query is at the place; none, one or many in a row.
        n: The N of recall at N, each at least 1.
        pr: ``exact``; or ``vprsnn``, the released code's thresholds on the scores, for comparison with it only.
    Returns:
        The figures and the curve.
    Raises:
        InputError: arrays that do not belong together, NaN, or an N below 1.
    """
    tally = Tally(len(scores))
    tally.add(slice(0, len(scores)), scores, confidence, truth)
    return tally.metrics(n, pr)


TITLES: Mapping[str, str] = {
    "recall_at_1": "R@1",
    "recall_at_5": "R@5",
    "recall_at_10": "R@10",
    "recall_at_100_precision": "R@100P",
    "precision_at_100_recall": "P@100R",
    "auc": "AUC",
}
"""Titles of all figures, by their keys, in the order of tables."""


class Recall(NamedTuple):
    """The figures that experiments keep of a matcher, fractions in 0..1."""

    recall_at_1: float
    recall_at_100_precision: float
    auc: float

    @classmethod
    def of(cls, metrics: Metrics) -> Recall:
        """Those of ``metrics``."""
        return cls(metrics.recall_at_1, metrics.recall_at_100_precision, metrics.auc)


def titles(keys: Iterable[str] = Recall._fields) -> tuple[str, ...]:
    """The titles of some figures, by default of those of `Recall`."""
    return tuple(TITLES[key] for key in keys)


def values_of(metrics: Any, keys: Iterable[str] = TITLES) -> tuple[float | None, ...]:
    """The figures of a `Metrics`, or of what is like one, by their keys; None where a rank was not counted."""
    by_rank = {f"recall_at_{n}": value for n, value in metrics.recall_at_n.items()}
    return tuple(getattr(metrics, key, by_rank.get(key)) for key in keys)
