"""Networks of several members or modules: scores that are added up, and hyperactive neurons that are taken out.

Members of an ensemble learned the same places with other seeds, or in another order. The score of a place is the sum of
its scores by all members (Hussaini, Milford and Fischer, "Applications of spiking neural networks in visual place
recognition", T-RO 2024, doi 10.1109/TRO.2024.3508053).

In a modular network each module learns some of the places, and the outputs of all are put side by side. A neuron that
also fires for many references which its module never saw says little of the place. Hussaini, Milford and Fischer,
"Ensembles of compact, region-specific and regularized spiking neural networks for scalable place recognition" (ICRA
2023, doi 10.1109/ICRA48891.2023.10160749), call it hyperactive if it fires for at least theta_hyper reference images
outside its module, and set its spikes to 0. theta_hyper is calibrated on references, never on queries.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching.equations import Counts, Scores


def in_order(scores: Scores, order: NDArray[np.int64]) -> Scores:
    """Scores of a member that learned the places in another order, in the places' own order.

    Args:
        scores: The member's scores, float64 (n, places): column k is the place that it learned as its k-th.
        order: Which place that was, int64 (places,), each place once.
    Returns:
        float64 (n, places): column l is place l.
    Raises:
        InputError: the order does not hold every place once.
    """
    if scores.ndim != 2 or not np.array_equal(np.sort(order), np.arange(scores.shape[1])):
        raise InputError(f"the order of {len(order)} places does not fit scores {scores.shape}; name each place once")
    found = np.empty_like(scores)
    found[:, order] = scores
    return found


def together(members: Sequence[Scores]) -> Scores:
    """The sum of the scores of all members, added in the order given, float64 (n, places).

    Args:
        members: Scores of each member, all of the same queries and places, in the places' own order.
    Raises:
        InputError: no member, or members of different shapes.
    """
    if not members or any(scores.shape != members[0].shape for scores in members):
        shapes = ", ".join(str(scores.shape) for scores in members) or "none"
        raise InputError(f"the members of an ensemble have scores of shapes {shapes}; give one shape, at least once")
    total = np.zeros(members[0].shape)
    for scores in members:
        total += scores
    return total


MOST_THRESHOLDS = 24
"""Thresholds that `thresholds` gives at most."""


def foreign_images(
    counts: Counts, image_modules: NDArray[np.int64], neuron_modules: NDArray[np.int64]
) -> NDArray[np.int64]:
    """For how many reference images outside its own module each neuron fires, int64 (neurons,).

    Args:
        counts: Spikes of every neuron on every reference image, int (images, neurons).
        image_modules: The module that learned each image, int64 (images,).
        neuron_modules: The module of each neuron, int64 (neurons,).
    Raises:
        InputError: there is not one module for each image and for each neuron.
    """
    if counts.ndim != 2 or image_modules.shape != counts.shape[:1] or neuron_modules.shape != counts.shape[1:]:
        raise InputError(
            f"counts of shape {counts.shape} have modules of {len(image_modules)} images and {len(neuron_modules)} "
            "neurons; give one for each"
        )
    found = np.count_nonzero(counts, axis=0).astype(np.int64)
    for module in np.unique(neuron_modules):
        own = neuron_modules == module
        found[own] -= np.count_nonzero(counts[np.ix_(image_modules == module, own)], axis=0)
    return found


def hyperactive(foreign: NDArray[np.int64], theta: int) -> NDArray[np.bool_]:
    """Which neurons fire for at least ``theta`` images outside their modules, bool (neurons,).

    Args:
        foreign: As `foreign_images` counts them.
        theta: theta_hyper, at least 1.
    Raises:
        InputError: a threshold below 1, at which every neuron would be hyperactive.
    """
    if theta < 1:
        raise InputError(f"theta_hyper is {theta}, must be at least 1: a neuron that never fires is not hyperactive")
    return foreign >= theta


def without(counts: NDArray[Any], removed: NDArray[np.bool_]) -> NDArray[Any]:
    """``counts`` (n, neurons) with the spikes of the ``removed`` neurons set to 0; what was given stays as it is."""
    kept = counts.copy()
    kept[:, removed] = 0
    return kept


def thresholds(foreign: NDArray[np.int64]) -> NDArray[np.int64]:
    """The values of theta_hyper that take out different neurons, falling from the one that takes out none.

    Of more than `MOST_THRESHOLDS`, so many are given, evenly spread by rank.

    Args:
        foreign: As `foreign_images` counts them.
    Returns:
        int64 (k,), each at least 1.
    """
    found = np.unique(foreign[foreign > 0])[::-1]
    found = np.concatenate([[int(foreign.max(initial=0)) + 1], found]).astype(np.int64)
    if len(found) <= MOST_THRESHOLDS:
        return found
    return found[np.linspace(0, len(found) - 1, MOST_THRESHOLDS).round().astype(np.int64)]


def calibrated_theta(foreign: NDArray[np.int64], worth: Callable[[int], float]) -> int:
    """theta_hyper for which ``worth`` is highest; of equal ones the largest, which takes out fewest neurons.

    Args:
        foreign: As `foreign_images` counts them.
        worth: What a threshold is worth on calibration images, such as their recall.
    """
    best, most = 0, -np.inf
    for theta in thresholds(foreign).tolist():
        value = worth(theta)
        if value > most:
            best, most = theta, value
    return best
