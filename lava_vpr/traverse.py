"""Traverses: the images of one drive along a route, in order, or vectors in their place.

A traverse is read from a folder, a list, a video, a ROS bag, a recording of events or one image, and is lazy: it holds
names and loads one image at a time. Or it is read from a file of vectors, one for each image, which another program
made of them. Every image keeps its absolute index, its number (from 0) in the whole sequence of its source, also when
only a part of that is taken; positions and ground truth (`lava_vpr.truth.alignment`) are in absolute indices, too.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, UnplacedError, UnreadableError, printable, shown
from lava_vpr.images.exif import taken
from lava_vpr.images.files import IMAGE_SUFFIXES
from lava_vpr.images.imagefiles import read_image
from lava_vpr.images.sampling import chosen
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.positions.frames import (
    LAT_LON,
    Positions,
    in_photos,
    in_seconds,
    positions_of_names,
    stamp_of,
    stamps_of_names,
)
from lava_vpr.positions.track import MOST_GAP_S, PositionRequest, images_on, read_stamps, read_track
from lava_vpr.readers import EVENTS, Found, found_vectors, open_source
from lava_vpr.show.numbers import agreeing
from lava_vpr.vectors.files import Vectors, VectorSource

_NOTES = logging.getLogger("lava_vpr")


@dataclass(frozen=True, eq=False)
class Traverse:
    """Images of one drive, in order; nothing but the paths of files is held in memory.

    Attributes:
        source: What the user gave.
        indices: Absolute index of each image in the whole sequence of the source, int64 (n,).
        paths: File of each image, as text, since a `Path` takes three times as much; of a video, a file of events or of
            vectors, that one file; of a bag, itself and what is in its folder.
        frames: Number of each image in a video, in a bag's topic, among the windows of events or among vectors, int64
            (n,); None unless this is one.
        stamps: When each image was taken, in seconds (`lava_vpr.positions.frames`), float64 (n,): of a video since its
            first frame; None if nobody says.
        positions: Where each image was taken; None if nobody says.
        found: What walks over the images of a video, a bag or events, or holds the vectors; None where each image is a
            file.
    """

    source: str
    indices: NDArray[np.int64]
    paths: tuple[str, ...]
    frames: NDArray[np.int64] | None = None
    stamps: NDArray[np.float64] | None = None
    positions: Positions | None = None
    found: Found | None = None

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def stored(self) -> VectorSource | None:
        """Where its vectors come from, if it is one of vectors."""
        return None if self.found is None else self.found.vectors

    @property
    def pixels(self) -> tuple[int, int] | None:
        """Width and height of its first image; None: it has none, or is one of vectors."""
        if self.stored is not None or not len(self):
            return None
        (image,) = self.take([0]).images()
        return int(image.shape[1]), int(image.shape[0])

    @property
    def names(self) -> tuple[str, ...]:
        """File name of each image, or ``frame 000012`` with the frame's number in the video (``window 000012`` of
        events); of vectors, the names beside them, or ``vector 000012``; made again when asked."""
        if self.frames is not None and self.stored is not None and self.stored.names is not None:
            return tuple(self.stored.names[number] for number in self.frames)
        if self.frames is not None and self.found is not None:
            return tuple(f"{self.found.word} {number:06d}" for number in self.frames)
        return tuple(printable(path) for path in self.paths)

    def images(self) -> Iterator[NDArray[Any]]:
        """All images in order, each uint8 (h, w, 3) BGR or (h, w) grey; a video is decoded in one pass. Or all vectors,
        each float32 (values,).

        Raises:
            InputError: an image cannot be read; the message names it.
        """
        return self._shown(slice(None))

    def load(self, i: int) -> NDArray[Any]:
        """Image or vector ``i``, 0 <= i < len. Of a video, bag or events, all before it is read first."""
        if not 0 <= i < len(self):
            raise IndexError(f"image {i} of a traverse of {len(self)}")
        return next(self._shown(slice(i, i + 1)))

    def _shown(self, part: slice) -> Iterator[NDArray[Any]]:
        """The images of a part of it, one by one."""
        if self.frames is None or self.found is None:
            return (read_image(Path(path)) for path in self.paths[part])
        if self.stored is not None:
            return map(self.stored.row, self.frames[part].tolist())
        walk = self.found.walk or tuple
        return chosen(walk, self.frames[part], f"{shown((*self.paths, self.source)[0])}: has no {self.found.word}")

    def between(self, first: int, end: int) -> Traverse:
        """Images ``first`` .. ``end`` - 1 of this traverse.

        Raises:
            InputError: it has fewer, or the range is none.
        """
        if not 0 <= first < end:
            raise InputError(f"places {first}:{end} are no range; give A:B with 0 <= A < B")
        if end > len(self):
            video = "frames at this --every" if self.stored is None else "vectors"
            what = video if self.frames is not None and self.paths else "images"
            raise InputError(
                f"{shown(self.source)}: has {len(self)} {what}; places {first}:{end} go beyond, use at most "
                f"0:{len(self)}"
            )
        return self.take(range(first, end))

    def take(self, chosen: Iterable[int]) -> Traverse:
        """The images with these numbers (within this traverse), in this order, with their absolute indices."""
        order = [range(len(self))[i] for i in chosen]
        return Traverse(
            self.source,
            self.indices[order].astype(np.int64),
            self.paths if self.frames is not None else tuple(self.paths[i] for i in order),
            None if self.frames is None else self.frames[order].astype(np.int64),
            None if self.stamps is None else self.stamps[order],
            None if self.positions is None else self.positions.take(order),
            self.found,
        )


def ranges_of(indices: NDArray[np.int64], most: int = 4) -> str:
    """Absolute indices as text, for instance ``0:120, 121:500``: as ranges A:B, of which not more than ``most``.

    Args:
        indices: In any order, at least one.
        most: Ranges that are written; of more, the last one's end follows.
    """
    numbers = np.unique(indices)
    starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 2) != 1)
    ends = [*starts[1:], len(numbers)]
    words = [f"{numbers[start]}:{numbers[end - 1] + 1}" for start, end in zip(starts, ends, strict=True)]
    return ", ".join(words) if len(words) <= most else f"{', '.join(words[: most - 1])}, ... {words[-1]}"


def open_traverse(
    source: str | Path,
    *,
    places: tuple[int, int] | None = None,
    every: float = 1.0,
    events: EventsConfig = EVENTS,
) -> Traverse:
    """Open the traverse in ``source``, which is one of these:

    * a folder: its images by natural sort; hidden files, other types and subfolders are ignored;
    * a text file (.txt, .lst) with one path a line, or a CSV file whose header names a column image, file, filename,
      path or name, else without header, paths first; paths relative to the list's folder, order as given, # comments;
    * a video: one frame every ``every`` seconds (the whole video is decoded once to know its frames);
    * a ROS bag (.bag, .db3, .mcap, or a folder with metadata.yaml), one image every ``every`` seconds; ``bag:/topic``
      if several of its topics have images;
    * a file of events (.aedat4, .h5, .hdf5, .npz), a window of ``events`` every ``every`` seconds;
    * vectors (.npy, .npz, .h5, .hdf5), one row for each image, with names and more beside (`lava_vpr.vectors.files`);
    * one image.

    Args:
        source: Path of the folder or file.
        places: (A, B) takes images A..B-1 of that sequence.
        every: Seconds between two images of a video, bag or file of events, at least 0.001; no other source uses it.
        events: How events become images; no other source uses it.
    Raises:
        InputError: the source is missing, unreadable, empty, of no known type, or shorter than ``places`` wants.
    """
    text = str(source)
    if places is not None and not 0 <= places[0] < places[1]:
        raise InputError(f"places {places[0]}:{places[1]} are no range; give A:B with 0 <= A < B")
    found = open_source(text, every=every, events=events)
    whole = _opened(text, found, None if places is None else places[1])
    return whole if places is None else whole.between(*places)


def open_traverses(
    sources: Sequence[str | Path], *, every: float = 1.0, events: EventsConfig = EVENTS
) -> list[Traverse]:
    """Several traverses of one route, each as `open_traverse` opens it.

    Raises:
        InputError: as `open_traverse`; or one of several is a single image: a pattern such as ``summer/*.png`` that the
            shell has replaced by file names is one traverse, not many.
    """
    for source in map(Path, sources if len(sources) > 1 else ()):
        if source.suffix.lower() in IMAGE_SUFFIXES and source.is_file():
            raise InputError(
                f"{shown(source)}: is one of {len(sources)} references, but a single image; give the folder "
                f"{shown(source.parent)} instead of the images in it, or a list of them"
            )
    return [open_traverse(source, every=every, events=events) for source in sources]


_NAMED = 3
"""Images that are skipped and named; of more, their number."""


def readable(traverses: Sequence[Traverse], positions: Sequence[object] = ()) -> list[Traverse]:
    """``traverses`` in step, without the images that cannot be read in one of them, told in a line for each.

    Photos that are to say themselves where they were taken (`located`), and do not, are left out, too.

    All that stay keep their absolute indices: a skipped image is counted wherever images are. Every image file is read
    for this, and once more by who takes it; other sources are taken as they are.

    Args:
        traverses: One traverse, or several. Where they have equally many images, those with the same number show the
            same place, and are skipped together.
        positions: What `located` will be given for each, of the first traverses.
    Raises:
        InputError: none of the images can be read, or says where it was taken.
    """
    photos = [*map(in_photos, positions), *(False for _ in traverses)]
    found = [unreadable(traverse, asked) for traverse, asked in zip(traverses, photos, strict=False)]
    in_step = len({len(traverse) for traverse in traverses}) == 1
    skipped = set().union(*found) if in_step else set[int]()
    kept = []
    for traverse, own in zip(traverses, found, strict=True):
        where, out = shown(traverse.source), own.keys() | skipped
        if len(own) == len(traverse) and all(isinstance(error, UnplacedError) for error in own.values()):
            raise _none_placed(traverse)
        if own:
            some = ", ".join(f"{traverse.indices[k]} ({traverse.names[k]})" for k in [*own][:_NAMED])
            where_taken = agreeing(len(own), "does not say where it was", "do not say where they were")
            without = f", or {where_taken} taken," if any(photos) else ""
            skip = agreeing(len(own), "is", "are")
            said = f"{len(own)} of {len(traverse)} images cannot be read{without} and {skip} skipped: {some}"
            others = f" and {len(own) - _NAMED} more" if len(own) > _NAMED else ""
            _NOTES.warning(f"{where}: {said}{others}; the first: {next(iter(own.values()))}")
        if more := len(out) - len(own):
            skip = agreeing(more, "is", "are")
            _NOTES.warning(f"{where}: {more} more {skip} skipped, since an image of the same number is")
        if len(out) == len(traverse):
            raise InputError(f"{where}: none of its {len(traverse)} images is left; copy them again")
        kept.append(traverse.take(k for k in range(len(traverse)) if k not in out) if out else traverse)
    return kept


def unreadable(traverse: Traverse, photos: bool = False) -> dict[int, UnreadableError]:
    """Why images cannot be read, by their numbers within ``traverse``; or, of ``photos``, are without a position."""
    found: dict[int, UnreadableError] = {}
    for number in range(len(traverse) if traverse.frames is None else 0):
        try:
            traverse.load(number)
            if photos and taken(Path(traverse.paths[number])).where is None:
                found[number] = UnplacedError(f"{shown(traverse.paths[number])}: has no position in its EXIF")
        except UnreadableError as error:
            found[number] = error
    return found


def located(
    traverse: Traverse, whole: int, positions: Path | None, stamps: str | None = None, gap: float = MOST_GAP_S
) -> Traverse:
    """``traverse`` with what a user says of where and when its images were taken.

    Args:
        traverse: The images, as they were opened, or some of them.
        whole: Images in their whole sequence.
        positions: CSV or GPX file with their positions (`lava_vpr.positions.track`); `EXIF`: each photo says where it
            was taken, and when, unless ``stamps`` do; None: those that it has.
        stamps: CSV file whose row k is when the image with absolute index k was taken, or when a video begins, as
            `lava_vpr.positions.frames.stamp_of` reads it; None: the times that it has.
        gap: Most seconds between two positions between which an image is placed.
    Raises:
        InputError: a file cannot be used, or does not tell where or when each image was taken.
    """
    if in_photos(positions):
        traverse, positions = _by_photos(traverse), None
    times = traverse.stamps if stamps is None else _stamps(traverse, stamps)
    if positions is None:
        return replace(traverse, stamps=times)
    found, times = images_on(read_track(positions), PositionRequest(traverse.indices, whole, times), gap)
    return replace(traverse, stamps=times, positions=found)


def unread_exif(traverse: Traverse) -> bool:
    """Whether the first image of ``traverse`` is a photo with a position in its EXIF, and no positions are known."""
    if traverse.positions is not None or traverse.frames is not None or not traverse.paths:
        return False
    with suppress(InputError):
        return taken(Path(traverse.paths[0])).where is not None
    return False


def _by_photos(traverse: Traverse) -> Traverse:
    """``traverse`` with what its photos say of where and when they were taken.

    Raises:
        InputError: they are no image files, or none says where.
        UnreadableError: some do not say where, or cannot be read.
    """
    if traverse.frames is not None:
        raise InputError(f"{shown(traverse.source)}: only image files have EXIF; give positions as a CSV or GPX file")
    found = [taken(Path(path)) for path in traverse.paths]
    lost = [k for k, photo in enumerate(found) if photo.where is None]
    if lost and len(lost) == len(found):
        raise _none_placed(traverse)
    if lost:
        first = f"the first is {traverse.names[lost[0]]}, image {traverse.indices[lost[0]]}"
        one, more = "does not say in its EXIF where it was", "do not say in their EXIF where they were"
        say = agreeing(len(lost), one, more)
        raise UnplacedError(
            f"{shown(traverse.source)}: {len(lost)} of {len(found)} photos {say} taken ({first}); give positions as a "
            "CSV or GPX file"
        )
    positions = Positions(np.array([photo.where for photo in found], np.float64).reshape(-1, 2), LAT_LON)
    known = [photo.when for photo in found if photo.when is not None]
    if known and (len(known) < len(found) or len({photo.zoned for photo in found}) > 1):
        what = "say when they were taken" if len(known) < len(found) else "say how far their clock is from UTC"
        many = len(known) if len(known) < len(found) else sum(photo.zoned for photo in found)
        _NOTES.warning(f"{shown(traverse.source)}: {many} of {len(found)} photos {what}; no times are taken from them")
        known = []
    return replace(traverse, positions=positions, stamps=np.array(known, np.float64) if known else traverse.stamps)


def _none_placed(traverse: Traverse) -> InputError:
    """The error that no photo of ``traverse`` says where it was taken, so that to leave such out would leave none."""
    none = "the photo does not say" if len(traverse) == 1 else f"none of its {len(traverse)} photos says"
    return InputError(
        f"{shown(traverse.source)}: {none} in its EXIF where it was taken; give positions as a CSV or GPX file, or "
        "train without --positions (queries: without --query-positions)"
    )


def _stamps(traverse: Traverse, said: str) -> NDArray[np.float64]:
    """When the images were taken: what ``said``, a file or the time at which a video begins, tells."""
    start = stamp_of(said)
    if math.isfinite(start) and not os.path.exists(said):
        if traverse.found is None or traverse.stamps is None or not traverse.found.since_start:
            raise InputError(f"--stamps {said} is when a video begins; give a CSV file with a time for each image")
        return traverse.stamps + float(in_seconds(np.array([start]))[0])
    rows = read_stamps(Path(said))
    last = int(traverse.indices.max(initial=-1))
    if len(rows) <= last:
        raise InputError(f"{shown(said)}: has {len(rows)} times, image {last} has none; give one a line")
    return rows[traverse.indices]


def _opened(source: str, found: Found, stop: int | None) -> Traverse:
    """The traverse of what ``source`` holds, or of its first ``stop`` images, where a walk is needed to find them."""
    if found.vectors is not None:
        return vector_traverse(source, found.vectors, found.paths)
    if found.walk is not None:
        index = [(sample.number, sample.stamp) for sample in islice(found.walk(), stop)]
        numbers = np.array([number for number, _ in index], np.int64)
        timed = all(stamp is not None for _, stamp in index)
        stamps = np.array([stamp for _, stamp in index], np.float64) if timed else None
        return Traverse(source, np.arange(len(index), dtype=np.int64), found.paths, numbers, stamps, found=found)
    whole = Traverse(source, np.arange(len(found.paths), dtype=np.int64), found.paths)
    names = whole.names
    return replace(whole, stamps=stamps_of_names(names), positions=positions_of_names(names, shown(source)))


def vector_traverse(source: str, stored: VectorSource, paths: tuple[str, ...] = ()) -> Traverse:
    """A traverse of vectors from wherever; of `Vectors`, with the positions and times that they know.

    Args:
        source: What a message calls it.
        stored: The vectors.
        paths: The files that they come from.
    """
    numbers = np.arange(len(stored), dtype=np.int64)
    whole = Traverse(source, numbers, paths, numbers, found=found_vectors(stored, paths))
    names = () if stored.names is None else stored.names
    positions, stamps = (stored.positions, stored.stamps) if isinstance(stored, Vectors) else (None, None)
    positions = positions_of_names(names, shown(source)) if positions is None else positions
    return replace(whole, stamps=stamps_of_names(names) if stamps is None else stamps, positions=positions)
