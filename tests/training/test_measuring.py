"""Calibration: what is measured of the references, beside plain loops, and that it tells known from unknown images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import encoded, small_config, small_model

from lava_vpr import model as model_file
from lava_vpr.backends.asking import calibration_of
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.random import image_keys, presentation_key, presentation_keys, uniform
from lava_vpr.engine.rates import query_rates16
from lava_vpr.errors import ModelFileError
from lava_vpr.learning.route import train as train_images
from lava_vpr.matching.decoders import decode
from lava_vpr.matching.probability import KINDS, OFF_MAP, RIGHT
from lava_vpr.model import IntegerModel, Model, integer_model
from lava_vpr.storage import container
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import altered, calibrated, measured

PARTS = (
    ([0, 1, 2, 3, 4], [1, 2, 3]),
    ([5, 6, 7, 8, 9], [6, 7, 8]),
    ([10, 11, 12, 13, 14], [11, 12, 13]),
    ([15, 16, 17, 18, 19], [16, 17, 18]),
    ([17, 18, 19, 0, 1], [0, 19]),
    ([2, 3, 4, 5, 6], [4, 5]),
    ([7, 8, 9, 10, 11], [9, 10]),
    ([12, 13, 14, 15, 16], [14, 15]),
)
"""Of a route of 20 places: each quarter that is left out, four and then four half a quarter on, the route taken as a
ring; and which of it are asked, those at most an eighth of the route from the quarter's middle."""


@pytest.fixture(scope="module")
def model() -> IntegerModel:
    return integer_model(small_model(), "a test")


def of_images() -> IntegerModel:
    """20 places in two traverses, each much like its neighbours; two of the neurons respond to none of them."""
    config = small_config(learning={"rule": "template", "epochs": 1})
    own, other = encoded(20), encoded(20, noise=0.3)
    made = train(
        [replace(one, activity=sum(np.roll(one.activity, k, 0) for k in range(-3, 4))) for one in (own, other)], config
    )
    responses = made.responses.copy()
    responses[[3, 12]] = 0
    return integer_model(replace(made, responses=responses), "a test")


def of_vectors(places: int = 20) -> IntegerModel:
    """A map of vectors, by a decoder that needs its setting."""
    settings = {
        "decoder": {"default": "weighted", "gamma": 0.3},
        "learning": {"rule": "template", "epochs": 1, "steps": 64},
    }
    vectors = np.random.default_rng(0).normal(size=(places, 30))
    made = train_images(vectors, config=update(preset("loihi"), settings), threads=1)
    return integer_model(replace(made, calibration=None), "a test")


def asked(
    model: IntegerModel, shown: NDArray[np.float32], noise: int, neurons: list[int], places: list[int]
) -> tuple[float, int]:
    """The margin of one presentation to some of the neurons, scored for some of the places; and the best, or -1."""
    rates = query_rates16(shown[None], model.config.encoder)
    keys = presentation_keys(model.config.seed, "calibration", image_keys(rates), noise)
    network = replace(
        model.network,
        weights=np.ascontiguousarray(model.network.weights[:, neurons]),
        bias=np.ascontiguousarray(model.network.bias[neurons]),
    )
    counts, _, _ = count_spikes(network, rates, keys)
    responses = np.ascontiguousarray(model.responses[neurons][:, places])
    decoder = model.config.decoder
    scores = decode(decoder.default, responses, counts, gamma=decoder.gamma)[0].tolist()
    first, second = sorted(scores, reverse=True)[:2]
    return first - second, places[scores.index(first)] if first > 0 else -1


def literal(model: IntegerModel, shares: Sequence[float], channels: int) -> list[list[float]]:
    """The samples of a model of 20 places, one presentation after another."""
    everything, everywhere, points = list(range(model.neurons)), list(range(20)), model.activity.shape[1] // channels
    samples = []
    for repeat in range(4):
        for place in everywhere:
            draws = uniform(presentation_key(model.config.seed, "calibration", place, repeat), 2 * points)
            shown = model.activity[place].copy()
            for point in range(points):
                if draws[point] < shares[(place + repeat) % len(shares)]:
                    for at in range(point, channels * points, points):
                        shown[at] = model.activity[int(20 * draws[points + point]), at]
            margin, best = asked(model, shown, repeat, everything, everywhere)
            samples.append([margin, 1.0 if best == place else 0.0])
    return samples + _without_parts(model) + (_varied(model) if channels == 1 else [])


def _without_parts(model: IntegerModel) -> list[list[float]]:
    """The samples off the map."""
    everything, everywhere, samples = list(range(model.neurons)), list(range(20)), []
    for number, (gone, amid) in enumerate(PARTS, start=1):
        spikes = model.responses.tolist()
        left = [neuron for neuron in everything if not any(spikes[neuron]) or _first(spikes[neuron]) not in gone]
        others = [place for place in everywhere if place not in gone]
        for repeat in range(4):
            for place in amid:
                margin, _ = asked(model, model.activity[place], 4 * number + repeat, left, others)
                samples.append([margin, -1.0])
    return samples


def _varied(model: IntegerModel) -> list[list[float]]:
    """Those of references altered by 0.7, 0.8 and 0.9 in turns, in the second and fourth turn seen otherwise."""
    activity, inputs, samples = model.activity[:20], model.activity.shape[1], []
    for turn in range(4):
        for place in range(20):
            noise = 4 * 9 + turn
            draws = uniform(presentation_key(model.config.seed, "calibration", place, noise), 2 * inputs)
            share = (0.7, 0.8, 0.9)[(place + noise) % 3]
            shown = np.array(
                [activity[int(20 * draws[inputs + at]) if draws[at] < share else place, at] for at in range(inputs)],
                np.float32,
            )
            if turn in (1, 3):
                shown = otherwise(shown, model.config.encoder.layout.grid, place + turn)
            margin, best = asked(model, shown, noise, list(range(model.neurons)), list(range(20)))
            samples.append([margin, 3.0 if best == place else 2.0])
    return samples


def otherwise(image: NDArray[np.float32], grid: int, turn: int) -> NDArray[np.float32]:
    """An image in another view, light, or with a corner covered; the sides are left, top, right and bottom."""
    kind, side = turn % 4, turn // 4 % 4
    made = image.copy()
    for at in range(len(image)):
        row, column = at // grid % grid, at % grid
        along = (column, row, grid - 1 - column, grid - 1 - row)[side]
        across = (row, grid - 1 - column, grid - 1 - row, column)[side]
        if kind == 1 and along:
            made[at] = (image[at] + image[at - (1, grid, -1, -grid)[side]]) / 2
        elif kind == 2:
            made[at] *= np.linspace(0.4, 1.6, grid, dtype=np.float32)[along]
        elif kind == 3 and along < grid // 2 and across < grid // 2:
            made[at] = 0.0
    return made


def _first(spikes: list[int]) -> int:
    return spikes.index(max(spikes))


def test_altered_images_and_missing_parts_by_plain_loops() -> None:
    model = of_images()
    wanted = np.array(literal(model, [0.8], 1), np.float32)
    assert (wanted[80:, 0] > 0).mean() > 0.5
    assert {2.0, 3.0} <= set(wanted[:, 1].tolist())
    np.testing.assert_array_equal(measured(model).samples, wanted)


def test_altered_vectors_by_plain_loops() -> None:
    model = of_vectors()
    model = replace(model, config=update(model.config, {"decoder": {"default": "weighted", "gamma": 0.3}}))
    wanted = np.array(literal(model, [0.7, 0.8, 0.9], 2), np.float32)
    assert (wanted[:80, 1] == 1).any()
    assert (wanted[:80, 1] == 0).any()
    np.testing.assert_array_equal(measured(model).samples, wanted)


@pytest.mark.parametrize(
    ("places", "on_map", "off_map"),
    [
        (3, 4 * 3, 4 * 3),  # each place is a part of its own; half a part on, none is amid one
        (200, 3 * 200, 3 * 8 * 26),  # parts of 50 places, 26 amid each
        (1000, 2 * 500, 2 * 8 * 63),  # every other place; parts of 250, every other of the 126 amid each
    ],
)
def test_long_maps_are_sampled(places: int, on_map: int, off_map: int) -> None:
    kinds = measured(of_vectors(places)).samples[:, 1]
    assert (np.count_nonzero(kinds >= 0), np.count_nonzero(kinds < 0)) == (on_map, off_map)


def test_what_was_calibrated_stays(model: IntegerModel) -> None:
    known = replace(model, calibration=np.array([[7, 1], [2, -1]], np.float32))
    assert calibrated(known) is known


def test_it_is_a_function_of_the_model_alone(model: IntegerModel) -> None:
    first, again = measured(model), measured(model, Pool(2))
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
    assert kept.mean() == pytest.approx(0.2 + 0.8 / 12, abs=0.02)  # a fifth, and the draws that fall on itself
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
def test_a_file_with_another_one_is_refused(
    model: Model, samples: NDArray[np.float32], words: str, tmp_path: Path
) -> None:
    header, arrays = model_file.content(model)
    container.save(tmp_path / "m.lvpr", "model", header, {**arrays, "calibration": samples})
    with pytest.raises(ModelFileError, match=words):
        model_file.load(tmp_path / "m.lvpr")
