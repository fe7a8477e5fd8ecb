"""Parts of a map, and how they are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.maps.checks import check_learned
from lava_vpr.model import IntegerModel, Model, Stretch, integer_model
from lava_vpr.positions import frames
from lava_vpr.training.loop import LearnedRoute, in_one, joined
from lava_vpr.training.measuring import references_of


class MapPart(NamedTuple):
    """A part of a map: what was learned of it, by which stretches, and where it was.

    Attributes:
        learned: Float weights, float32 (inputs, neurons).
        stretches: Its stretches, view after view, from place and neuron 0 on.
        route: Its references.
    """

    learned: NDArray[np.float32]
    stretches: tuple[Stretch, ...]
    route: LearnedRoute


def part_of(model: Model, purpose: str) -> MapPart:
    """A whole model as part of another, checked by `check_learned`."""
    return MapPart(
        check_learned(model, purpose).learned,
        model.stretches,
        LearnedRoute(references_of(model), model.route_images, model.whereabouts, model.standard),
    )


def join(parts: Sequence[MapPart], config: Config, pool: Pool, same_traverse: bool) -> IntegerModel:
    """The model of ``parts``, one after another in every view."""
    stretches: list[Stretch] = []
    learned: list[NDArray[np.float32]] = []
    neuron = 0
    for view in range(len(config.views.views)):
        place = 0
        for part in parts:
            for stretch in part.stretches:
                if stretch.view == view:
                    own = slice(stretch.first_neuron, stretch.first_neuron + stretch.neurons)
                    learned.append(part.learned[:, own])
                    stretches.append(replace(stretch, first_place=place + stretch.first_place, first_neuron=neuron))
                    neuron += stretch.neurons
            place += len(part.route.references[0])
    weights = np.ascontiguousarray(np.concatenate(learned, axis=1))
    route = _one_route([part.route for part in parts], same_traverse)
    return integer_model(joined(weights, config, tuple(stretches), route, pool), "joining")


def _one_route(routes: Sequence[LearnedRoute], same_traverse: bool) -> LearnedRoute:
    """All places of ``routes``, with absolute indices that no two share (see the module)."""
    indices, images = routes[0].references[0].indices, routes[0].images
    for route in routes[1:]:
        own = route.references[0].indices
        if not (same_traverse and route.images == images and not np.isin(own, indices).any()):
            own, images = own + images, images + route.images
        indices = np.concatenate([indices, own])
    known = [route.positions for route in routes if route.positions is not None]
    references = [_one_traverse(same, indices) for same in zip(*(route.references for route in routes), strict=True)]
    return LearnedRoute(references, images, frames.joined(known) if known else None, routes[0].standard)


def _one_traverse(parts: Sequence[EncodedTraverse], indices: NDArray[np.int64]) -> EncodedTraverse:
    """Images of several parts, one part after another."""
    return EncodedTraverse(
        tuple(name for part in parts for name in part.names),
        indices,
        np.concatenate([part.activity for part in parts]),
        in_one([part.patches for part in parts]),
        in_one([part.thumbnails for part in parts]),  # which the first traverse alone needs to have
        in_one([part.hog for part in parts]),
        in_one([part.vectors for part in parts]),
    )


def taken(encoded: EncodedTraverse, chosen: NDArray[np.bool_]) -> EncodedTraverse:
    """The images that are ``chosen``, bool (n,)."""
    return EncodedTraverse(
        tuple(name for name, own in zip(encoded.names, chosen, strict=True) if own),
        encoded.indices[chosen],
        encoded.activity[chosen],
        None if encoded.patches is None else encoded.patches[chosen],
        None if encoded.thumbnails is None else encoded.thumbnails[chosen],
        None if encoded.hog is None else encoded.hog[chosen],
        None if encoded.vectors is None else encoded.vectors[chosen],
    )
