"""A map is extended by places, loses places, or is merged with others; nothing is learned twice.

Each function returns a new model, and changes none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.encoding import EncodedTraverse, Keep, encode_arrays
from lava_vpr.errors import InputError
from lava_vpr.maps.parts import MapPart, check_extension, check_mergeable, check_positions, join, part_of
from lava_vpr.matching.equations import assign
from lava_vpr.model import IntegerModel, Model, Stretch, integer_model
from lava_vpr.positions.frames import XY, Positions, placed
from lava_vpr.training.loop import LearnedRoute, joined, learned_weights
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
        pool: Who learns and measures; it changes nothing.
        progress: Called after every presentation, from any thread; its stretches are the new ones.
    Raises:
        ConfigError: preset ``paper``; or the map would cost more than the limits allow.
        InputError: the images do not fit the model, or all are blank.
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
    trainers = trainers_of(stretches, references, config)
    learn(trainers, stretches, references, config, pool=pool, progress=progress)
    new = MapPart(learned_weights(trainers, config), stretches, route)
    return join((part, new), config, pool, same_traverse=route_images is not None)


def remove(model: Model, places: Iterable[int], *, pool: Pool = ONE_THREAD) -> IntegerModel:
    """``model`` without some of its places; it is not changed itself.

    A neuron goes with the place, of those that its stretch has learned, to which it responds most, if that is removed;
    one that is silent for all of them stays. The others keep their learned weights, bit for bit.

    Args:
        model: A model with an integer network and its learned weights.
        places: Absolute indices (`Model.place_indices`).
        pool: Who learns and measures; it changes nothing.
    Raises:
        ConfigError: preset ``paper``.
        InputError: the model has no such place, or fewer than 2 places or no neuron would be left.
        ModelFileError: the model has no learned weights.
    """
    part = part_of(model, "removing places")
    gone = np.isin(model.place_indices, _known(model, places))
    left = int(np.count_nonzero(~gone))
    if left < 2:
        raise InputError(f"of {model.places} places {left} would be left, but a map has at least 2; remove fewer")
    stretches, kept = _without(model, gone)
    if not kept.any():
        raise InputError("no neuron would be left for the other places; remove fewer, or train these anew")
    route = part.route
    positions = None if route.positions is None else route.positions.take(~gone)
    kept_references = [reference.take(np.flatnonzero(~gone)) for reference in route.references]
    route = LearnedRoute(kept_references, route.images, positions, model.standard)
    learned = np.ascontiguousarray(part.learned[:, kept])
    return integer_model(joined(learned, model.config, stretches, route, pool), "removing places")


def merge(models: Sequence[Model], *, paths: Sequence[Path] = (), pool: Pool = ONE_THREAD) -> IntegerModel:
    """One model of all places of ``models``, in their order; they are not changed.

    Args:
        models: Two or more of equal settings, with integer networks and their learned weights, learned from as many
            traverses.
        paths: The files of the models, for messages; none: they are not known.
        pool: Who learns and measures; it changes nothing.
    Raises:
        ConfigError: preset ``paper``; settings differ, and the message names the first; or the map would cost more than
            the limits allow.
        InputError: one model alone; they were learned from different numbers of traverses, or not all know positions.
        ModelFileError: a model has no learned weights.
        NetworkLimitError: the whole network could overflow.
    """
    check_mergeable(models, paths)
    parts = [part_of(model, "merging") for model in models]
    check_positions([part.route for part in parts])
    return join(parts, models[0].config, pool, same_traverse=True)


def _encoded(images: Any, model: Model, names: Sequence[str] | None) -> Sequence[EncodedTraverse]:
    """``images`` encoded as those of ``model``, unless they are."""
    if len(images) and isinstance(images[0], EncodedTraverse):
        if names is not None:
            raise InputError("encoded traverses have names of their own; give names with images in memory only")
        return list(images)
    return encode_arrays(images, model.config.encoder, model.config.views.views, Keep.ALL, names, model.standard)


def _known(model: Model, places: Iterable[int]) -> NDArray[np.int64]:
    """The absolute indices ``places``, each seen to be one of ``model``.

    Raises:
        InputError: none is given, or one is no place of it.
    """
    wanted = np.unique(np.array(list(places), np.int64))
    if not wanted.size:
        raise InputError("no place is named; give absolute indices")
    unknown = wanted[~np.isin(wanted, model.place_indices)]
    if unknown.size:
        raise InputError(f"the model has no place {unknown[0]}; its places are {ranges_of(model.place_indices)}")
    return wanted


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
