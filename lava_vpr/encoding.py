"""Images and vectors to the activity of inputs: whole traverses, arrays, or batches of samples as they are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, shown
from lava_vpr.images.imagefiles import side_by_side
from lava_vpr.images.sampling import Sample
from lava_vpr.inputs.encoder import INPUTS, THUMBNAIL, EncodedTraverse, EncoderConfig, Keep
from lava_vpr.inputs.patches import HOG_VALUES, PATCH_SIDE, averaged, hog, patch_normalised
from lava_vpr.inputs.vectors import Standard, picture_of
from lava_vpr.inputs.views import STRAIGHT, View, seen_as
from lava_vpr.readers import Found
from lava_vpr.storage.limits import within
from lava_vpr.traverse import Traverse
from lava_vpr.vectors.files import checked_vectors

Framed: TypeAlias = "tuple[NDArray[np.uint8], NDArray[np.bool_] | None]"
"""What is encoded of an image, uint8 (h, w) or (h, w, 3), and which inputs are not silent, bool (inputs,); None: all
respond as they do."""
Framing: TypeAlias = Callable[[NDArray[np.uint8]], Framed]
"""Makes it of an image; it may know the images before."""


def activity_of(
    image: NDArray[Any],
    encoder: EncoderConfig,
    patch: NDArray[np.uint8] | None = None,
    standard: Standard | None = None,
) -> NDArray[np.float32]:
    """Responses of the input channels to one image, float32 (inputs,).

    Args:
        image: The image as it was read, uint8 (h, w) or (h, w, 3) BGR; or a vector, float32 (values,).
        encoder: Settings.
        patch: `patch_normalised` (image) if that is known already.
        standard: What vectors are measured by, for a kind of input that needs it.
    Raises:
        InputError: it needs it, and it is not there.
    """
    row = INPUTS[encoder.kind]
    if row.standardised:
        if standard is None:
            raise InputError("vectors are measured by what was fitted on references; encode these with the model's own")
        return row.activity(standard.seen(image[None])[0], encoder)
    if row.sees != "patch":
        return row.activity(image, encoder)
    return row.activity(patch_normalised(image) if patch is None else patch, encoder)


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image (h, w) or (h, w, 3) BGR as reports show it, uint8 (48, 64, 3) BGR."""
    small = averaged(image, *THUMBNAIL)
    return np.asarray(small if small.ndim == 3 else np.repeat(small[:, :, None], 3, axis=2), np.uint8)


def encode_traverse(
    traverse: Traverse,
    encoder: EncoderConfig,
    keep: Keep = Keep.NOTHING,
    progress: Callable[[int], None] | None = None,
    standard: Standard | None = None,
) -> EncodedTraverse:
    """Read every image once, one at a time.

    Args:
        traverse: The images, or vectors.
        encoder: Settings.
        keep: What is kept beside the activity.
        progress: Called with 1 after every image.
        standard: What vectors are measured by (`lava_vpr.model.Model.standard`).
    Raises:
        InputError: an image cannot be read, or they are vectors and the settings are for images, or the other way
            round, or vectors of another number of values.
    """
    return encode_views(traverse, encoder, (STRAIGHT,), keep, progress, standard)[0]


def encode_views(
    traverse: Traverse,
    encoder: EncoderConfig,
    views: Sequence[View],
    keep: Keep = Keep.NOTHING,
    progress: Callable[[int], None] | None = None,
    standard: Standard | None = None,
    threads: int = 1,
    framing: Framing | None = None,
) -> tuple[EncodedTraverse, ...]:
    """`encode_traverse` of every image in each of ``views``: one encoded traverse a view, in their order.

    Args:
        traverse, encoder, keep, progress, standard: As there.
        views: The views.
        threads: Threads that share large image files; they change neither the result nor the error.
        framing: What is encoded of each image (`lava_vpr.framing`); None: all of it.
    """
    check_seen(traverse, encoder)
    read, threads = _reading(traverse, encoder, threads)
    return _encoded(traverse.names, traverse.indices, read, encoder, views, keep, progress, standard, threads, framing)


def _reading(traverse: Traverse, encoder: EncoderConfig, threads: int) -> tuple[Callable[[int], NDArray[Any]], int]:
    """What reads image ``i``, and how many threads can share the images: one where they are no files, or inputs are a
    package's."""
    if traverse.frames is None:
        return traverse.load, threads if INPUTS.built_in(encoder.kind) else 1
    images = traverse.images()  # a video is decoded in one pass
    return lambda i: next(images), 1


def check_seen(traverse: Traverse, encoder: EncoderConfig) -> None:
    """Refuse vectors where the settings are for images, images where they are for vectors, and vectors of another size.

    Raises:
        InputError: naming the source, and what is asked for.
    """
    wanted, values = encoder.vector_values, None if traverse.stored is None else traverse.stored.values
    where, of = shown(traverse.source), f" of {wanted:,} values" if wanted else ""
    if INPUTS[encoder.kind].sees != "vector":
        if values is not None:
            raise InputError(
                f"{where}: holds vectors, but inputs {encoder.kind!r} see images; give images, or train with vectors"
            )
    elif values is None:
        raise InputError(
            f"{where}: holds images, but inputs {encoder.kind!r} see vectors{of}; give a file of vectors "
            "(.npy, .npz, .h5) that the program of the others made of them"
        )
    elif values != wanted:
        raise InputError(
            f"{where}: holds vectors of {values:,} values, but the model learned those of {wanted:,}; make them "
            "with the same program"
        )


def encode_arrays(
    images: Sequence[NDArray[Any]],
    encoder: EncoderConfig,
    views: Sequence[View] = (STRAIGHT,),
    keep: Keep = Keep.NOTHING,
    names: Sequence[str] | None = None,
    standard: Standard | None = None,
    framing: Framing | None = None,
) -> tuple[EncodedTraverse, ...]:
    """`encode_views` of images, or vectors, that are in memory, counted from 0.

    Args:
        images: Each (h, w) grey or (h, w, 3) BGR, uint8; or a vector of real numbers (values,).
        encoder, views, keep, standard, framing: As in `encode_views`.
        names: A name for each; None: ``image 000000``, or ``vector 000000``, and so on.
    Raises:
        InputError: one of them is no image, or no such vector, or there is not one name for each.
    """
    vectors = INPUTS[encoder.kind].sees == "vector"
    word = "vector" if vectors else "image"
    named = tuple(f"{word} {k:06d}" for k in range(len(images))) if names is None else tuple(names)
    if len(named) != len(images):
        raise InputError(f"there are {len(named)} names for {len(images)} {word}s; give one for each")
    taken = _vectors(images, encoder.vector_values, names) if vectors else _images(images, names)
    indices = np.arange(len(taken), dtype=np.int64)
    return _encoded(named, indices, taken.__getitem__, encoder, views, keep, None, standard, framing=framing)


def image_traverse(images: Sequence[NDArray[Any]]) -> Traverse:
    """A traverse of images in memory, each uint8 (h, w) grey or (h, w, 3) BGR.

    Raises:
        InputError: one of them is no image.
    """
    taken, numbers = _images(images), np.arange(len(images), dtype=np.int64)
    samples = [Sample(number, None, partial(np.asarray, image)) for number, image in enumerate(taken)]
    return Traverse("images", numbers, (), numbers, found=Found(walk=lambda: iter(samples), word="image"))


def _images(images: Sequence[NDArray[Any]], names: Sequence[str] | None = None) -> Sequence[NDArray[Any]]:
    """``images``, each seen to be one, and none larger than a picture in a file may be."""
    for number, image in enumerate(images):
        said = f"image {number}" if names is None else shown(names[number])
        try:
            array = np.asarray(image)
        except ValueError:  # rows of unequal length
            array = np.empty(0, object)
        if array.dtype != np.uint8 or array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,)) or not array.size:
            raise InputError(
                f"{said} is of type {array.dtype} and shape {array.shape}; give uint8 (h, w) or (h, w, 3) BGR"
            )
        within("image_pixels", array.shape[0] * array.shape[1], f"{said} has {array.shape[1]} x {array.shape[0]} =")
    return images


def _vectors(vectors: Sequence[NDArray[Any]], values: int, names: Sequence[str] | None) -> NDArray[np.float32]:
    """``vectors`` as float32 (n, values), each seen to have as many values."""
    for number, vector in enumerate(vectors):
        shape = np.shape(vector)
        if shape != (values,):
            said = f"vector {number}" if names is None else shown(names[number])
            raise InputError(f"{said} has shape {shape}, but the model learned ({values},); give such vectors")
    return np.asarray(checked_vectors(np.asarray(vectors), "vectors"), np.float32)


def encoded_batches(
    traverse: Traverse,
    encoder: EncoderConfig,
    views: Sequence[View],
    size: int,
    progress: Callable[[int], None] | None = None,
    first: int | None = None,
    standard: Standard | None = None,
    threads: int = 1,
    keep: Keep = Keep.NOTHING,
    framing: Framing | None = None,
) -> Iterator[tuple[EncodedTraverse, ...]]:
    """`encode_views` for ``size`` images at a time, in order; a batch is encoded when it is asked for.

    Args:
        traverse, encoder, views, progress, standard, threads, keep, framing: As in `encode_views`.
        size: Images in a batch, but for the last.
        first: Images in the first batch, if those shall be fewer; each is twice as large as the one before, up to
            ``size``.
    Raises:
        InputError: as `encode_views`.
    """
    check_seen(traverse, encoder)
    read, threads = _reading(traverse, encoder, threads)  # once for all batches
    start, count = 0, size if first is None else min(first, size)
    while start < len(traverse):
        part = traverse.take(range(start, min(start + count, len(traverse))))
        own = partial(lambda start, i: read(start + i), start)
        yield _encoded(part.names, part.indices, own, encoder, views, keep, progress, standard, threads, framing)
        start, count = start + count, min(2 * count, size)


def _encoded(
    names: tuple[str, ...],
    indices: NDArray[np.int64],
    read: Callable[[int], NDArray[Any]],
    encoder: EncoderConfig,
    views: Sequence[View],
    keep: Keep,
    progress: Callable[[int], None] | None,
    standard: Standard | None,
    threads: int = 1,
    framing: Framing | None = None,
) -> tuple[EncodedTraverse, ...]:
    """The images that ``read`` reads, which have these names and indices, encoded in each of ``views``."""
    parts = {part: made for part, made in _parts(encoder).items() if part in keep}
    seen = (STRAIGHT,) if INPUTS[encoder.kind].sees == "vector" else tuple(views)
    activity = np.empty((len(seen), len(names), encoder.inputs), np.float32)
    kept: dict[Keep, NDArray[Any]] = {
        part: np.empty((*activity.shape[:2], *shape), dtype) for part, (shape, dtype, _) in parts.items()
    }

    def encode(i: int) -> NDArray[Any]:
        """Read and encode an image; the image."""
        whole, heard = (read(i), None) if framing is None else framing(read(i))
        for k, view in enumerate(seen):
            image = seen_as(whole, view)
            for part, (_, _, of) in parts.items():
                kept[part][k, i] = of(image)
            patch = kept[Keep.PATCHES][k, i] if Keep.PATCHES in kept else None
            try:
                activity[k, i] = activity_of(image, encoder, patch, standard)
            except InputError as error:
                raise InputError(f"{names[i]}: {error}") from None
        if heard is not None:
            activity[:, i] *= heard
        return whole

    for some in _in_order(encode, len(names), threads if framing is None else 1):
        if progress is not None:
            progress(some)
    arrays = {str(part.name).lower(): array for part, array in kept.items()}
    return tuple(
        EncodedTraverse(names, indices, activity[k], **{name: array[k] for name, array in arrays.items()})
        for k in range(len(seen))
    )


LARGE, SHARE = 1 << 17, 1 << 26
"""Values of an image from which on threads are worth it, and of all that a thread takes before it reports them."""


def _in_order(encode: Callable[[int], NDArray[Any]], n: int, threads: int) -> Iterator[int]:
    """``encode`` of 0..n-1 as if one after the other; yields how many more are done.

    The first is done alone. If it is large, threads share the next ones, some at a time, until an image
    has something to report: from then on it is one after the other again.
    """
    done = wide = 0
    while done < n:
        some = range(done, min(n, done + max(1, wide)))
        if not wide:
            values = encode(done).size
            wide = threads * max(1, SHARE // values) if values >= LARGE and threads > 1 else 0
        elif not side_by_side(encode, some, threads):
            wide, threads = 0, 1
            continue
        yield len(some)
        done = some.stop


def _parts(encoder: EncoderConfig) -> dict[Keep, tuple[tuple[int, ...], type, Callable[[Any], NDArray[Any]]]]:
    """What may be kept of an image or vector beside the activity: its shape and type, and how it is made."""
    small = (THUMBNAIL[1], THUMBNAIL[0], 3)
    if INPUTS[encoder.kind].sees == "vector":
        return {
            Keep.THUMBNAILS: (small, np.uint8, partial(picture_of, size=THUMBNAIL)),
            Keep.VECTORS: ((encoder.vector_values,), np.float32, np.asarray),
        }
    front_end = encoder.front_end
    pixels = {} if front_end is None else {Keep.GREY: (front_end.shape, np.uint8, front_end.seen)}
    return {
        Keep.PATCHES: ((PATCH_SIDE, PATCH_SIDE), np.uint8, patch_normalised),
        Keep.THUMBNAILS: (small, np.uint8, thumbnail),
        Keep.HOG: ((HOG_VALUES,), np.uint8, hog),
        **pixels,
    }
