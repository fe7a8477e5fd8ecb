"""Preparation of references for training: checks, choice of places, settings, and standards of vectors.

Not every image becomes a place. A robot that waits at a red light sees one place many times. By distance, an image
becomes a place once the robot has moved far enough from the place before; by change, once its input differs enough.
Only the first traverse is thinned: of every other, the images that show the same places are taken.

The standard by which vectors are encoded (`Standard`) is fitted on the references.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config, StdpLearning, preset
from lava_vpr.encoding import activity_of, check_seen
from lava_vpr.engine.random import presentation_key, uniform
from lava_vpr.errors import ConfigError, InputError, brief, shown
from lava_vpr.images.sampling import changed, spaced
from lava_vpr.inputs.encoder import INPUTS, EncodedTraverse, EncoderConfig, check_encoded
from lava_vpr.inputs.vectors import Standard, width_for
from lava_vpr.modelfile import MOST_COUNT, check_names
from lava_vpr.positions.frames import Positions
from lava_vpr.settings.ranges import whole
from lava_vpr.storage.arrays import UnfitError
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import NEAR_M


def nearest(places: Positions, images: Positions) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The image taken nearest to each place, int64 (places,), and its distance in metres, float64 (places,).

    Raises:
        InputError: the frames of the two cannot be compared.
    """
    from scipy.spatial import cKDTree  # images without positions need no scipy

    metres, found = cKDTree(images.to(places.frame).points()).query(places.points())
    return np.asarray(found, np.int64), np.asarray(metres, np.float64)


def choose_places(
    traverses: Sequence[Traverse],
    encoder: EncoderConfig,
    *,
    standard: Standard | None = None,
    spacing: float | None = None,
    change: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Traverse]:
    """The images of each traverse that show the places to be learned, equally many of each.

    Without ``spacing`` and ``change`` every image of the first traverse is a place. Of another traverse, the images
    with the same numbers are taken if every image is a place and both have equally many; else those nearest by
    position, where both have positions; else, again, those with the same numbers if both have equally many images.

    Args:
        traverses: Of one route.
        encoder: Settings, for the change of the input.
        standard: Standard by which vectors are encoded, for the same.
        spacing: Least metres between two places.
        change: Least change of the input between two places (`changed`); all images of the first traverse are read.
        progress: Called with 1 after every image that is read.
    Raises:
        InputError: positions are needed and missing, only one place is left, another traverse has no image near a
            place, or nothing decides which of its images show the places.
    """
    first = traverses[0]
    kept: NDArray[np.int64] | None = None
    if spacing is not None:
        if first.positions is None:
            raise InputError(f"{shown(first.source)}: --spacing needs positions of its images; give --positions FILE")
        kept = spaced(first.positions.points(), spacing)
    elif change is not None:
        kept = changed(_activities(first, encoder, standard, progress), change)
    if kept is not None and len(kept) < 2:
        option = "--spacing" if spacing is not None else "--keyframes"
        raise InputError(f"{shown(first.source)}: with this {option} all {len(first)} images are one place; lower it")
    places = first if kept is None else first.take(kept.tolist())
    return [places, *(_showing(places, len(first), kept, other) for other in traverses[1:])]


def _activities(
    traverse: Traverse, encoder: EncoderConfig, standard: Standard | None, progress: Callable[[int], None] | None
) -> Iterable[NDArray[np.float32]]:
    """The activity of each image in turn."""
    for image in traverse.images():
        yield activity_of(image, encoder, standard=standard)
        if progress is not None:
            progress(1)


def _showing(places: Traverse, images: int, kept: NDArray[np.int64] | None, other: Traverse) -> Traverse:
    """The images of another traverse that show ``places``, ``kept`` of the ``images`` of the first."""
    if kept is None and len(other) == images:
        return other
    if places.positions is not None and other.positions is not None:
        try:
            found, metres = nearest(places.positions, other.positions)
        except InputError as error:
            raise InputError(f"{shown(other.source)}: {error}") from None
        k = int(metres.argmax())
        if metres[k] > NEAR_M:
            far = f"{int((metres > NEAR_M).sum())} of {len(metres)} places"
            raise InputError(
                f"{shown(other.source)}: no image was taken within {NEAR_M:g} m of {far} (image {places.indices[k]} of "
                f"{shown(places.source)}: {metres[k]:.1f} m); choose the part of the route that both show, with "
                "--places A:B or lists of images"
            )
        return other.take(found.tolist())
    if kept is None:
        return other  # as many as it has: `check_references` tells
    if len(other) == images:
        return other.take(kept.tolist())
    raise InputError(
        f"{shown(other.source)}: has {len(other)} images, {shown(places.source)} has {images}: nothing tells which of "
        "them show the places; give --positions for each reference, or lists of matching images"
    )


_FLAT = 1e-3
"""Smallest scale of a value, as a share of the scale of all values together."""


def settings_for(config: Config, traverses: Sequence[Traverse]) -> Config:
    """``config`` for the kind of references: if they are vectors, settings for images become settings for vectors.

    The input becomes ``vector``, and settings still at the preset's values get those chosen for vectors: all inputs may
    spike in a query, since the dead zone already keeps weak ones silent; and learning shows each vector for twice the
    steps, since more inputs share the same number of spikes.

    Args:
        config: Settings.
        traverses: The references.
    Raises:
        InputError: some are images and some vectors, or of different sizes, or they are images and ``config`` says
            that they are vectors.
        ConfigError: the settings cannot take vectors.
    """
    first = traverses[0].stored
    for traverse in traverses[1:]:
        if (traverse.stored is None) != (first is None):
            kinds = ("images", "vectors") if first is None else ("vectors", "images")
            raise InputError(
                f"{shown(traverse.source)}: holds {kinds[1]}, {shown(traverses[0].source)} {kinds[0]}; give one sort"
            )
    encoder = config.encoder
    if first is None:
        if INPUTS[encoder.kind].sees == "vector":
            check_seen(traverses[0], encoder)
        return config
    if INPUTS[encoder.kind].sees != "vector":
        config = _of_vectors(config)
        encoder = config.encoder
    if encoder.vector_values not in (0, first.values):
        raise ConfigError(
            f"encoder.vector_values is {encoder.vector_values}, but {shown(traverses[0].source)} holds vectors of "
            f"{first.values:,} values; leave it out of the settings"
        )
    encoder = dataclasses.replace(encoder, vector_values=first.values)
    for traverse in traverses[1:]:
        check_seen(traverse, encoder)
    return dataclasses.replace(config, encoder=encoder)


def _of_vectors(config: Config) -> Config:
    """Settings for images as settings for vectors."""
    usual, encoder, learning = preset(config.preset), config.encoder, config.learning
    shown = 0 if encoder.query_inputs == usual.encoder.query_inputs else encoder.query_inputs
    if isinstance(learning, StdpLearning) and learning.steps == StdpLearning.steps:
        learning = dataclasses.replace(learning, steps=2 * learning.steps)
    encoder = dataclasses.replace(encoder, kind="vector", query_inputs=shown)
    return dataclasses.replace(config, encoder=encoder, learning=learning)


def check_asked(traverses: Sequence[Traverse], config: Config) -> None:
    """Refuse references of the wrong kind for the input that the user chose.

    Raises:
        InputError: they are vectors and the input is for images, or vice versa.
    """
    encoder = config.encoder
    for traverse in traverses:
        if (INPUTS[encoder.kind].sees == "vector") != (traverse.stored is not None):
            check_seen(traverse, encoder)


def fitted(config: Config, traverses: Sequence[Traverse]) -> Standard | None:
    """Fit the standard of the vectors of ``traverses``; None if the settings' input needs none.

    The mean of each value is that of all references. Their spread is one scale for all values, or each its own. The
    signs and choices of a projection are drawn from the seed alone.

    Raises:
        InputError: all vectors are equal.
    """
    encoder = config.encoder
    if not INPUTS[encoder.kind].standardised:
        return None
    mean, spread = _moments(traverses, encoder.vector_values)
    if not spread.any():
        raise InputError(
            f"{shown(traverses[0].source)}: all vectors are equal, so nothing tells places apart; compute them again"
        )
    shared = np.sqrt((spread**2).mean())
    own = np.maximum(spread, _FLAT * shared) if encoder.vector_scale == "own" else np.full(len(spread), shared)
    signs, kept = _projection(encoder, config.seed)
    return Standard(mean.astype(np.float32), own.astype(np.float32), signs, kept)


def standard_like(other: Standard | None, config: Config) -> Standard:
    """Check that ``other``, the standard of another model, suits vectors of these settings, and return it.

    Raises:
        ConfigError: it does not.
    """
    encoder = config.encoder
    if other is None:
        raise ConfigError("--standard names a model that was not trained with vectors; name one that was")
    wanted = min(encoder.vector_values, encoder.vector_kept)
    seen = len(other.kept) if other.projects else other.values
    if not INPUTS[encoder.kind].standardised or other.values != encoder.vector_values or seen != wanted:
        raise ConfigError(
            f"--standard names a model of vectors of {other.values:,} values, {seen:,} of them seen, but these are of "
            f"{encoder.vector_values:,}, {wanted:,} seen; train with the settings of that model"
        )
    return other


def in_words(config: Config, standard: Standard) -> str:
    """Description of the learned vectors, for people."""
    encoder = config.encoder
    seen = min(encoder.vector_values, encoder.vector_kept)
    projected = f", projected on {seen:,} (encoder.vector_kept)" if standard.projects else ""
    said = f"vectors of {encoder.vector_values:,} values, standardised on the references{projected}"
    return f"{said}: {encoder.inputs:,} inputs"


def _moments(traverses: Sequence[Traverse], values: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of each value over all vectors, float64 (values,); added one vector at a time."""
    count, total = 0, np.zeros(values)
    for traverse in traverses:
        for vector in traverse.images():
            total += vector
            count += 1
    mean, squares = total / count, np.zeros(values)
    for traverse in traverses:
        for vector in traverse.images():
            squares += (vector - mean) ** 2
    return mean, np.sqrt(squares / count)


def _projection(encoder: EncoderConfig, seed: int) -> tuple[NDArray[np.int8], NDArray[np.int32]]:
    """Signs and kept value numbers of the projection of vectors; both empty where vectors are short enough without
    it."""
    if encoder.vector_values <= encoder.vector_kept:
        return np.zeros(0, np.int8), np.zeros(0, np.int32)
    width = width_for(encoder.vector_values)
    draws = uniform(presentation_key(seed, "projection", 0), 2 * width)
    kept = np.sort(np.argsort(draws[width:], kind="stable")[: encoder.vector_kept])
    return np.where(draws[:width] < 0.5, 1, -1).astype(np.int8), kept.astype(np.int32)


def check_references(sizes: Sequence[int], sources: Sequence[str] | None = None, least: int = 2) -> None:
    """Refuse reference traverses that do not show the same number of places.

    Args:
        sizes: The number of images of each.
        sources: The folder or file that each was read from, for the message; None if that is not known.
        least: The fewest places: 2 of a route, 1 of what a map is extended by.
    Raises:
        InputError: none, too few places, or unequal numbers.
    """
    files = [f"{shown(source)}: " for source in sources] if sources else [""] * len(sizes)
    if not sizes or sizes[0] < least:
        found = "1 image" if sizes and sizes[0] else "no image"
        wanted = "a route needs at least 2 places" if least == 2 else "a map is extended by at least 1 place"
        raise InputError(
            f"{''.join(files[:1])}{wanted}, but there is {found}; give a folder, list or video "
            "of more, or a wider --places A:B"
        )
    for number, size in enumerate(sizes[1:], start=2):
        if size != sizes[0]:
            raise InputError(
                f"{files[number - 1]}reference traverse {number} has {size} images, the first has {sizes[0]}: place i "
                "must be image i of each; choose with --places A:B or give lists of matching images"
            )


def check_encoded_references(
    references: Sequence[EncodedTraverse], config: Config, route_images: int | None, least: int = 2
) -> int:
    """Refuse references from which no valid model file could be made.

    Args:
        references: The traverses, each in all views.
        config: Settings that they were encoded with.
        route_images: Images in the whole first traverse; None: unknown.
        least: As in `check_references`.
    Returns:
        Images in the whole first traverse, as far as is known.
    Raises:
        InputError: they are not of these settings, or of different numbers of places, or two are the same place,
            or all of them are blank.
    """
    check_references([len(reference) for reference in references], least=least)
    views = len(config.views.views)
    if len(references) % views:
        raise InputError(
            f"{len(references)} encoded traverses are no whole traverses of {views} views each; encode each in all "
            "views (encode_views)"
        )
    for number, reference in enumerate(references, start=1):
        check_encoded(reference, config.encoder, f"references of traverse {number}")
    first = references[0]
    try:
        check_names(list(first.names), least)
    except UnfitError as error:
        raise InputError(f"the references have {error}; rename the file") from None
    if len(np.unique(first.indices)) != len(first):
        raise InputError("two references have the same index; give each place once")
    check_responses(references)
    seen = int(first.indices.max()) + 1
    if route_images is not None and not (whole(route_images) and seen <= route_images <= MOST_COUNT):
        raise InputError(
            f"route_images is {brief(route_images)}, but there is a place {seen - 1}; give the images of the whole "
            "traverse"
        )
    return seen if route_images is None else int(route_images)


def check_responses(references: Sequence[EncodedTraverse], sources: Sequence[str] = ()) -> None:
    """Refuse references to which no input or neuron responds; ``sources`` are the files they were read from.

    Raises:
        InputError: naming them.
    """
    if not any(reference.activity.any() for reference in references):
        where = f"{', '.join(map(shown, sources))}: " if sources else ""
        raise InputError(f"{where}no input responds to any reference: they are blank; give images that show something")
