"""Which images of a query traverse are answered, and which place each of them shows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.matching.evaluation import truth_from_indices, truth_from_positions
from lava_vpr.model import Model
from lava_vpr.positions.frames import Positions, distances
from lava_vpr.positions.track import read_track, rows_of
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse


def by_number(model: Model, queries: Traverse) -> bool:
    """Whether every query has the absolute index of a place, so that equal indices are the same place."""
    return bool(np.isin(queries.indices, model.place_indices).all())


def _contiguous(model: Model) -> bool:
    """Whether every image between a model's first and last place is a place, too."""
    indices = model.place_indices
    return int(indices.max() - indices.min()) + 1 == model.places


def choose_queries(model: Model, whole: Traverse, places: tuple[int, int] | None, *, aligned: bool) -> Traverse:
    """The queries to answer: ``places``; else the model's own range of as many images as its route had; else all.

    Of a model whose places are some images of its route only, and of as many queries, it is those with the places'
    indices.

    Args:
        model: The model that answers.
        whole: All query images.
        places: Range that the user asked for.
        aligned: No ground truth is given: the traverses must show the same places in the same order.
    Raises:
        InputError: the range exceeds the images, or nothing says which query belongs to which place.
    """
    thinned = aligned and len(whole) == model.route_images and not _contiguous(model)
    if thinned:  # the images between the places show none of their own
        wanted = range(*places) if places is not None else range(len(whole))
        chosen = whole.take(i for i in np.sort(model.place_indices).tolist() if i in wanted)
        if len(chosen):
            return chosen
    if places is not None:
        chosen = whole.between(*places)
        known = np.isin(chosen.indices, model.place_indices)
        if aligned and known.any() and not known.all() and len(whole) == model.route_images:
            raise InputError(
                f"{shown(whole.source)}: --places {places[0]}:{places[1]} are partly places of the model and "
                f"partly not; stay within {model.place_indices.min()}:{model.place_indices.max() + 1}, or give --gt or "
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
    return whole.between(int(model.place_indices.min()), int(model.place_indices.max()) + 1)


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


NEAR_M = 25.0
"""Metres within which two images show the same place, unless a user says otherwise: the field's usual radius
(VPR-methods-evaluation, ``positive_dist_threshold``)."""


class Located(NamedTuple):
    """Where a model's places and some queries were taken, in one frame.

    Attributes:
        places: Of each place.
        queries: Of each query.
    """

    places: Positions
    queries: Positions

    @classmethod
    def of(cls, places: Positions, queries: Positions, source: str) -> Located:
        """Both in the frame of the places.

        Args:
            places, queries: Positions in any frames.
            source: Where the queries' are from, for the message.
        Raises:
            InputError: their frames cannot be compared.
        """
        try:
            return cls(places, queries.to(places.frame))
        except InputError as error:
            raise InputError(f"{shown(source)}: {error}") from None

    def truth(self, radius: float) -> NDArray[np.bool_]:
        """Which places are within ``radius`` metres of each query, bool (queries, places)."""
        return truth_from_positions(self.places.points(), self.queries.points(), radius)

    def errors(self, matches: NDArray[np.int64]) -> NDArray[np.float64]:
        """Metres from each query to the place that it was matched with, float64 (n,); NaN without a match.

        Args:
            matches: Place of each of the first n queries, -1 for none, int64 (n,).
        """
        metres = distances(self.queries.take(slice(len(matches))), self.places.take(matches))
        return np.where(matches >= 0, metres, np.nan)


@dataclass(frozen=True)
class PositionErrors:
    """How far from their true positions queries were placed.

    Attributes:
        located: Where places and queries were taken.
        metres: From each query to its match, float64 (n,); NaN without a match.
        near: Metres within which a match counts.
    """

    located: Located
    metres: NDArray[np.float64]
    near: float

    def quantile(self, share: float) -> float:
        """Metres that a ``share`` of the matched queries does not exceed; NaN if none was matched."""
        known = self.metres[np.isfinite(self.metres)]
        return float(np.quantile(known, share)) if len(known) else math.nan

    @property
    def within(self) -> float:
        """The share of all queries that were matched within ``near``."""
        return float((self.metres <= self.near).mean())

    def in_words(self) -> str:
        """The figures as a sentence."""
        matched = int(np.isfinite(self.metres).sum())
        if not matched:
            return "metres of error: no query was matched"
        return (
            f"metres of error: median {self.quantile(0.5):.1f}, 90 % up to {self.quantile(0.9):.1f} (of {matched} "
            f"matched); {100 * self.within:.1f} % of {len(self.metres)} within {self.near:g} m"
        )

    def as_json(self) -> dict[str, float | int | None]:
        """The figures; None where nothing was matched."""
        values = {"median_m": self.quantile(0.5), "p90_m": self.quantile(0.9)}
        figures: dict[str, float | int | None] = {k: None if math.isnan(v) else v for k, v in values.items()}
        return {**figures, "within": self.within, "radius_m": self.near, "matched": int((self.metres >= 0).sum())}


def located_by(model: Model, queries: Traverse, files: tuple[Path, Path]) -> Located:
    """Positions of all images of both traverses, from files with a row for each.

    Args:
        model: The model that answers.
        queries: The queries.
        files: Positions of the reference and of the query images; row k is the image with absolute index k.
    Raises:
        InputError: a file cannot be used, or lacks an image's position.
    """
    places, shown_at = (read_track(path) for path in files)
    return Located.of(
        rows_of(places, model.place_indices), rows_of(shown_at, queries.indices), f"{files[1]}, {files[0]}"
    )
