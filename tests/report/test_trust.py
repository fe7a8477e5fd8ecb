"""The section on probability: what it draws and tells are the figures that it was given."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.matching.answers import Answers, Together
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.matching.probability import OFF_MAP, RIGHT, UNREACHED, Calibration
from lava_vpr.matching.trust import Trust, trust
from lava_vpr.report.trust import reliability, section


def answers(seed: int, n: int = 80) -> tuple[Answers, NDArray[np.bool_]]:
    """Answers that are right as often as they say, a quarter of the queries off the map."""
    rng = np.random.default_rng(seed)
    matches, chance = rng.integers(0, 10, n), rng.random(n)
    truth = np.zeros((n, 10), bool)
    for number in range(n * 3 // 4):
        other = (matches[number] + 5) % 10
        truth[number, matches[number] if rng.random() < chance[number] else other] = True
    return Answers(matches, chance, chance), truth


@pytest.fixture(scope="module")
def found() -> dict[str, Trust]:
    """By both ways to answer."""
    (alone, truth), (followed, other) = answers(0), answers(1)
    calibrated = Together(calibration=Calibration(np.array([[9, RIGHT], [1, OFF_MAP]], np.float32)))
    made = {"single": trust(alone, truth, calibrated), "filtered": trust(followed, other, Together(motion="any"))}
    return {name: value for name, value in made.items() if value is not None}


def test_every_threshold_is_a_row(found: dict[str, Trust]) -> None:
    text = section(found, {})
    rows = re.findall(r'<tr><th scope="row">(.*?)</th>(.*?)</tr>', text)
    assert [title for title, _ in rows] == ["each image alone", "", "", "", "filtered", "", "", ""]
    for row, (_, cells) in zip((row for one in found.values() for row in one.thresholds), rows, strict=True):
        told = re.findall(r"<td>(.*?)</td>", cells)
        assert told[0] == f"{row.target:.2f}"
        for figure, cell in zip(row[2:], told[2:], strict=True):
            assert cell == ("–" if np.isnan(figure) else f"{figure:.3f}")
    assert "here 25.0 % are" in text
    assert UNREACHED not in text
    for one in found.values():
        assert f"{100 * one.error:.1f} %" in text


def test_where_no_probability_is_high_enough_the_page_names_the_remedies(found: dict[str, Trust]) -> None:
    rows = tuple(row._replace(probability=np.inf) for row in found["single"].thresholds)
    text = section(found | {"single": replace(found["single"], thresholds=rows, off_map=0.0)}, {})
    assert UNREACHED in text
    assert "here none is." in text


def test_every_bin_is_a_dot(found: dict[str, Trust]) -> None:
    drawing = reliability(found, "what it shows")
    assert 'aria-label="what it shows"' in drawing
    lines = len(re.findall(r"<use |<path ", drawing))
    assert lines >= sum(len(one.bins) for one in found.values())
    assert drawing == reliability(found, "what it shows")


def test_the_filter_is_told_in_words(found: dict[str, Trust]) -> None:
    rng = np.random.default_rng(3)
    scores, truth = rng.random((20, 5)), np.eye(20, 5, dtype=bool)
    figures = evaluate(scores, scores.max(axis=1), truth)
    text = section(found, {"filtered": figures, "forward_backward": figures})
    assert f"filtered {figures.recall_at_1:.3f} (AUC {figures.auc:.3f}); forward-backward" in text


def test_without_probabilities_there_is_no_section() -> None:
    assert section({}, {}) == ""
