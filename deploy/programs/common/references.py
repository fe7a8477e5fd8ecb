"""Queries and references: whether they are for this network, and whether counts are those of the bundle."""

import numpy as np

from refusals import Refused

MANTISSA = 4095  # of a bias, in 12 bits and sign


def check_queries(rates: np.ndarray, keys: np.ndarray, inputs: int, where: object) -> None:
    """Refuse queries that are not for this network.

    Raises:
        Refused: wrong type or shape.
    """
    if rates.dtype != np.uint16 or rates.ndim != 2 or rates.shape[1] != inputs:
        raise Refused("input", f"{where}: rates.npy is {rates.dtype} {rates.shape}, but must be uint16 (n, {inputs})")
    if keys.dtype != np.uint64 or keys.shape != rates.shape[:1]:
        raise Refused("input", f"{where}: keys.npy is {keys.dtype} {keys.shape}, but must be uint64 ({len(rates)},)")


def check_pixels(pixels: np.ndarray, shape: tuple, where: object) -> None:
    """Refuse pixels that are not for this network, whose images have this ``shape``.

    Raises:
        Refused: wrong type or shape.
    """
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[1:] != shape:
        wanted = "uint8 (n, {}, {})".format(*shape)
        raise Refused("input", f"{where}: pixels.npy is {pixels.dtype} {pixels.shape}, but must be {wanted}")


def compare_pictures(counts: np.ndarray, wanted: np.ndarray) -> str:
    """What was compared, of pictures whose counts the bundle has.

    Raises:
        Refused: the counts are not those of the bundle.
    """
    wrong = counts != wanted
    if wrong.any():
        picture, neuron = (int(x) for x in np.argwhere(wrong)[0])
        raise Refused(
            "result",
            f"self-test: neuron {neuron} counts {counts[picture, neuron]} spikes for picture {picture} instead of "
            f"{wanted[picture, neuron]}; {int(wrong.sum())} of {wrong.size} counts differ",
        )
    return f"equal: {len(counts)} pictures, {wrong.size} counts, {int(counts.sum())} spikes of exc"


def check_biases(mantissas: np.ndarray, exponents: np.ndarray, shape: tuple, where: object) -> None:
    """Refuse biases of queries that are not for this network, ``shape`` (n, neurons), or that no register holds.

    Raises:
        Refused: wrong type, shape or size.
    """
    for name, array, wanted, low, high in (
        ("biases", mantissas, shape, -MANTISSA, MANTISSA),
        ("exponents", exponents, shape[:1], 0, 7),
    ):
        if array.dtype != np.int32 or array.shape != wanted:
            found = f"{array.dtype} {array.shape}"
            raise Refused("input", f"{where}: {name}.npy is {found}, but must be int32 {wanted}")
        if array.size and not low <= array.min() <= array.max() <= high:
            raise Refused("input", f"{where}: {name}.npy holds a value outside {low}..{high}, which no register takes")


def first_places(labels: np.ndarray, n: int) -> tuple:
    """How many references the first ``n`` are (0: all), and the places of which all images are among them.

    Raises:
        Refused: there is no such place.
    """
    n = min(n, len(labels)) if n else len(labels)
    places = np.unique(labels[:n])
    places = places[~np.isin(places, labels[n:])]  # a place is the sum of all its images
    if not len(places):
        raise Refused("input", f"the first {n} references are not all of any place; present more")
    return n, places


def fewest(labels: np.ndarray) -> int:
    """How many references, from the first on, hold all images of one place."""
    return int(min(np.flatnonzero(labels == label)[-1] for label in np.unique(labels))) + 1


def compare(counts: np.ndarray, labels: np.ndarray, places: np.ndarray, responses: np.ndarray) -> str:
    """What was compared.

    Raises:
        Refused: the counts are not those of the bundle.
    """
    found = np.zeros_like(responses)
    np.add.at(found.T, labels, counts)
    wrong = found[:, places] != responses[:, places]
    if wrong.any():
        neuron, column = (int(x) for x in np.argwhere(wrong)[0])
        place = int(places[column])
        raise Refused(
            "result",
            f"self-test: neuron {neuron} counts {found[neuron, place]} spikes for place {place} instead of "
            f"{responses[neuron, place]}; {int(wrong.sum())} of {wrong.size} counts differ",
        )
    return f"equal: {len(counts)} references, {wrong.size} counts, {int(found[:, places].sum())} spikes of exc"
