"""Metrics: against a literal version, their invariances, what chance gives, and their defined answers."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching.evaluation import evaluate, leaps, truth_from_indices, truth_from_positions

quick = settings(deadline=None, max_examples=100, derandomize=True)
Case = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]


@st.composite
def cases(draw: Any) -> Case:
    """Coarse scores and confidences with many ties, silent queries, and queries without or with several true places."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    n_queries, n_places = draw(st.integers(1, 12)), draw(st.integers(1, 8))
    scores = rng.integers(draw(st.sampled_from([0, -3])), 4, (n_queries, n_places)).astype(np.float64)
    scores[rng.random(n_queries) < 0.2] = 0
    confidence = rng.integers(0, 5, n_queries).astype(np.float64)
    truth = rng.random((n_queries, n_places)) < draw(st.sampled_from([0.1, 0.5]))
    return scores, confidence, truth


def literal_answers(scores: NDArray[np.float64], truth: NDArray[np.bool_], n: int) -> list[bool]:
    """Whether a true place is among each query's n best."""
    found = []
    for row, true in zip(scores.tolist(), truth.tolist(), strict=True):
        ranked = sorted(range(len(row)), key=lambda place: (-row[place], place))
        found.append(any(row) and any(true[place] for place in ranked[:n]))
    return found


def literal_metrics(scores: NDArray[np.float64], confidence: NDArray[np.float64], truth: NDArray[np.bool_]) -> Any:
    correct = literal_answers(scores, truth, 1)
    sure = [c if any(row) else -math.inf for c, row in zip(confidence.tolist(), scores.tolist(), strict=True)]
    points, limits = [(0.0, 1.0)], [math.inf]
    for limit in sorted(set(sure), reverse=True):
        accepted = [right for right, c in zip(correct, sure, strict=True) if c >= limit]
        points.append((sum(accepted) / len(correct), sum(accepted) / len(accepted)))
        limits.append(limit)
    auc = sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in itertools.pairwise(points))
    return {
        "recall_at_1": sum(correct) / len(correct),
        "recall_at_n": {str(n): sum(literal_answers(scores, truth, n)) / len(correct) for n in (1, 2, 5, 10)},
        "recall_at_100_precision": max(recall for recall, precision in points if precision == 1),
        "precision_at_100_recall": points[-1][1],
        "auc": auc,
    }, (*zip(*points, strict=True), limits)


def flat(metrics: dict[str, Any]) -> dict[str, float]:
    return {**{k: v for k, v in metrics.items() if k != "recall_at_n"}, **metrics["recall_at_n"]}


@given(case=cases())
@quick
def test_metrics_equal_the_literal_ones(case: Case) -> None:
    found, (figures, curve) = evaluate(*case, n=(1, 2, 5, 10)), literal_metrics(*case)
    assert flat(found.as_json()) == pytest.approx(flat(figures), abs=1e-12)
    for points, expected in zip((found.recall, found.precision, found.threshold), curve, strict=True):
        np.testing.assert_allclose(points, expected, atol=1e-12)


def test_a_rejected_query_is_not_recalled() -> None:
    scores = np.array([[2.0, 1.0], [2.0, 1.0], [1.0, 2.0], [1.0, 2.0]])
    truth = truth_from_indices(np.array([0, 1, 1, 1]), np.arange(2))
    metrics = evaluate(scores, np.array([4.0, 3.0, 2.0, 1.0]), truth)
    assert metrics.recall.tolist() == [0, 0.25, 0.25, 0.5, 0.75]
    assert metrics.precision.tolist() == [1, 1, 1 / 2, 2 / 3, 3 / 4]
    assert metrics.threshold.tolist() == [math.inf, 4, 3, 2, 1]
    assert metrics.recall_at_100_precision == 0.25
    assert metrics.auc == pytest.approx(0.25 + 0.25 * (1 / 2 + 2 / 3) / 2 + 0.25 * (2 / 3 + 3 / 4) / 2)


def test_a_silent_query_is_never_recalled_and_ranks_last() -> None:
    scores, truth = np.array([[0.0, 0.0], [0.0, 1.0]]), np.ones((2, 2), dtype=bool)
    metrics = evaluate(scores, np.array([9.0, 1.0]), truth)
    assert (metrics.recall_at_1, metrics.recall_at_n[5], metrics.recall_at_100_precision) == (0.5, 0.5, 0.5)
    assert metrics.threshold.tolist() == [math.inf, 1, -math.inf]


def test_a_query_off_the_map_counts_against_recall_and_precision() -> None:
    scores, truth = np.eye(4), np.eye(4, dtype=bool)
    truth[3] = False
    metrics = evaluate(scores, np.array([1.0, 1.0, 1.0, 2.0]), truth)
    assert (metrics.recall_at_1, metrics.recall_at_n[5], metrics.recall_at_100_precision) == (0.75, 0.75, 0)
    assert (metrics.queries, metrics.without_place) == (4, 1)
    rejected = evaluate(scores, np.array([1.0, 1.0, 1.0, 0.0]), truth)
    assert rejected.recall_at_100_precision == 0.75


def test_without_queries_every_figure_is_null() -> None:
    metrics = evaluate(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3), dtype=bool))
    assert json.dumps(metrics.as_json()) == (
        '{"recall_at_1": null, "recall_at_n": {"5": null, "10": null}, "recall_at_100_precision": null, '
        '"precision_at_100_recall": null, "auc": null}'
    )


# The released code's thresholds.


def literal_vprsnn(scores: NDArray[np.float64], truth: NDArray[np.bool_]) -> tuple[float, float]:
    """R@100P and AUC of 99 even thresholds on D = max S - S; recall = TP / (TP + rejected)."""
    distances = scores.max() - scores
    correct = literal_answers(scores, truth, 1)
    points = [(0.0, 1.0)]
    for limit in np.linspace(0, distances.max(), 99):
        accepted = [right for right, row in zip(correct, distances, strict=True) if row.min() <= limit]
        true, rejected = sum(accepted), len(correct) - len(accepted)
        points.append((true / (true + rejected) if true + rejected else 0.0, true / len(accepted)))
    return (
        max(recall for recall, precision in points if precision == 1),
        sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in itertools.pairwise(points)),
    )


@given(case=cases())
@settings(deadline=None, max_examples=30, derandomize=True)
def test_released_thresholds_equal_the_literal_ones(case: Case) -> None:
    scores, confidence, truth = case
    metrics = evaluate(scores, confidence, truth, pr="vprsnn")
    assert (metrics.recall_at_100_precision, metrics.auc) == pytest.approx(literal_vprsnn(scores, truth), abs=1e-12)
    assert len(metrics.recall) == 100


# Ground truth.


def test_truth_from_indices() -> None:
    exact = truth_from_indices(np.array([5, 7]), np.array([5, 6, 7]))
    assert exact.tolist() == [[True, False, False], [False, False, True]]
    near = truth_from_indices(np.array([5, 7], np.uint8), np.array([5, 6, 7, 250], np.uint8), tolerance=1)
    assert near.tolist() == [[True, True, False, False], [False, True, True, False]]
    with pytest.raises(InputError, match="tolerance is -1, must be at least 0"):
        truth_from_indices(np.array([1]), np.array([1]), -1)


@pytest.mark.parametrize(
    ("places", "wanted"),
    [
        ([0, 1, 2, 3, 4], False),
        ([9, 7, 5, 3, 1], False),
        ([0, 3, 6, 9, 8], True),
        ([0, 2, 4, 9, 0], False),  # two leaps of four
        ([0, 3, 0, 2, 0], False),
        ([0, 3, None, 0, 3], True),  # what shows no place says nothing
        ([5], False),
        ([], False),
    ],
)
def test_leaps(places: list[int | None], wanted: bool) -> None:
    truth = np.array([[place == k for k in range(10)] for place in places], np.bool_).reshape(-1, 10)
    assert leaps(truth, 2) is wanted


def test_places_that_look_alike_are_near_whatever_is_between() -> None:
    truth = np.zeros((4, 100), np.bool_)
    truth[[0, 1, 2, 3], [0, 50, 99, 50]] = True
    assert leaps(truth, 2)
    truth[[0, 2], [60, 40]] = True  # from 0 or 60 to 50, to 40 or 99
    assert not leaps(truth, 2)


def test_truth_from_positions() -> None:
    places, queries = np.array([[0.0, 0.0], [3.0, 4.0], [30.0, 40.0]]), np.array([[0.0, 0.0], [3.0, 3.9]])
    assert truth_from_positions(places, queries, 5.0).tolist() == [[True, True, False], [True, True, False]]
    assert truth_from_positions(places, queries, 0.0).tolist() == [[True, False, False], [False, False, False]]


@given(seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=20, derandomize=True)
def test_positions_on_a_line_are_indices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, queries = rng.integers(0, 30, 12), rng.integers(0, 30, 9)
    expected = truth_from_indices(queries, places, 3)
    np.testing.assert_array_equal(truth_from_positions(places[:, None], queries[:, None], 3.0), expected)


@pytest.mark.parametrize(
    ("ref_xy", "query_xy", "radius", "message"),
    [
        (np.zeros((2, 2)), np.zeros((2, 2)), -1.0, "radius is -1.0, must be at least 0 m"),
        (np.zeros((2, 2)), np.zeros((2, 2)), math.nan, "radius is nan, must be at least 0 m"),
        (np.zeros(2), np.zeros((2, 2)), 1.0, "reference positions: shape (2,), must be one row of coordinates"),
        (np.zeros((2, 2)), np.array([[0, 0], [math.nan, 0]]), 1.0, "query positions: row 1 is not finite"),
        (np.zeros((2, 2)), np.zeros((2, 3)), 1.0, "reference and query positions have 2 and 3 coordinates"),
    ],
)
def test_unusable_positions_are_refused(ref_xy: Any, query_xy: Any, radius: float, message: str) -> None:
    with pytest.raises(InputError) as error:
        truth_from_positions(ref_xy, query_xy, radius)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scores": np.ones((3, 4))}, "scores (3, 4) and ground truth (3, 3) must both be (queries, places)"),
        ({"scores": np.ones(3), "truth": np.ones(3, bool)}, "must both be (queries, places)"),
        ({"confidence": np.ones(2)}, "confidence of shape (2,), must be one number for each of 3 queries"),
        ({"truth": np.ones((3, 3))}, "ground truth is of type float64, must be bool"),
        ({"scores": np.full((3, 3), math.nan)}, "scores hold NaN or infinite values"),
        ({"confidence": np.array([1.0, math.nan, 2.0])}, "confidence holds NaN"),
        ({"n": (5, 0)}, "recall at 0 is not defined; N must be at least 1"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(change: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"scores": np.eye(3), "confidence": np.ones(3), "truth": np.eye(3, dtype=bool)}
    with pytest.raises(InputError) as error:
        evaluate(**(arguments | change))
    assert message in str(error.value)
