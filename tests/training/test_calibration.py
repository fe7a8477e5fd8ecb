"""Calibration: what is measured of the references, and that it tells known from unknown images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.common.small_models import small_model

from lava_vpr import model as model_file
from lava_vpr.backends.opening import calibration_of
from lava_vpr.errors import ModelFileError
from lava_vpr.matching.probability import KINDS, OFF_MAP, RIGHT
from lava_vpr.model import IntegerModel, Model, integer_model
from lava_vpr.training.calibration import altered, calibrated, measured


@pytest.fixture(scope="module")
def model() -> IntegerModel:
    return integer_model(small_model(), "a test")


def test_it_is_a_function_of_the_model_alone(model: IntegerModel) -> None:
    first, again = measured(model), measured(model, threads=2)
    assert np.array_equal(first.samples, again.samples)
    kinds = first.samples[:, 1]
    assert set(kinds.tolist()) <= set(KINDS)
    assert (kinds == OFF_MAP).any()
    assert (kinds == RIGHT).sum() >= model.places


def test_known_places_are_surer_than_unknown_ones(model: IntegerModel) -> None:
    samples = measured(model).samples
    right, off = (np.median(samples[samples[:, 1] == kind, 0]) for kind in (RIGHT, OFF_MAP))
    assert right > off


def test_altered_references_keep_what_they_should() -> None:
    activity = np.arange(12 * 500, dtype=np.float32).reshape(12, 500)
    places = np.array([3, 7])
    made = altered(activity, places, 0, 0)
    assert made.shape == (2, 500)
    kept = made == activity[places]
    assert 0.15 < kept.mean() < 0.4  # a fifth, and the draws that fall on itself
    assert (made % 500 == np.arange(500)).all()  # each input shows what it shows in some reference
    assert not np.array_equal(made, altered(activity, places, 0, 1))
    assert np.array_equal(altered(activity, places, 0, 0, share=0.0), activity[places])


def test_a_model_file_keeps_it(model: IntegerModel, tmp_path: Path) -> None:
    model_file.save(calibrated(model), tmp_path / "m.lvpr")
    found = model_file.load(tmp_path / "m.lvpr")
    assert found.calibration is not None
    calibration = calibration_of(found)
    assert calibration is not None
    assert np.array_equal(calibration.samples, measured(model).samples)


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        (np.zeros((0, 2), np.float32), "a calibration of shape"),
        (np.ones((4, 3), np.float32), "a calibration of shape"),
        (np.array([[1, 0.5]], np.float32), "neither right, wrong nor off the map"),
        (np.array([[-1, 1]], np.float32), "a negative margin"),
        (np.array([[np.nan, 1]], np.float32), "a negative margin"),
        (np.ones((4, 2), np.float64), "calibration"),
    ],
)
def test_a_file_with_another_one_is_refused(model: Model, samples: object, words: str, tmp_path: Path) -> None:
    model_file.save(replace(model, calibration=samples), tmp_path / "m.lvpr")  # type: ignore[arg-type]
    with pytest.raises(ModelFileError, match=words):
        model_file.load(tmp_path / "m.lvpr")
