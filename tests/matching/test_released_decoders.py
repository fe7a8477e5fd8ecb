"""The paper's decoders on the released responses of its network: what the released code makes of them."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import small_model

from lava_vpr.config import preset
from lava_vpr.matching import decoders, equations
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.evaluation import evaluate, truth_from_indices
from lava_vpr.model import decode as model_decode


@pytest.fixture(scope="module")
def released(data_root: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    path = data_root / "oracle" / "vprsnn_train_counts.npz"
    if not path.is_file():
        pytest.skip(f"needs the released spike counts {path.name}")
    with np.load(path) as stored:
        return stored["counts"], stored["labels"]


def responses_of(counts: NDArray[Any], labels: NDArray[Any]) -> NDArray[Any]:
    responses = np.zeros((counts.shape[1], 100), np.int64)
    np.add.at(responses.T, labels, counts.astype(np.int64))
    return responses


@pytest.mark.data
def test_assignments_of_the_released_responses(released: tuple[NDArray[Any], NDArray[Any]]) -> None:
    counts, labels = released
    assignments = equations.assign(responses_of(counts, labels))
    assert assignments[:10].tolist() == [54, 95, 57, 1, 14, 75, 62, 48, 87, 46]
    assert hashlib.sha1(assignments.astype("<i2").tobytes()).hexdigest().startswith("29082fa7c84d")
    per_label = np.bincount(assignments, minlength=100)
    assert (per_label.min(), per_label.max(), len(per_label)) == (2, 6, 100)


@pytest.mark.data
@pytest.mark.parametrize("variant", ["vprsnn2022", "vprsnn"])
@pytest.mark.parametrize(
    ("first", "standard", "probability", "weighted_sums", "standard_sum"),
    [
        (400, (0.67, 0.99615), (0.87, 0.99845), (594.741284, 426.361221), 425.25),
        (500, (0.96, 0.99959), (0.92, 0.99922), (560.804193, 412.800634), 422.616667),
    ],
)
def test_released_decoders_on_the_released_responses(
    released: tuple[NDArray[Any], NDArray[Any]],
    variant: Any,
    first: int,
    standard: tuple[float, float],
    probability: tuple[float, float],
    weighted_sums: tuple[float, float],
    standard_sum: float,
) -> None:
    counts, labels = released
    responses, spikes = responses_of(counts[:400], labels[:400]), counts[first : first + 100]
    truth = truth_from_indices(labels[first : first + 100], np.arange(100))
    figures, sums = {}, {}
    for name in ("standard", "probability", "weighted", "weighted_probability"):
        scores = decoders.decode(name, responses, spikes, variant=variant)
        result = evaluate(scores, confidence(name, scores), truth, pr="vprsnn")
        figures[name] = (round(result.recall_at_100_precision, 2), round(result.auc, 5))
        sums[name] = scores.sum()
    assert figures["standard"] == standard
    assert figures["probability"] == probability
    assert figures["weighted"] == (1.0, 1.0)
    assert sums["standard"] == pytest.approx(standard_sum, abs=5e-7)
    assert sums["weighted"] == pytest.approx(weighted_sums[variant == "vprsnn"], abs=5e-7)


@pytest.mark.data
@pytest.mark.parametrize("preset_name", ["loihi", "fast", "paper"])
def test_every_preset_means_the_release_of_the_paper(
    released: tuple[NDArray[Any], NDArray[Any]], preset_name: str
) -> None:
    """What `eval` shows of the released spikes are the released sums, whatever the preset."""
    counts, labels = released
    config = preset(preset_name)
    model = replace(small_model(), config=config, responses=responses_of(counts[:400], labels[:400]))
    spikes = counts[400:500].astype(np.int32)
    assert model_decode(model, spikes, "standard").sum() == pytest.approx(425.25, abs=5e-7)
    assert model_decode(model, spikes, "weighted").sum() == pytest.approx(594.741284, abs=5e-7)
    truth = truth_from_indices(labels[400:500], np.arange(100))
    scores = model_decode(model, spikes, "probability")
    result = evaluate(scores, confidence("probability", scores), truth, pr="vprsnn")
    assert round(result.recall_at_100_precision, 2) == 0.87
