"""Simpler matchers on the same images: SAD, and cosine of the input rates or of descriptors from elsewhere.

* ``sad``: mean absolute difference of patch-normalised images, the paper's baseline (Hussaini et al. 2022, section
  VI.B, after SeqSLAM, Milford and Wyeth 2012). Scores are the distances, negated; the best one is the confidence.
* ``cosine``: cosine of the network's own input rates, which shows what its encoding allows without spikes.
* ``descriptors``: cosine of descriptors that another program computed (NetVLAD, for instance), from .npy files.

A place with several reference images is as near as its nearest. Results are built block by block: beside inputs and
result less than 100 MB are needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError

Scores = NDArray[np.float64]
BLOCK_BYTES = 16_000_000  # of one float64 block: queries, references or their distances
BLOCK_ROWS = 1024


def _grouped(labels: NDArray[Any] | None, n_references: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order that brings each place's references together, and the place of each in that order."""
    if labels is None:
        same = np.arange(n_references, dtype=np.int64)
        return same, same
    places = np.asarray(labels)
    if places.shape != (n_references,) or places.dtype.kind not in "iu":
        raise InputError(
            f"labels: shape {places.shape}, must be one place number for each of {n_references} references"
        )
    order = np.argsort(places, kind="stable")
    ordered = places[order].astype(np.int64)
    present = np.unique(ordered)
    if not np.array_equal(present, np.arange(len(present))):
        gap = int(np.flatnonzero(present != np.arange(len(present)))[0])
        wrong = f"{present[0]} is negative" if present[0] < 0 else f"place {gap} has no reference image"
        raise InputError(f"labels: {wrong}; number the places 0, 1, 2 .. without gaps")
    return order, ordered


def _row_blocks(n: int, width: int) -> Iterator[slice]:
    rows = max(1, min(BLOCK_ROWS, BLOCK_BYTES // (8 * max(1, width))))
    return (slice(start, min(n, start + rows)) for start in range(0, n, rows))


def _nearest(
    references: NDArray[Any],
    queries: NDArray[Any],
    labels: NDArray[Any] | None,
    compare: Callable[[NDArray[Any], NDArray[Any]], Scores],
    nearer: np.ufunc,
) -> Scores:
    """``compare`` (queries, references) -> (q, r), block by block; ``nearer`` picks among a place's references.

    Returns:
        float64 (n_queries, n_places).
    """
    order, places = _grouped(labels, len(references))
    n_places = int(places[-1]) + 1 if len(places) else 0
    result = np.full((len(queries), n_places), np.inf if nearer is np.minimum else -np.inf)
    width = references.shape[1]
    for rows in _row_blocks(len(references), width):
        block = references[order[rows]]
        present, starts = np.unique(places[rows], return_index=True)
        for part in _row_blocks(len(queries), max(width, len(block))):
            values = nearer.reduceat(compare(queries[part], block), starts, axis=1)
            columns = slice(int(present[0]), int(present[-1]) + 1)  # places are sorted and without gaps
            nearer(result[part, columns], values, out=result[part, columns])
    return result


def sad_distances(
    references: NDArray[np.uint8], queries: NDArray[np.uint8], labels: NDArray[Any] | None = None
) -> Scores:
    """Mean absolute difference of images, in grey levels.

    Args:
        references: Patch-normalised images, uint8 (n_references, h, w).
        queries: Query images of the same kind, uint8 (n_queries, h, w).
        labels: Place of each reference image, int (n_references,), 0 .. n_places - 1; None: each is its own place.
    Returns:
        Distances (n_queries, n_places), 0..255, the smallest over a place's images; exact to the last bit. Negate
        them to get scores.
    Raises:
        InputError: images of different sizes, or labels with gaps.
    """
    for name, images in (("reference", references), ("query", queries)):
        if images.ndim != 3 or images.dtype != np.uint8:
            raise InputError(f"{name} images: {images.dtype} of shape {images.shape}, must be uint8 (images, h, w)")
    if references.shape[1:] != queries.shape[1:]:
        sizes = " and ".join(f"{images.shape[1]}x{images.shape[2]}" for images in (references, queries))
        raise InputError(f"reference and query images are {sizes} pixels; preprocess both alike")
    pixels = references.shape[1] * references.shape[2]

    def compare(q: NDArray[Any], r: NDArray[Any]) -> Scores:
        from scipy.spatial.distance import cdist  # a query needs no scipy

        return np.asarray(cdist(q.astype(np.float64), r.astype(np.float64), "cityblock"))

    flat = references.reshape(len(references), pixels), queries.reshape(len(queries), pixels)
    return _nearest(*flat, labels, compare, np.minimum) / pixels


def _unit_free(q: NDArray[Any], r: NDArray[Any]) -> Scores:
    """Cosine similarities (n_q, n_r); 0 where either vector is blank."""
    a, b = q.astype(np.float64), r.astype(np.float64)
    lengths = np.sqrt((a * a).sum(axis=1))[:, None] * np.sqrt((b * b).sum(axis=1))[None, :]
    products = a @ b.T
    return np.divide(products, lengths, out=np.zeros_like(products), where=lengths > 0)


def cosine_similarities(references: NDArray[Any], queries: NDArray[Any], labels: NDArray[Any] | None = None) -> Scores:
    """Cosine similarity of input rates (or of any vectors).

    Args:
        references: Rates or descriptors, (n_references, n), any real type.
        queries: Vectors of the queries, (n_queries, n).
        labels: As in `sad_distances`.
    Returns:
        Similarities (n_queries, n_places), the largest over a place's images; 0 for a blank row. uint16 rates give
        the same bits in any batch and on any machine, since their products add up below 2^53.
    Raises:
        InputError: vectors of different lengths, or labels with gaps.
    """
    for name, rates in (("reference", references), ("query", queries)):
        if rates.ndim != 2:
            raise InputError(f"{name} vectors: shape {rates.shape}, must be (images, n)")
    if references.shape[1] != queries.shape[1]:
        raise InputError(
            f"vectors have {references.shape[1]} (reference) and {queries.shape[1]} (query) elements; encode both alike"
        )
    return _nearest(references, queries, labels, _unit_free, np.maximum)
