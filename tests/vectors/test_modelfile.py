"""What a model file keeps of vectors, held against its format."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.errors import ModelFileError
from lava_vpr.learning.route import train
from lava_vpr.matching.probability import RIGHT
from lava_vpr.training.measuring import altered

Arrays = dict[str, NDArray[Any]]
KEPT, VALUES, PLACES = 6, 11, 5


@cache
def sound(kept: int = KEPT) -> tuple[str, Arrays]:
    """Header, as text, and arrays of a model of vectors, projected unless ``kept`` is as many as they have."""
    config = update(preset("loihi"), {"encoder": {"vector_kept": kept}, "learning": {"epochs": 2, "steps": 60}})
    vectors = np.random.default_rng(0).normal(size=(PLACES, VALUES))
    header, arrays = model_file.content(train(vectors, config=config, threads=1))
    return json.dumps(header), arrays


def assembled(forge: Callable[[dict[str, Any], Arrays], object], kept: int = KEPT) -> model_file.Model:
    text, arrays = sound(kept)
    header, own = json.loads(text), {name: array.copy() for name, array in arrays.items()}
    forge(header, own)
    return model_file.assemble(Path("a.lvpr"), header, own)


@pytest.mark.parametrize("kept", [KEPT, VALUES])
def test_a_sound_file_gives_the_same_model(kept: int) -> None:
    model = assembled(lambda header, arrays: None, kept)
    assert model.standard is not None
    assert model.standard.projects == (kept < VALUES)
    assert model.patches is None
    _, again = model_file.content(model)
    assert all(np.array_equal(again[name], array) for name, array in sound(kept)[1].items())
    assert model.calibration is not None
    assert (model.calibration[:, 1] == RIGHT).any()


def test_vectors_of_any_size_are_kept() -> None:
    """A descriptor of length 1 and 100,000 values has values of about 0.003, and varies less."""
    model = assembled(first("standard.scale", 1e-30))
    assert model.standard is not None
    assert model.standard.scale[0] == np.float32(1e-30)


def first(name: str, value: object) -> Callable[[dict[str, Any], Arrays], object]:
    return lambda header, arrays: arrays[name].reshape(-1).__setitem__(0, value)


def set_to(name: str, value: Callable[[NDArray[Any]], Any]) -> Callable[[dict[str, Any], Arrays], object]:
    return lambda header, arrays: arrays.__setitem__(name, value(arrays[name]))


@pytest.mark.parametrize(
    ("forge", "message"),
    [
        (lambda h, a: a.pop("vectors"), "vectors"),
        (lambda h, a: a.pop("standard.mean"), "standard.mean"),
        (first("vectors", np.nan), "vectors with values that are not finite"),
        (first("vectors", 1e30), "vectors with values from .* which must be in"),
        (first("standard.mean", np.inf), r"standard\.mean with values that are not finite"),
        (first("standard.scale", 0), r"standard\.scale with values from 0"),
        (first("standard.signs", 0), "a projection with a sign of 0"),
        (first("standard.signs", 3), r"standard\.signs with values from -1 to 3"),
        (first("standard.kept", 7), "numbers that do not ascend"),
        (set_to("standard.kept", lambda x: x + 16), r"standard\.kept with values from .* in 0\.\.15"),
        (set_to("standard.kept", lambda x: x[:-1]), r"standard\.kept of shape \(5,\) instead of \(6,\)"),
        (set_to("standard.signs", lambda x: x.astype(np.int16)), r"standard\.signs of type int16 instead of int8"),
        (set_to("vectors", lambda x: x[:, 1:]), r"vectors of shape \(5, 10\) instead of \(5, 11\)"),
        (lambda h, a: a.update(patches=np.zeros((5, 28, 28), np.uint8)), "an unexpected array 'patches'"),
        (lambda h, a: a.update(hog=np.zeros((5, 1764), np.uint8)), "an unexpected array 'hog'"),
        (lambda h, a: h["config"]["encoder"].update(vector_values=0), "inputs 'vector' of vectors without values"),
        (lambda h, a: h["config"]["encoder"].update(vector_scale="odd"), r"encoder\.vector_scale is 'odd'"),
        (lambda h, a: h["config"]["encoder"].update(kind="rates"), "standard|shape"),
    ],
)
def test_what_is_forged_is_refused(forge: Callable[[dict[str, Any], Arrays], object], message: str) -> None:
    with pytest.raises(ModelFileError, match=message) as told:
        assembled(forge)
    assert "\n" not in str(told.value)


def test_on_and_off_of_a_value_are_altered_together() -> None:
    activity = np.arange(8 * 600, dtype=np.float32).reshape(8, 600)
    places = np.array([2, 5])
    made = altered(activity, places, 0, 0, np.array([0.3, 0.9]), 2)
    changed = made != activity[places]
    assert np.array_equal(changed[:, :300], changed[:, 300:])
    from_which = (made - np.arange(600)) / 600
    assert np.array_equal(from_which[:, :300], from_which[:, 300:])
    assert 0.2 < changed[0].mean() < 0.35
    assert 0.7 < changed[1].mean() < 0.9
