"""Answers held against the truth block by block are those of all queries at once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.matching import answers, sequences
from lava_vpr.matching.answers import InBlocks, Together, answers_of, follow, hold
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.matching.forward_filter import Belief, ForwardFilter, filtered, smooth
from lava_vpr.matching.probability import RIGHT, WRONG, Calibration

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
    monkeypatch.setattr(answers, "BLOCK", request.param)
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
    start = ForwardFilter(Belief.unknown(PLACES), motion)
    _, beliefs = filtered(start, scores, moving)
    found = follow("contrast", InBlocks.made(scores), truth, Together(motion=motion), moving)
    places, probability = beliefs.best()
    np.testing.assert_array_equal(found.answers.matches, places)
    np.testing.assert_array_equal(found.answers.probability, probability)
    assert found.filtered == evaluate(beliefs.places, probability, truth)
    smooth(start, beliefs, scores, moving)
    assert found.smoothed == evaluate(beliefs.places, beliefs.best()[1], truth)


def test_no_queries() -> None:
    scores, truth = drawn(0, queries=0)
    found = hold("contrast", InBlocks.made(scores), truth)
    assert len(found.answers.matches) == 0
    assert np.isnan(found.metrics.recall_at_1)


def test_scores_are_made_a_block_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers, "BLOCK", 8)
    scores, truth = drawn(5)
    asked: list[int] = []

    def of(rows: slice) -> NDArray[np.float64]:
        asked.append(rows.stop - rows.start)
        return scores[rows]

    hold("contrast", InBlocks(QUERIES, PLACES, of), truth)
    assert asked == [8] * 5
