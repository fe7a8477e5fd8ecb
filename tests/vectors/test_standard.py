"""What vectors are measured by: mean, scale and projection, against plain matrices."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy.linalg import hadamard as matrix
from support.common.imagefiles import refused

from lava_vpr import model as model_file
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import encode_traverse
from lava_vpr.engine.random import presentation_key, uniform
from lava_vpr.errors import ConfigError, InputError, ModelFileError
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.inputs.vectors import Standard, hadamard, picture_of, signed_channels, width_for, without_weak
from lava_vpr.learning.route import train
from lava_vpr.matching.probability import RIGHT
from lava_vpr.training.measuring import altered
from lava_vpr.training.preparing import fitted, settings_for, standard_like
from lava_vpr.traverse import Traverse, vector_traverse
from lava_vpr.vectors.files import Vectors


def traverse(array: NDArray[np.float32], name: str = "v.npy") -> Traverse:
    return vector_traverse(name, Vectors(array))


def vectors(n: int, values: int, seed: int = 0) -> NDArray[np.float32]:
    drawn = np.random.default_rng(seed).normal(size=(n, values)) * np.linspace(1, 5, values) + 3
    return drawn.astype(np.float32)


def of(array: NDArray[np.float32], **encoder: object) -> Config:
    base = preset("loihi")
    config = dataclasses.replace(base, encoder=dataclasses.replace(base.encoder, **encoder))  # type: ignore[arg-type]
    return settings_for(config, [traverse(array)])


@pytest.mark.parametrize("width", [1, 2, 8, 128])
def test_the_transform_is_the_hadamard_matrix(width: int) -> None:
    rows = vectors(5, width)
    expected = rows.astype(np.float64) @ matrix(width).T / width**0.5
    assert np.allclose(hadamard(rows), expected, rtol=1e-5, atol=1e-5)


def test_a_transform_is_no_wider_than_it_must_be() -> None:
    assert [width_for(values) for values in (1, 2, 3, 64, 65, 4096)] == [1, 2, 4, 64, 128, 4096]


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 70), st.integers(1, 6), st.integers(0, 5))
def test_a_projection_is_the_same_alone_and_with_others(values: int, kept: int, seed: int) -> None:
    array = vectors(7, values, seed)
    config = of(array, vector_kept=kept)
    standard = fitted(config, [traverse(array)])
    together = standard.seen(array)
    assert together.shape == (7, min(values, kept))
    for one, row in zip(together, array, strict=True):
        assert np.array_equal(standard.seen(row[None])[0], one)


def test_a_projection_is_signs_transform_and_choice() -> None:
    array = vectors(40, 100)
    config = of(array, vector_kept=60)
    standard = fitted(config, [traverse(array)])
    assert standard.projects
    assert len(standard.signs) == width_for(100) == 128
    assert len(set(standard.kept.tolist())) == 60
    wide = np.zeros((40, 128))
    wide[:, :100] = standard.standardised(array)
    expected = (wide * standard.signs) @ matrix(128).T / 128**0.5
    assert np.allclose(standard.seen(array), expected[:, standard.kept], atol=1e-4)
    draws = uniform(presentation_key(0, "projection", 0), 256).tolist()
    assert standard.signs.tolist() == [1 if draw < 0.5 else -1 for draw in draws[:128]]
    assert standard.kept.tolist() == sorted(sorted(range(128), key=draws[128:].__getitem__)[:60])
    other = fitted(dataclasses.replace(config, seed=1), [traverse(array)])
    assert not standard.same(other)
    # Angles stay nearly what they are.
    cosines = [np.corrcoef(x)[np.triu_indices(40, 1)] for x in (standard.standardised(array), standard.seen(array))]
    assert np.corrcoef(*cosines)[0, 1] > 0.5


@pytest.mark.parametrize("scale", ["shared", "own"])
def test_mean_and_scale_are_those_of_all_references(scale: str) -> None:
    array = vectors(50, 12)
    array[:, 4] = 7.0  # says nothing
    two = [traverse(array[:30]), traverse(array[30:])]
    standard = fitted(of(array, vector_scale=scale), two)
    assert np.allclose(standard.mean, array.mean(axis=0), atol=1e-5)
    spread = array.astype(np.float64).std(axis=0)
    shared = np.sqrt((spread**2).mean())
    expected = np.maximum(spread, 1e-3 * shared) if scale == "own" else np.full(12, shared)
    assert np.allclose(standard.scale, expected, rtol=1e-5)
    assert not standard.projects
    assert np.allclose(standard.seen(array), (array - array.mean(axis=0)) / expected, atol=1e-2)


def test_values_stay_within_a_million_deviations() -> None:
    none = np.zeros(0, np.int8)
    standard = Standard(np.full(5, 3, np.float32), np.full(5, 0.5, np.float32), none, none.astype(np.int32))
    found = standard.seen(np.array([[4, -250_000, 499_000, 600_000, -1e18]], np.float32))
    assert found.tolist() == [[2, -500_006, 997_994, 1_000_000, -1_000_000]]


def test_weak_values_are_silent_and_the_others_keep_their_sign() -> None:
    values = np.array([4, -1, 0.5, -2.5], np.float32)  # mean magnitude 2
    assert np.array_equal(without_weak(values, 0.5), np.array([3, 0, 0, -1.5], np.float32))
    assert np.array_equal(signed_channels(without_weak(values, 0.5)), np.array([3, 0, 0, 0, 0, 0, 0, 1.5], np.float32))
    assert np.array_equal(without_weak(np.zeros(3, np.float32), 0.5), np.zeros(3))
    assert np.array_equal(without_weak(values, 0), values)


def test_settings_follow_from_the_references() -> None:
    array = vectors(4, 9)
    config = of(array)
    assert (config.encoder.kind, config.encoder.vector_values, config.encoder.query_inputs) == ("vector", 9, 0)
    assert config.encoder.inputs == 18
    assert (config.learning.steps, preset("loihi").learning.steps) == (700, 350)
    assert of(array, kind="rates").encoder.inputs == 9
    assert of(array, kind="vector", query_inputs=7).encoder.query_inputs == 7
    assert of(vectors(4, 3000)).encoder.inputs == 2 * EncoderConfig().vector_kept
    base, (shown, wider) = preset("loihi"), (traverse(array), traverse(vectors(4, 10), "w.npy"))
    sideways = dataclasses.replace(base, views=dataclasses.replace(base.views, shifts=3))
    valued = dataclasses.replace(base, encoder=dataclasses.replace(base.encoder, vector_values=8))
    for config, traverses, text in (
        (valued, [shown], r"encoder\.vector_values is 8, but v\.npy holds vectors of 9 values"),
        (base, [shown, wider], r"w\.npy: holds vectors of 10 values, but the model learned those of 9"),
        (sideways, [shown], "a vector has one view; set views"),
        (preset("paper"), [shown], r"the conductance network takes encoder\.kind 'pixels', not 'vector'"),
    ):
        with pytest.raises((ConfigError, InputError), match=text):
            settings_for(config, traverses)


def test_equal_vectors_and_negative_rates_are_refused() -> None:
    same = np.ones((5, 4), np.float32)
    refused(lambda: fitted(of(same), [traverse(same)]), "v.npy: all vectors are equal, so nothing tells places apart")
    array = -vectors(3, 4)
    config = of(array, kind="rates")
    refused(
        lambda: encode_traverse(traverse(array), config.encoder),
        "vector 000000: value 0 is -",
        ", but rates are at least 0; use the input 'vec",
    )


def test_another_models_standard_must_fit() -> None:
    array = vectors(6, 20)
    config = of(array)
    standard = fitted(config, [traverse(array)])
    assert standard_like(standard, config) is standard
    for other, wanted, text in (
        (None, config, "--standard names a model that was not trained with vectors"),
        (standard, of(vectors(6, 21)), "of vectors of 20 values, 20 of them seen, but these are of 21, 21 seen"),
        (standard, of(array, vector_kept=10), "but these are of 20, 10 seen"),
    ):
        with pytest.raises(ConfigError, match=text):
            standard_like(other, wanted)


def test_a_vector_is_pictured_row_by_row() -> None:
    picture = picture_of(np.arange(12, dtype=np.float32), (4, 3))
    assert picture.shape == (3, 4, 3)
    brightness = picture.astype(int).sum(axis=2).ravel()
    assert brightness[0] < brightness[5] < brightness[11]
    assert len(np.unique(picture_of(np.full(7, 2.0, np.float32), (64, 48)).reshape(-1, 3), axis=0)) <= 2
    assert picture_of(np.zeros(100_000, np.float32), (64, 48)).shape == (48, 64, 3)


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
    assert model.standard.projects == (kept < VALUES)
    assert model.patches is None
    _, again = model_file.content(model)
    assert all(np.array_equal(again[name], array) for name, array in sound(kept)[1].items())
    assert (model.calibration[:, 1] == RIGHT).any()


def test_vectors_of_any_size_are_kept() -> None:
    """A descriptor of length 1 and 100,000 values has values of about 0.003, and varies less."""
    model = assembled(first("standard.scale", 1e-30))
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
