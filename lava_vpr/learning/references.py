"""References in any form as training takes them: opened, placed, with settings that fit them, encoded."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lava_vpr.backends.asking import open_model
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse, Keep, encode_views, image_traverse
from lava_vpr.errors import InputError, UsageError
from lava_vpr.framing import NO_CROP, of_references
from lava_vpr.inputs.vectors import Standard
from lava_vpr.model import Model
from lava_vpr.positions.frames import XY, Positions, placed
from lava_vpr.training.preparing import check_responses, fitted, in_words, settings_for, standard_like
from lava_vpr.training.stretches import UNSEEN, Monitor
from lava_vpr.traverse import Traverse, located, vector_traverse
from lava_vpr.vectors.files import Vectors, checked_vectors

Images: TypeAlias = "str | Path | Sequence[NDArray[Any]] | NDArray[Any]"
"""A folder, list, video, image or file of vectors; or images in memory, each uint8 (h, w) or (h, w, 3) BGR; or vectors,
one for each image, real numbers (images, values)."""
Places: TypeAlias = "Positions | ArrayLike | str | Path | Sequence[Positions | str | Path]"
"""Positions of the first traverse, or a CSV or GPX file of them; or either for each of the first traverses."""


class Encoded(NamedTuple):
    """References as training takes them.

    Attributes:
        config: Settings that fit them.
        standard: What vectors are measured by; None of images.
        references: Each traverse in all views, view after view; the first with thumbnails.
    """

    config: Config
    standard: Standard | None
    references: list[EncodedTraverse]


def in_memory(images: Sequence[NDArray[Any]] | NDArray[Any]) -> Traverse:
    """A traverse of images, or vectors, in memory.

    Raises:
        InputError: one of them is neither, or they are vectors of different lengths.
    """
    if not (len(images) and np.ndim(images[0]) == 1):
        return image_traverse(list(images))
    for number, vector in enumerate(images):
        if np.shape(vector) != np.shape(images[0]):
            raise InputError(
                f"vector {number} has shape {np.shape(vector)}, the first {np.shape(images[0])}; give equal ones"
            )
    return vector_traverse("vectors", Vectors(checked_vectors(np.asarray(images), "vectors")))


def located_each(
    traverses: Sequence[Traverse], wholes: Sequence[int], positions: Places, stamps: str | Sequence[str], gap: float
) -> list[Traverse]:
    """Each of ``traverses``, of which there are ``wholes`` images, with what is known of where and when it was driven.

    Args:
        positions, stamps, gap: As in `train`.
    Raises:
        InputError: a file cannot be used, or does not tell of each image.
        UsageError: there are more of one than traverses.
    """
    by, times = each(positions), each(stamps)
    for name, values in (("--positions", by), ("--stamps", times)):
        if len(values) > len(traverses):
            raise UsageError(f"{name} is given {len(values)} times for {len(traverses)} references")
    found = []
    for k, (traverse, whole) in enumerate(zip(traverses, wholes, strict=True)):
        where = by[k] if k < len(by) else None
        file = Path(where) if isinstance(where, (str, Path)) else None
        one = located(traverse, whole, file, times[k] if k < len(times) else None, gap)
        if where is not None and file is None:
            known = placed(where, XY)
            if known is not None and len(known) != len(one):
                raise InputError(f"there are {len(known)} positions for {len(one)} places; give one for each")
            one = dataclasses.replace(one, positions=known)
        found.append(one)
    return found


def each(given: Any) -> tuple[Any, ...]:
    """What is given for each traverse, of something that may be given for the first alone."""
    if given is None:
        return ()
    if isinstance(given, (list, tuple)) and all(isinstance(one, (str, Path, Positions)) for one in given):
        return tuple(given)
    return (given,)


def encode_route(
    traverses: Sequence[Traverse],
    config: Config,
    monitor: Monitor = UNSEEN,
    like: Model | str | Path | None = None,
    keep: Keep = Keep.ALL,
    threads: int = 1,
    crop: str = NO_CROP,
) -> Encoded:
    """The references that show the places of a route, encoded with settings that fit them.

    Args:
        traverses: The references, image i of each at place i.
        config: Settings, which are changed to fit them (`settings_for`).
        monitor: Shows what is being done.
        like: The model whose standard vectors are measured by; None: their own.
        keep: What is kept beside the activity.
        threads: Threads that read them; they do not change the result.
        crop: ``auto``: bars that the images of a traverse have in common are left out (`lava_vpr.framing`).
    Raises:
        LavaVprError: images or settings cannot be used.
    """
    config = settings_for(config, traverses)
    if like is None:
        standard = fitted(config, traverses)
    else:
        standard = standard_like((like if isinstance(like, Model) else open_model(like)).standard, config)
    if standard is not None:
        monitor.line(f"note: {in_words(config, standard)}")
    references = encode_references(traverses, config, standard, monitor, keep, threads, crop)
    check_responses(references, [traverse.source for traverse in traverses])
    return Encoded(config, standard, references)


def encode_references(
    traverses: Sequence[Traverse],
    config: Config,
    standard: Standard | None,
    monitor: Monitor = UNSEEN,
    keep: Keep = Keep.ALL,
    threads: int = 1,
    crop: str = NO_CROP,
) -> list[EncodedTraverse]:
    """The images of ``traverses`` as training takes them, in all views, with a bar for each."""
    views = config.views.views

    def encoded(traverse: Traverse, kept: Keep) -> tuple[EncodedTraverse, ...]:
        framing = of_references(traverse, config.encoder, crop, monitor.line)
        with monitor.bar(f"reading {traverse.source}", len(traverse)) as advance:
            return encode_views(
                traverse, config.encoder, views, kept, lambda read: advance(read, ""), standard, threads, framing
            )

    # A model keeps the thumbnails of its first traverse.
    kept = [keep & ~Keep.THUMBNAILS if number else keep for number in range(len(traverses))]
    return [seen for traverse, own in zip(traverses, kept, strict=True) for seen in encoded(traverse, own)]
