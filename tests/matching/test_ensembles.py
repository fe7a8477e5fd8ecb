"""Ensembles, beside a literal sum; hyperactive neurons, beside a literal count."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from lava_vpr.errors import InputError
from lava_vpr.matching.ensembles import (
    MOST_THRESHOLDS,
    calibrated_theta,
    foreign_images,
    hyperactive,
    in_order,
    thresholds,
    together,
    without,
)

SCORES = st.integers(0, 5).map(float)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_members_in_any_order_add_up_place_by_place(data: st.DataObject) -> None:
    n, places, members = (data.draw(st.integers(1, most)) for most in (4, 6, 4))
    orders = [np.array(data.draw(st.permutations(range(places)))) for _ in range(members)]
    scores = [data.draw(arrays(np.float64, (n, places), elements=SCORES)) for _ in range(members)]
    found = together([in_order(some, order) for some, order in zip(scores, orders, strict=True)])
    for query in range(n):
        for place in range(places):
            parts = [scores[m][query, k] for m in range(members) for k in range(places) if orders[m][k] == place]
            assert found[query, place] == sum(parts)


def test_members_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=re.escape("scores of shapes (1, 2), (1, 3)")):
        together([np.zeros((1, 2)), np.zeros((1, 3))])
    with pytest.raises(InputError, match="scores of shapes none"):
        together([])
    with pytest.raises(InputError, match=re.escape("the order of 2 places does not fit scores (1, 2)")):
        in_order(np.zeros((1, 2)), np.array([0, 0]))


def test_what_was_given_stays() -> None:
    first = np.ones((1, 2))
    together([first, first])
    assert first.tolist() == [[1.0, 1.0]]


COUNTS = np.array([[3, 0, 1], [1, 0, 0], [0, 2, 4], [5, 0, 1]])
IMAGES, NEURONS = np.array([0, 0, 1, 1]), np.array([0, 0, 1])


def literally(counts: np.ndarray, images: np.ndarray, neurons: np.ndarray) -> list[int]:
    """Count, neuron by neuron and image by image."""
    found = []
    for i in range(counts.shape[1]):
        number = 0
        for k in range(counts.shape[0]):
            if images[k] != neurons[i] and counts[k, i] > 0:
                number += 1
        found.append(number)
    return found


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_foreign_images_are_those_of_other_modules(data: st.DataObject) -> None:
    n, neurons = data.draw(st.integers(1, 9)), data.draw(st.integers(1, 7))
    counts = data.draw(arrays(np.int32, (n, neurons), elements=st.integers(0, 3)))
    images = data.draw(arrays(np.int64, n, elements=st.integers(0, 2)))
    owners = data.draw(arrays(np.int64, neurons, elements=st.integers(0, 3)))
    assert foreign_images(counts, images, owners).tolist() == literally(counts, images, owners)


def test_a_neuron_is_hyperactive_from_theta_on() -> None:
    foreign = foreign_images(COUNTS, IMAGES, NEURONS)
    assert foreign.tolist() == [1, 1, 1]
    assert hyperactive(np.array([0, 1, 2, 3]), 2).tolist() == [False, False, True, True]
    with pytest.raises(InputError, match="theta_hyper is 0, must be at least 1"):
        hyperactive(foreign, 0)


def test_removed_neurons_do_not_spike_and_others_do_as_before() -> None:
    kept = without(COUNTS, np.array([True, False, False]))
    assert kept[:, 0].tolist() == [0, 0, 0, 0]
    assert np.array_equal(kept[:, 1:], COUNTS[:, 1:])
    assert COUNTS[0, 0] == 3


def test_modules_must_fit_the_counts() -> None:
    with pytest.raises(InputError, match=re.escape("counts of shape (4, 3) have modules of 3 images and 3 neurons")):
        foreign_images(COUNTS, IMAGES[:3], NEURONS)


def test_every_threshold_takes_out_other_neurons_the_first_none() -> None:
    foreign = np.array([0, 4, 4, 9, 1])
    found = thresholds(foreign).tolist()
    assert found == [10, 9, 4, 1]
    assert [int(hyperactive(foreign, theta).sum()) for theta in found] == [0, 1, 3, 4]
    assert thresholds(np.zeros(3, np.int64)).tolist() == [1]
    many = thresholds(np.arange(500))
    assert len(many) == MOST_THRESHOLDS
    assert (many[0], many[-1]) == (500, 1)


def test_calibration_takes_the_best_threshold_and_of_equal_ones_the_largest() -> None:
    foreign, worth = np.array([1, 5, 8, 2]), {9: 0.5, 8: 0.7, 5: 0.7, 2: 0.6, 1: 0.1}
    assert calibrated_theta(foreign, lambda theta: worth[theta]) == 8
    assert calibrated_theta(foreign, lambda theta: 0.5) == 9
    assert calibrated_theta(foreign, lambda theta: -theta) == 1
