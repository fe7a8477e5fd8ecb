"""Recruiting: who has no neuron, who has no place, and that nobody else learns."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.config import Config, StdpLearning, preset
from lava_vpr.configfile import update
from lava_vpr.engine.learning.recruiting import Thresholds, key_again, recruit, rounds, unpaired
from lava_vpr.engine.random import image_keys, presentation_key
from lava_vpr.model import Stretch
from lava_vpr.training.trainers import StretchTrainer, rule_of

PLACES = 3


def counts(*rows: list[int]) -> NDArray[np.int64]:
    return np.array(rows, np.int64)


@pytest.mark.parametrize(
    ("shown", "places", "neurons"),
    [
        (counts([5, 0, 0], [0, 5, 0], [0, 0, 5]), [], []),
        (counts([5, 1, 0], [0, 0, 9], [0, 0, 4]), [2], [1]),  # two neurons share a place, a third holds two
        (counts([5, 5, 0], [0, 0, 0], [0, 0, 4]), [1], [1]),  # of equals the first has the place
        (counts([0, 0, 0], [0, 0, 0], [0, 0, 0]), [0, 1, 2], [0, 1, 2]),
        (counts([3, 3, 0], [3, 0, 0], [0, 3, 0]), [1, 2], [1, 2]),  # equal counts: a neuron's place is the first
    ],
)
def test_who_is_without(shown: NDArray[np.int64], places: list[int], neurons: list[int]) -> None:
    assert unpaired(shown) == (places, neurons)


def test_of_more_neurons_than_places_the_strongest_has_the_place() -> None:
    assert unpaired(counts([2, 3, 0, 1], [0, 0, 0, 0])) == ([1], [0, 2, 3])


def test_a_place_is_learned_by_who_spikes_most_and_by_nobody_else() -> None:
    theta = np.array([7.0, 8.0, 9.0, 10.0], np.float32)
    seen: list[tuple[int, int, list[float]]] = []

    def show(place: int, times: int) -> NDArray[np.int64]:
        seen.append((place, times, theta.tolist()))
        return np.where(theta < 100, [0, 2, 0, 5], 0)

    shown = counts([9, 0, 0, 0], [0, 0, 0, 0], [0, 0, 9, 0], [0, 0, 0, 0])
    assert recruit(Thresholds(theta, 1.0, 100.0), shown, 2, show)
    held = 100.0
    assert seen == [
        (1, 1, [held, 1.0, held, 1.0]),
        (1, 2, [held, held, held, 1.0]),
        (3, 1, [held, 1.0, held, held]),
        (3, 2, [held, 1.0, held, held]),
    ]
    assert theta.tolist() == [7.0, 8.0, 9.0, 10.0]


def test_a_place_that_nobody_spikes_for_stays_without() -> None:
    theta = np.ones(2, np.float32)
    seen: list[int] = []

    def show(place: int, times: int) -> NDArray[np.int64]:
        seen.append(place)
        return np.array([0, 0 if place == 0 else 3])

    assert recruit(Thresholds(theta, 1.0, 100.0), counts([0, 0], [0, 0]), 3, show)
    assert seen == [0, 1, 1, 1]


def test_a_stop_is_told() -> None:
    theta = np.ones(1, np.float32)
    assert not recruit(Thresholds(theta, 1.0, 100.0), counts([0]), 1, lambda place, times: None)


def test_as_often_as_the_second_phase_shows_all() -> None:
    assert rounds(StdpLearning()) == 4
    assert rounds(StdpLearning(epochs=1)) == 0
    assert rounds(StdpLearning(recruit=False)) == 0


def test_every_time_has_noise_of_its_own() -> None:
    assert key_again(5, 0) == 5
    assert len({key_again(key, times) for key in (5, 6) for times in range(4)}) == 8


def config(**learning: object) -> Config:
    return update(preset("loihi"), {"learning": {"epochs": 4, "competition_epochs": 2, "steps": 100, **learning}})


@pytest.mark.parametrize("arithmetic", ["float", "integer"])
def test_neurons_that_have_a_place_learn_nothing_more(arithmetic: str) -> None:
    settings = config(arithmetic=arithmetic)
    trainer: StretchTrainer = rule_of(settings).trainer(
        settings, Stretch(0, PLACES, 0, PLACES), 0, np.zeros((0, 0), np.float32)
    )
    inputs = settings.encoder.inputs
    rates = np.zeros((PLACES, inputs), np.uint16)
    for place, row in enumerate(rates):
        row[place::PLACES] = round(65536 * 12 * PLACES / inputs)
    keys = image_keys(rates)
    trainer.begin_epoch(2)
    thresholds = trainer.thresholds()
    assert thresholds is not None

    def show(place: int, times: int) -> NDArray[np.int32]:
        return trainer.present(rates[place], presentation_key(0, "train", int(keys[place]), times), place, 2)

    before, theta = trainer.state()["weights"].copy(), thresholds.theta.copy()
    assert recruit(thresholds, counts([9, 0, 0], [0, 9, 0], [0, 0, 0]), 3, show)
    after = trainer.state()["weights"]
    first, second = (
        weights / np.linalg.norm(weights, axis=0) for weights in (before.astype(float), after.astype(float))
    )
    turned = 1 - (first * second).sum(axis=0)
    assert turned[:2].max() < 0.002, "more than normalising changes, which rounds"
    assert turned[2] > 0.05
    own = after[:, 2].astype(float)
    assert own[2::PLACES].mean() > 1.5 * own[0::PLACES].mean()
    assert np.array_equal(thresholds.theta, theta)
