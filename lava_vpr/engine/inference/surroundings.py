"""What a place shares with its surroundings, the places before and after it on the route.

Neighbouring places show the same landscape, light and weather. What they share distinguishes them from other parts of
the route, but not from each other, and it misleads where the season changes it. With ``network.surroundings`` it is
subtracted from a neuron's weights, instead of the mean over all neurons. How much is subtracted is fitted by least
squares over all places of a stretch: how well neighbours predict a place. In a set without order they predict almost
nothing, and the mean over all neurons is subtracted.

Surroundings end at the ends of a stretch, so a stretch is learned the same way whatever it is joined with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

EXACT = 1 << 20
"""Weights are summed as whole numbers, in units of 1 / EXACT: such sums are equal in any order and on every machine."""
ALIKE = 0.25
"""Largest cosine between the weights (minus the mean) of two places that count as surroundings of each other; with a
larger one they show the same place. Set by hand: on Nordland 0:200 neither .15 nor .35 is better."""


class Shown(NamedTuple):
    """The references of one stretch, whose rates set the scale of its neurons.

    Attributes:
        rates: Their rates as queries, traverse after traverse, uint16 (images, inputs).
        neurons: The neurons that learned them.
        traverses: In how many traverses the places are shown.
    """

    rates: NDArray[np.uint16]
    neurons: slice
    traverses: int = 1


def own_places(weights: NDArray[np.float64], shown: Shown) -> NDArray[np.int64]:
    """The place of each neuron of a stretch, that of the reference that drives it most, int64 (neurons,).

    Args:
        weights: Of its neurons, whole numbers, (inputs, neurons).
        shown: The stretch.
    """
    drives = shown.rates.astype(np.float64) @ weights  # whole numbers below 2^53: exact in any order
    return drives.argmax(axis=0) % (len(shown.rates) // shown.traverses)


def surroundings(
    weights: NDArray[np.float64], common: NDArray[np.float64], reach: int, shown: Shown
) -> NDArray[np.float64]:
    """What the neurons of a stretch share with their surroundings, float64 (inputs, neurons).

    Args:
        weights: Weights of its neurons, norm 1, or 0 where nothing was learned, float64 (inputs, neurons).
        common: The mean over all neurons, float64 (inputs, 1): taken where there are no surroundings.
        reach: Number of places on either side that count as surroundings.
        shown: The stretch.
    """
    exact = np.rint(weights * EXACT)
    learning, places = np.flatnonzero(exact.any(axis=0)), len(shown.rates) // shown.traverses
    own = own_places(exact, shown)
    sums, counts = np.zeros((len(exact), places)), np.zeros(places)
    np.add.at(sums.T, own[learning], exact.T[learning])
    np.add.at(counts, own[learning], 1.0)
    mean = common * EXACT
    apart = sums - counts * mean
    unit = apart / np.maximum(np.linalg.norm(apart, axis=0), 1.0)
    around, many = np.zeros_like(sums), np.zeros(places)
    for distance in range(1, min(reach, places - 1) + 1):
        first, second = slice(0, places - distance), slice(distance, places)
        counted = np.einsum("ip,ip->p", unit[:, first], unit[:, second]) <= ALIKE
        for one, other in ((first, second), (second, first)):
            around[:, one] += sums[:, other] * counted
            many[one] += counts[other] * counted
    near = np.where(many > 0, around / np.maximum(many, 1.0) - mean, 0.0)
    alone = apart / np.maximum(counts, 1.0)
    size = float(np.sum(near[:, counts > 0] ** 2))
    told = min(1.0, max(0.0, float(np.sum(alone * near)) / size)) if size > 0 else 0.0
    return np.asarray(common + told * near[:, own] / EXACT)
