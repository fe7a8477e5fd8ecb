"""What a training is given, looked at before anything is learned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lava_vpr.config import Config
from lava_vpr.errors import InputError, brief
from lava_vpr.inputs.encoded import EncodedTraverse, check_encoded
from lava_vpr.modelfile import MOST_COUNT, check_names
from lava_vpr.settings.ranges import whole
from lava_vpr.storage.arrays import UnfitError
from lava_vpr.storage.text import shown


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
    """Refuse references of which no model could be made that can be read again.

    Args:
        references: The traverses, each in all views.
        config: Settings that they were encoded with.
        route_images: Images in the whole first traverse; None: nobody says.
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
    if not any(reference.activity.any() for reference in references):
        raise InputError("no input responds to any reference: they are blank; give images that show something")
    seen = int(first.indices.max()) + 1
    if route_images is not None and not (whole(route_images) and seen <= route_images <= MOST_COUNT):
        raise InputError(
            f"route_images is {brief(route_images)}, but there is a place {seen - 1}; give the images of the whole "
            "traverse"
        )
    return seen if route_images is None else int(route_images)
