"""Sequences: against literal loops, the stream against the batch, refusals; answers held against the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching import against_truth, sequences
from lava_vpr.matching.against_truth import InBlocks, follow, hold
from lava_vpr.matching.answers import Answerer, Answers, Together, answers_of
from lava_vpr.matching.beliefs import filtered
from lava_vpr.matching.evaluation import evaluate, truth_from_indices
from lava_vpr.matching.forward_filter import ForwardFilter
from lava_vpr.matching.probability import RIGHT, WRONG, Calibration
from lava_vpr.matching.sequences import (
    SequenceMatcher,
    normalise_scores,
    sequence_scores,
    sequence_truth,
)
from lava_vpr.matching.smoothing import smooth


@st.composite
def scores_and_length(draw: Any) -> tuple[NDArray[np.float64], int]:
    n_queries, n_places = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    scores = rng.random((n_queries, n_places)) * draw(st.sampled_from([1.0, -100.0]))
    scores[rng.random(n_queries) < 0.2] = 0.0
    return scores, draw(st.integers(1, min(n_queries, n_places)))


def literal(scores: NDArray[np.float64], length: int, causal: bool) -> dict[tuple[int, int], float]:
    """Sequence score of every (query, place) with a full window, by loops."""
    rows = [[v / sum(map(abs, row)) if any(row) else 0.0 for v in row] for row in scores.tolist()]
    step = -1 if causal else 1
    result = {}
    for q in range(len(rows)):
        for r in range(len(rows[0])):
            end_q, end_r = q + step * (length - 1), r + step * (length - 1)
            if 0 <= end_q < len(rows) and 0 <= end_r < len(rows[0]):
                result[q, r] = sum(rows[q + step * k][r + step * k] for k in range(length))
    return result


@given(case=scores_and_length())
@settings(deadline=None, max_examples=80, derandomize=True)
def test_sequences_equal_the_loops(case: tuple[NDArray[np.float64], int]) -> None:
    scores, length = case
    for causal in (False, True):
        matrix, shift = sequence_scores(scores, length), length - 1 if causal else 0
        expected = literal(scores, length, causal)
        assert matrix.size == len(expected)
        for (q, r), value in expected.items():
            assert matrix[q - shift, r - shift] == pytest.approx(value, abs=1e-12)


def cut(scores: NDArray[np.float64], ends: list[int]) -> list[NDArray[np.float64]]:
    """Consecutive parts of all rows, some of them empty."""
    return np.split(scores, sorted(end % (len(scores) + 1) for end in ends))


@given(case=scores_and_length(), ends=st.lists(st.integers(0, 9), max_size=9))
@settings(deadline=None, max_examples=80, derandomize=True)
def test_answers_look_back_however_queries_come(case: tuple[NDArray[np.float64], int], ends: list[int]) -> None:
    scores, length = case
    state, parts = Answerer.of("sad", scores.shape[1], Together(length)), list[Answers]()
    for part in cut(scores, ends):
        state, found = state.step(part)
        assert len(found.matches) == len(found.confidence) == len(part)
        parts.append(found)
    answers = [np.concatenate([part[field] for part in parts]) for field in range(3)]
    _, whole = Answerer.of("sad", scores.shape[1], Together(length)).step(scores)
    for one, other in zip(answers, whole, strict=False):
        np.testing.assert_array_equal(one, other)
    windows = literal(scores, length, causal=True) if length > 1 else dict(np.ndenumerate(scores))
    assert np.isnan(answers[2]).all()
    for query, (match, confidence, _) in enumerate(zip(*answers, strict=True)):
        places = {r: value for (q, r), value in windows.items() if q == query}
        if not any(places.values()):  # no window ends here, or it holds no score
            assert (match, confidence) == (-1, -np.inf)
            continue
        assert places[int(match)] == pytest.approx(max(places.values()), abs=1e-12)
        first, second = [*sorted(places.values(), reverse=True), 0.0][:2]
        assert confidence == pytest.approx(first - second if length > 1 else first, abs=1e-12)


@given(case=scores_and_length(), ends=st.lists(st.integers(0, 9), max_size=9))
@settings(deadline=None, max_examples=80, derandomize=True)
def test_a_stream_gives_the_bits_of_the_batch(case: tuple[NDArray[np.float64], int], ends: list[int]) -> None:
    scores, length = case
    for parts in (cut(scores, ends), list(scores[:, None])):
        matcher, answers, seen = SequenceMatcher(scores.shape[1], length), [], 0
        for part in parts:
            matcher, answer = matcher.update(part)
            assert len(answer) == max(0, seen + len(part) - length + 1) - max(0, seen - length + 1)
            assert matcher.rows is not None
            seen += len(part)
            assert len(matcher.rows) == min(seen, length - 1)
            assert matcher.rows.base is None  # nothing older is held by it
            answers.append(answer)
        np.testing.assert_array_equal(np.concatenate(answers), sequence_scores(scores, length))


def test_a_stream_is_not_changed_by_what_follows() -> None:
    first, row = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    start, none = SequenceMatcher(3, 2).update(first)
    assert none.shape == (0, 2)
    _, once = start.update(row)
    start.update(np.array([[5.0, 5.0, 5.0]]))
    row[:] = first[:] = 9.0
    _, again = start.update(np.array([[0.0, 1.0, 0.0]]))
    assert once.tolist() == again.tolist() == [[2.0, 0.0]]


def test_normalised_scores_of_similarities_distances_and_silence() -> None:
    scores = np.array([[1.0, 3.0], [-1.0, -3.0], [0.0, 0.0], [-0.5, 0.5]])
    assert normalise_scores(scores).tolist() == [[0.25, 0.75], [-0.25, -0.75], [0.0, 0.0], [-0.5, 0.5]]
    assert normalise_scores(scores.astype(np.float32)).dtype == np.float64


def test_normalising_does_not_depend_on_memory_layout_or_batch() -> None:
    scores = np.random.default_rng(0).random((40, 333))
    whole = normalise_scores(scores)
    np.testing.assert_array_equal(normalise_scores(np.asfortranarray(scores)), whole)
    np.testing.assert_array_equal(normalise_scores(scores[17:18])[0], whole[17])


def test_the_input_is_left_as_it_was() -> None:
    scores = np.random.default_rng(0).random((4, 4))
    before = scores.copy()
    for normalise in (True, False):
        sequence_scores(scores, 2, normalise=normalise)
    np.testing.assert_array_equal(scores, before)
    assert sequence_scores(np.array([[1.0, 2.0], [3.0, 4.0]]), 2, normalise=False).tolist() == [[5.0]]


@pytest.mark.parametrize("tolerance", [0, 1, 3])
def test_all_pairs_of_a_window_agree_with_a_tolerance(tolerance: int) -> None:
    truth = truth_from_indices(np.arange(9), np.arange(9), tolerance)
    for length in (1, 4, 9):
        expected = np.array(
            [[all(truth[q + k, r + k] for k in range(length)) for r in range(10 - length)] for q in range(10 - length)]
        )
        np.testing.assert_array_equal(sequence_truth(truth, length), expected)


def test_a_window_is_true_where_its_first_query_is() -> None:
    truth = np.zeros((3, 4), dtype=bool)
    truth[0, 1] = truth[1, 3] = truth[2, 3] = True
    assert sequence_truth(truth, 2).tolist() == [[False, True, False], [False, False, False]]


@pytest.mark.parametrize("length", [0, -2])
def test_a_sequence_without_length_is_refused(length: int) -> None:
    with pytest.raises(InputError, match=f"sequence length is {length}, must be at least 1"):
        sequence_scores(np.ones((3, 3)), length)
    with pytest.raises(InputError, match=f"sequence length is {length}, must be at least 1"):
        SequenceMatcher(3, length)


def test_a_sequence_longer_than_the_route_is_refused() -> None:
    with pytest.raises(InputError, match="sequence length 4 exceeds the 3 queries; use a shorter sequence"):
        sequence_scores(np.ones((3, 9)), 4)
    with pytest.raises(InputError, match="sequence length 4 exceeds the 3 places; use a shorter sequence"):
        sequence_scores(np.ones((9, 3)), 4)
    with pytest.raises(InputError, match="sequence length 4 exceeds the 3 queries"):
        sequence_truth(np.ones((3, 3), dtype=bool), 4)
    with pytest.raises(InputError, match="sequence length 4 exceeds the 3 places"):
        SequenceMatcher(3, 4)


def test_scores_of_another_model_are_refused() -> None:
    with pytest.raises(InputError, match=r"scores of shape \(1, 4\) given to a matcher of 3 places; use one model"):
        SequenceMatcher(3, 2).update(np.ones((1, 4)))


QUERIES, PLACES = 40, 30


def drawn(seed: int, queries: int = QUERIES) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Scores with ties and silent queries, right more often than not, and a truth that some queries lack."""
    rng = np.random.default_rng(seed)
    scores = rng.integers(0, 6, (queries, PLACES)).astype(np.float64)
    where = np.arange(queries) % PLACES
    scores[np.arange(queries), where] += rng.integers(0, 9, queries)
    scores[rng.random(queries) < 0.1] = 0.0
    truth = np.zeros(scores.shape, np.bool_)
    truth[np.arange(queries), where] = rng.random(queries) < 0.9
    return scores, truth


@pytest.fixture(params=[1, 7, 40, 256])
def block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Queries in a block."""
    monkeypatch.setattr(against_truth, "BLOCK", request.param)
    return int(request.param)


@pytest.mark.parametrize("seed", range(3))
def test_each_query_alone(seed: int, block: int) -> None:
    scores, truth = drawn(seed)
    calibration = Calibration(np.array([[0.0, WRONG], [1.0, RIGHT], [0.2, WRONG], [2.0, RIGHT]], np.float32))
    made = InBlocks.made(scores)
    assert [rows.stop - rows.start for rows in made.rows()][:-1] == [block] * ((QUERIES - 1) // block)
    found = hold("contrast", made, truth, Together(calibration=calibration), keep=True)
    wanted = answers_of("contrast", scores, calibration)
    assert found.metrics == evaluate(scores, wanted.confidence, truth)
    for one, other in zip(found.answers[:3], wanted[:3], strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.scores is not None
    np.testing.assert_array_equal(found.scores, scores)
    assert hold("contrast", made, truth).scores is None


@pytest.mark.parametrize("length", [2, 10, PLACES])
def test_sequences(length: int, block: int) -> None:
    scores, truth = drawn(4)
    truth = sequences.sequence_truth(truth, length)
    found = hold("contrast", InBlocks.made(scores), truth, Together(length), keep=True)
    wanted = sequences.sequence_scores(scores, length)
    answers = answers_of("sequence", wanted)
    np.testing.assert_array_equal(found.scores, wanted)
    np.testing.assert_array_equal(found.answers.matches, answers.matches)
    assert found.metrics == evaluate(wanted, answers.confidence, truth)


@pytest.mark.parametrize("motion", ["any", "forward"])
@pytest.mark.parametrize("seed", range(2))
def test_a_filter_forward_and_back(motion: str, seed: int, block: int) -> None:
    scores, truth = drawn(seed)
    moving = np.random.default_rng(seed).random(QUERIES) < 0.7
    start = ForwardFilter.start(PLACES, motion)
    _, beliefs = filtered(start, scores, moving)
    found = follow("contrast", InBlocks.made(scores), truth, Together(motion=motion), moving)
    places, probability = beliefs.best()
    np.testing.assert_array_equal(found.answers.matches, places)
    np.testing.assert_array_equal(found.answers.probability, probability)
    assert found.filtered == evaluate(beliefs.places, probability, truth)
    beliefs, _ = smooth(start, scores, moving)
    assert found.smoothed == evaluate(beliefs.places, beliefs.best()[1], truth)


def test_no_queries() -> None:
    scores, truth = drawn(0, queries=0)
    found = hold("contrast", InBlocks.made(scores), truth)
    assert len(found.answers.matches) == 0
    assert np.isnan(found.metrics.recall_at_1)


def test_scores_are_made_a_block_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(against_truth, "BLOCK", 8)
    scores, truth = drawn(5)
    asked: list[int] = []

    def of(rows: slice) -> NDArray[np.float64]:
        asked.append(rows.stop - rows.start)
        return scores[rows]

    hold("contrast", InBlocks(QUERIES, PLACES, of), truth)
    assert asked == [8] * 5
