"""A map is extended by places, loses places, or is merged with others; nothing is learned twice.

Each function returns a new model, and changes none. What a map that is to change must be is seen before any work is
done.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse, Keep, encode_arrays
from lava_vpr.errors import ConfigError, InputError, ModelFileError, brief, shown
from lava_vpr.maps.duplicates import check_duplicates
from lava_vpr.matching.equations import assign
from lava_vpr.model import IntegerModel, Model, Stretch, as_integer, integer_model
from lava_vpr.positions import frames
from lava_vpr.positions.frames import XY, Positions, placed
from lava_vpr.settings.ranges import whole
from lava_vpr.training.loop import LearnedRoute, check_size, check_whole, in_one, joined, learned_weights
from lava_vpr.training.measuring import references_of
from lava_vpr.training.preparing import check_encoded_references
from lava_vpr.training.stretches import Progress, learn, trainers_of
from lava_vpr.traverse import ranges_of


def extend(
    model: Model,
    images: Sequence[EncodedTraverse] | Sequence[NDArray[Any]] | NDArray[Any],
    *,
    names: Sequence[str] | None = None,
    route_images: int | None = None,
    positions: Positions | ArrayLike | None = None,
    allow_duplicates: bool = False,
    pool: Pool = ONE_THREAD,
    progress: Callable[[Progress], None] | None = None,
) -> IntegerModel:
    """``model`` and the new places of ``images``, which stretches of their own learn; it is not changed itself.

    Args:
        model: A model with an integer network and its learned weights.
        images: Encoded traverses of the new places, as many as the model was learned from, each in all views
            (`lava_vpr.encoding.encode_views`, `Keep.ALL`); or, for a model of one traverse, images in memory, each
            uint8 (h, w) or (h, w, 3) BGR, or vectors of real numbers (values,), as the model learned.
        names: A name for each of ``images`` in memory; None: ``image 000000`` and so on.
        route_images: Images in the whole first traverse of the new places, if they may be another part of the model's
            own traverse; None: they are none, and their indices are counted on.
        positions: Where the new places are; an array (images, 2) is in the model's frame. Needed if the model knows
            that of its own, and only then.
        allow_duplicates: Whether new places may show images of places that the model has, or of new ones before.
        pool: Who learns and measures; it changes nothing.
        progress: Called after every presentation, from any thread; its stretches are the new ones.
    Raises:
        ConfigError: preset ``paper``; or the map would cost more than the limits allow.
        InputError: the images do not fit the model, all are blank, or some are duplicates that are not allowed.
        ModelFileError: the model has no learned weights.
        NetworkLimitError: the whole network could overflow.
    """
    config = model.config
    part, references = part_of(model, "extending"), _encoded(images, model, names)
    own = check_encoded_references(references, config, route_images, least=1)
    stretches = check_extension(model, len(references[0]), len(references) // len(config.views.views))
    route = LearnedRoute(references, own, placed(positions, model.frame or XY), model.standard)
    route.check(config.encoder)
    check_positions((part.route, route))
    check_duplicates((part.route, route), allow_duplicates, learning=True)
    trainers = trainers_of(stretches, references, config)
    learn(trainers, stretches, references, config, pool=pool, progress=progress)
    new = MapPart(learned_weights(trainers, config), stretches, route)
    return join((part, new), config, pool, same_traverse=route_images is not None)


def remove(model: Model, places: Iterable[int], *, path: Path | None = None, pool: Pool = ONE_THREAD) -> IntegerModel:
    """``model`` without some of its places; it is not changed itself.

    A neuron goes with the place, of those that its stretch has learned, to which it responds most, if that is removed;
    one that is silent for all of them stays. The others keep their learned weights, bit for bit.

    Args:
        model: A model with an integer network and its learned weights.
        places: Absolute indices (`Model.place_indices`).
        path: The file of the model, for messages, if it is known.
        pool: Who learns and measures; it changes nothing.
    Raises:
        ConfigError: preset ``paper``.
        InputError: the model has no such place, or fewer than 2 places or no neuron would be left.
        ModelFileError: the model has no learned weights.
    """
    part = part_of(model, "removing places", path)
    gone = np.isin(model.place_indices, _known(model, places, path))
    left = int(np.count_nonzero(~gone))
    if left < 2:
        raise InputError(f"of {model.places} places {left} would be left, but a map has at least 2; remove fewer")
    stretches, kept = _without(model, gone)
    if not kept.any():
        raise InputError("no neuron would be left for the other places; remove fewer, or train these again")
    route = part.route
    positions = None if route.positions is None else route.positions.take(~gone)
    kept_references = [reference.take(np.flatnonzero(~gone)) for reference in route.references]
    route = LearnedRoute(kept_references, route.images, positions, model.standard)
    learned = np.ascontiguousarray(part.learned[:, kept])
    return integer_model(joined(learned, model.config, stretches, route, pool), "removing places")


def merge(
    models: Sequence[Model], *, paths: Sequence[Path] = (), allow_duplicates: bool = False, pool: Pool = ONE_THREAD
) -> IntegerModel:
    """One model of all places of ``models``, in their order; they are not changed.

    Args:
        models: Two or more of equal settings, with integer networks and their learned weights, learned from as many
            traverses.
        paths: The files of the models, for messages; none: they are not known.
        allow_duplicates: Whether a model may have images of the models before it.
        pool: Who learns and measures; it changes nothing.
    Raises:
        ConfigError: preset ``paper``; settings differ, and the message names the first; or the map would cost more than
            the limits allow.
        InputError: one model alone; they were learned from different numbers of traverses, not all know positions, or
            some images are duplicates that are not allowed.
        ModelFileError: a model has no learned weights.
        NetworkLimitError: the whole network could overflow.
    """
    check_mergeable(models, paths)
    parts = [part_of(model, "merging") for model in models]
    check_positions([part.route for part in parts])
    check_duplicates([part.route for part in parts], allow_duplicates)
    return join(parts, models[0].config, pool, same_traverse=True)


def _encoded(images: Any, model: Model, names: Sequence[str] | None) -> Sequence[EncodedTraverse]:
    """``images`` encoded as those of ``model``, unless they are."""
    if len(images) and isinstance(images[0], EncodedTraverse):
        if names is not None:
            raise InputError("encoded traverses have names of their own; give names with images in memory only")
        return list(images)
    return encode_arrays(images, model.config.encoder, model.config.views.views, Keep.ALL, names, model.standard)


def _known(model: Model, places: Iterable[int], path: Path | None) -> list[int]:
    """The absolute indices ``places``, each seen to be one of ``model``; ``places`` may be too many to be listed.

    Raises:
        InputError: none is given, or one is no place of it.
    """
    own, wanted = frozenset(model.place_indices.tolist()), set[int]()
    if not isinstance(places, Iterable) or getattr(places, "ndim", 1) == 0:
        raise InputError(f"places are {brief(places)}, but must be absolute indices; give a list of them")
    for place in places:
        if not whole(place) or place not in own:
            known = ranges_of(model.place_indices)
            raise InputError(f"{_of_file(path)}the model has no place {brief(place)}; its places are {known}")
        wanted.add(place)
    if not wanted:
        raise InputError("no place is named; give absolute indices")
    return list(wanted)


def _without(model: Model, gone: NDArray[np.bool_]) -> tuple[tuple[Stretch, ...], NDArray[np.bool_]]:
    """The stretches without the places that are ``gone``, bool (places,), and which neurons stay, bool (neurons,)."""
    kept = np.zeros(model.neurons, np.bool_)
    stretches: list[Stretch] = []
    place = neuron = 0
    for stretch in model.stretches:
        if stretches and stretch.view != stretches[-1].view:
            place = 0
        neurons = slice(stretch.first_neuron, stretch.first_neuron + stretch.neurons)
        places = slice(stretch.first_place, stretch.first_place + stretch.places)
        lost = gone[places]
        if lost.all():
            continue
        best = assign(model.responses[neurons, places])
        kept[neurons] = (best < 0) | ~lost[best]
        left, own = int(np.count_nonzero(~lost)), int(np.count_nonzero(kept[neurons]))
        stretches.append(Stretch(place, left, neuron, own, stretch.view, stretch.removed + int(lost.sum())))
        place, neuron = place + left, neuron + own
    return tuple(stretches), kept


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


def part_of(model: Model, purpose: str, path: Path | None = None) -> MapPart:
    """A whole model as part of another, checked by `check_learned`."""
    return MapPart(
        check_learned(model, purpose, path).learned,
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


def check_extension(model: Model, places: int, traverses: int, path: Path | None = None) -> tuple[Stretch, ...]:
    """The stretches of ``places`` new places that ``traverses`` show, or a refusal before anything is learned.

    Args:
        model: The model that is to be extended.
        places: Number of new places.
        traverses: Number of traverses that show them.
        path: The file of the model, if it is known.
    Raises:
        ConfigError, InputError, ModelFileError: as `extend`.
    """
    check_learned(model, "extending", path)
    if traverses != traverses_of(model):
        raise InputError(
            f"{_of_file(path)}the model was learned from {_counted(traverses_of(model))}, but the new places are shown "
            f"in {_counted(traverses)}; give as many"
        )
    stretches = check_size(places, model.config, traverses)
    neurons = model.neurons + sum(stretch.neurons for stretch in stretches)
    check_whole(model.config, model.places + places, traverses, neurons)
    return stretches


def check_learned(model: Model, purpose: str, path: Path | None = None) -> IntegerModel:
    """``model`` itself, seen to have an integer network and what that was made of.

    Args:
        model: The model.
        purpose: What needs that; the message begins with it.
        path: The file of the model, if it is known.
    Raises:
        ConfigError: it is the conductance model.
        ModelFileError: it has no learned weights.
    """
    if as_integer(model) is None:
        raise ConfigError(
            f"{_of_file(path)}{purpose} needs stretches that learn by themselves, but preset paper is one network for "
            "the whole route; train it again with all images"
        )
    if model.learned.size == 0:
        raise ModelFileError(
            f"{_of_file(path)}{purpose} needs what the network has learned, which a bundle does not hold; use the "
            "model file that it was deployed from"
        )
    return integer_model(model, purpose)


def traverses_of(model: Model) -> int:
    """The number of traverses that a model was learned from."""
    return len(model.labels) // (model.places * len(model.config.views.views))


def check_mergeable(models: Sequence[Model], paths: Sequence[Path] = ()) -> None:
    """Refuse models that cannot be merged.

    Args:
        models: The models.
        paths: Their files, for messages; none: they are not known.
    Raises:
        ConfigError, InputError, ModelFileError: as `lava_vpr.maps.merge`.
    """
    if len(models) < 2:
        raise InputError("there is nothing to merge; give two models or more")
    first, files = models[0], [*paths, *[None] * (len(models) - len(paths))]
    for number, (model, path) in enumerate(zip(models, files, strict=True), start=1):
        check_learned(model, "merging", path)
        name = f"model {number}" if path is None else f"{shown(path)}: the model"
        different = _first_difference(asdict(first.config), asdict(model.config))
        if different is not None:
            setting, ours, theirs = different
            raise ConfigError(
                f"{name} was trained with {setting} {brief(theirs)}, the first with {brief(ours)}; train one of them "
                "again with the settings of the other"
            )
        if not _measure_alike(first, model):
            raise ConfigError(
                f"{name} measures vectors by references of its own; train it again with --standard and the first model"
            )
        if traverses_of(model) != traverses_of(first):
            raise InputError(
                f"{name} was learned from {_counted(traverses_of(model))}, the first from "
                f"{_counted(traverses_of(first))}; merge models of as many"
            )
    places, neurons = sum(model.places for model in models), sum(model.neurons for model in models)
    check_whole(first.config, places, traverses_of(first), neurons)


def _measure_alike(one: Model, other: Model) -> bool:
    """Whether both measure vectors by the same standard, or neither has one."""
    own, their = one.standard, other.standard
    return own is their if own is None or their is None else own.same(their)


def check_positions(routes: Sequence[LearnedRoute]) -> None:
    """Refuse parts of which some know where their places are and some do not, or in frames that do not compare.

    Raises:
        InputError: they are such parts.
    """
    known = [route.positions for route in routes if route.positions is not None]
    if known and len(known) < len(routes):
        raise InputError(
            "some places have positions and others have none, but a map has all or none; give positions for all, or "
            "train without"
        )
    if known:
        frames.joined([positions.take(slice(0, 0)) for positions in known])


def _first_difference(ours: dict[str, Any], theirs: dict[str, Any], section: str = "") -> tuple[str, Any, Any] | None:
    """The name and both values of the first setting that differs, and by which a model was trained."""
    for key, own in ours.items():
        other = theirs.get(key)
        if isinstance(own, dict) and isinstance(other, dict):
            found = _first_difference(own, other, f"{section}{key}.")
            if found is not None:
                return found
        elif own != other and (section, key) != ("network.", "adapt"):
            return f"{section}{key}", own, other
    return None


def _counted(traverses: int) -> str:
    return f"{traverses} traverse{'s' if traverses != 1 else ''}"


def _of_file(path: Path | None) -> str:
    return "" if path is None else f"{shown(path)}: "
