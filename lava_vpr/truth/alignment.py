"""Which images of a query traverse are answered, and which place each of them shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching.evaluation import truth_from_indices, truth_from_positions
from lava_vpr.model import Model
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse
from lava_vpr.truth.groundtruth import read_positions_pair


def by_number(model: Model, queries: Traverse) -> bool:
    """Whether every query has the absolute index of a place, so that equal indices are the same place."""
    return bool(np.isin(queries.indices, model.place_indices).all())


def choose_queries(model: Model, whole: Traverse, places: tuple[int, int] | None, *, aligned: bool) -> Traverse:
    """The queries to answer: ``places``; else the model's own range of as many images as its route had; else all.

    Args:
        model: The model that answers.
        whole: All query images.
        places: Range that the user asked for.
        aligned: No ground truth is given: the traverses must show the same places in the same order.
    Raises:
        InputError: the range exceeds the images, or nothing says which query belongs to which place.
    """
    if places is not None:
        chosen = whole.between(*places)
        known = np.isin(chosen.indices, model.place_indices)
        if aligned and known.any() and not known.all() and len(whole) == model.route_images:
            raise InputError(
                f"{shown(whole.source)}: --places {places[0]}:{places[1]} are partly places of the model and "
                f"partly not; stay within {model.place_indices[0]}:{model.place_indices[-1] + 1}, or give --gt or "
                "--positions"
            )
        if aligned and len(chosen) != model.places and not known.all():
            raise InputError(
                f"{shown(whole.source)}: --places {places[0]}:{places[1]} are {len(chosen)} queries for {model.places} "
                "other places; take as many, or say with --gt or --positions which place each query shows"
            )
        return chosen
    if not aligned and len(whole) != model.route_images:
        return whole
    if len(whole) != model.route_images:
        raise InputError(
            f"{shown(whole.source)}: has {len(whole)} queries, the references {model.route_images}: nothing says which "
            "place a query shows; give --gt FILE, --positions, or --places A:B"
        )
    return whole.between(int(model.place_indices[0]), int(model.place_indices[-1]) + 1)


def aligned_truth(model: Model, queries: Traverse, tolerance: int = 0) -> NDArray[np.bool_]:
    """Ground truth of traverses in step, bool (queries, places): by absolute index, or else by order.

    Args:
        model: The model that answers.
        queries: As many as the model's places, or some of them (`by_number`).
        tolerance: Places off that still count.
    """
    if by_number(model, queries):
        return truth_from_indices(queries.indices, model.place_indices, tolerance)
    return truth_from_indices(np.arange(len(queries)), np.arange(model.places), tolerance)


def positions_truth(model: Model, queries: Traverse, files: tuple[Path, Path], radius: float) -> NDArray[np.bool_]:
    """Ground truth from positions of all images of both traverses, bool (queries, places).

    Args:
        model: The model that answers.
        queries: The queries.
        files: Positions of the reference and of the query images, a line each.
        radius: Metres within which a place is correct.
    Raises:
        InputError: a file cannot be used, or lacks an image's position.
    """
    reference, query = read_positions_pair(*files)
    for path, rows, indices in zip(files, (reference, query), (model.place_indices, queries.indices), strict=True):
        if len(rows) <= int(indices.max()):
            raise InputError(
                f"{shown(path)}: has {len(rows)} positions, image {int(indices.max())} has none; give one a line"
            )
    return truth_from_positions(reference[model.place_indices], query[queries.indices], radius)
