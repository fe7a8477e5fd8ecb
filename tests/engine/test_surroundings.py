"""What a place shares with its surroundings, against the rule in plain words; edges, places alike, no order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.config import LifNetwork
from lava_vpr.engine.inference.quantise import distinctive, unit_norm
from lava_vpr.engine.inference.surroundings import ALIKE, Shown, own_places, surroundings
from lava_vpr.errors import ConfigError

INPUTS, PLACES, REACH = 200, 30, 4


def drive(seed: int, places: int = PLACES) -> NDArray[np.float64]:
    """Images of a route, (places, inputs): what all share, a landscape that changes slowly, and each place's own."""
    rng = np.random.default_rng(seed)
    steps = rng.random((places + 2 * REACH, INPUTS)) ** 4
    slow = np.stack([steps[k : k + 2 * REACH].mean(axis=0) for k in range(places)])
    return np.asarray(rng.random(INPUTS) + 2 * slow + rng.random((places, INPUTS)) ** 4)


def stretch(images: NDArray[np.float64], first: int = 0, traverses: int = 1) -> Shown:
    rates = np.round(images / images.sum(axis=1, keepdims=True) * 20 * 65536).astype(np.uint16)
    return Shown(np.concatenate([rates] * traverses), slice(first, first + len(images)), traverses)


def literal(weights: NDArray[np.float64], common: NDArray[np.float64], shown: Shown) -> NDArray[np.float64]:
    """`surroundings`, neuron after neuron and place after place."""
    places, neurons = range(len(shown.rates) // shown.traverses), range(weights.shape[1])
    drives = shown.rates.astype(float) @ weights
    place = [max(range(len(shown.rates)), key=lambda k: drives[k, j]) % len(places) for j in neurons]
    of = [[j for j in neurons if place[j] == number and weights[:, j].any()] for number in places]
    alone = {p: weights[:, of[p]].mean(axis=1) - common[:, 0] for p in places if of[p]}
    near = {}
    for p, own in alone.items():
        around = []
        for q in range(p - REACH, p + REACH + 1):
            if q != p and q in alone and own @ alone[q] <= ALIKE * np.linalg.norm(own) * np.linalg.norm(alone[q]):
                around += of[q]
        near[p] = weights[:, around].mean(axis=1) - common[:, 0] if around else np.zeros(len(common))
    told = sum(alone[p] @ near[p] for p in alone) / sum(near[p] @ near[p] for p in alone)
    share = min(1.0, max(0.0, told))
    taken = [near[place[j]] if place[j] in near else np.zeros(len(common)) for j in neurons]
    return np.asarray(common + share * np.stack(taken, axis=1))


def of_route(images: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    weights = unit_norm(images.T)
    return weights, weights.mean(axis=1, keepdims=True)


@pytest.mark.parametrize("case", ["a neuron a place", "two traverses", "any neuron", "silent", "alike"])
def test_against_the_rule_in_plain_words(case: str) -> None:
    images = drive(0)
    if case == "alike":
        images[::3] = 0.5 * images[::3] + 0.5 * images[1::3]
    weights, common = of_route(images)
    if case == "any neuron":  # in no order, some places with several, some without
        weights = weights[:, np.random.default_rng(1).integers(0, PLACES, 40)]
    if case == "silent":
        weights[:, [3, 4, 17]] = 0
    shown = stretch(images, traverses=2 if case == "two traverses" else 1)
    found, expected = surroundings(weights, common, REACH, shown), literal(weights, common, shown)
    living = weights.any(axis=0)
    np.testing.assert_allclose(found[:, living], expected[:, living], atol=1e-6)
    assert np.abs(found - common).max() > 0.01
    if case == "alike":  # and so it counts for nothing
        apart = unit_norm(weights - common)
        assert (np.diagonal(apart.T @ apart, 1)[::3] > ALIKE).all()


def test_a_neurons_place_is_that_of_the_reference_that_drives_it_most() -> None:
    images = drive(0)
    order = np.random.default_rng(2).permutation(PLACES)
    first = stretch(images)
    shown = Shown(np.concatenate([first.rates // 2, first.rates, first.rates // 3]), first.neurons, 3)
    assert own_places(unit_norm(images.T)[:, order], shown).tolist() == order.tolist()


def test_the_order_of_neurons_does_not_matter() -> None:
    images = drive(0)
    weights, common = of_route(images)
    order = np.random.default_rng(3).permutation(PLACES)
    whole = surroundings(weights, common, REACH, stretch(images))
    np.testing.assert_array_equal(surroundings(weights[:, order], common, REACH, stretch(images)), whole[:, order])


@pytest.mark.parametrize("seed", range(5))
def test_of_a_set_without_order_the_mean_over_all_is_taken_off(seed: int) -> None:
    """To the bit as without surroundings; the same images in the order of a drive are no such set."""
    images = drive(seed, 60)
    mixed = images[np.random.default_rng(seed).permutation(60)]
    for shown, ordered in ((images, True), (mixed, False)):
        learned = shown.T.astype(np.float32)
        found, plain = (distinctive(learned, LifNetwork(surroundings=k), [stretch(shown)]) for k in (REACH, 0))
        assert np.array_equal(found, plain) != ordered


def test_surroundings_end_with_the_stretch() -> None:
    """Two stretches of a drive know nothing of each other but what all neurons share."""
    whole = drive(0, 2 * PLACES)
    first, second = whole[:PLACES], whole[PLACES:]
    learned = whole.T.astype(np.float32)
    units = unit_norm(learned)
    common = units.mean(axis=1, keepdims=True)
    found = distinctive(learned, LifNetwork(surroundings=REACH), [stretch(first), stretch(second, PLACES)])
    parts = ((units[:, :PLACES], stretch(first)), (units[:, PLACES:], stretch(second)))
    taken = np.concatenate([literal(weights, common, shown) for weights, shown in parts], axis=1)
    np.testing.assert_allclose(found, unit_norm(units - taken), atol=1e-5)
    assert np.linalg.norm(found, axis=0) == pytest.approx(1)


def test_unsigned_weights_have_no_surroundings() -> None:
    with pytest.raises(ConfigError, match=r"network\.surroundings is 3, but must be 0 where signed is false; change"):
        LifNetwork(signed=False, surroundings=3)
