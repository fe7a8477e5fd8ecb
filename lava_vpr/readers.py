"""Sources of images, one row each: what is taken for one, and how it becomes the images of a traverse.

`lava_vpr.traverse.open_traverse` asks the rows of `READERS` in their order; the first that takes a path reads it. A
package can bring further ones (`lava_vpr.rows.plugins`), which are asked after those that are built in.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.events.files import EVENT_SUFFIXES, is_events, survey
from lava_vpr.images.bags import BAG_SUFFIXES, bag_files, bag_frames, is_bag, sample_bag
from lava_vpr.images.files import IMAGE_SUFFIXES, VIDEO_SUFFIXES, folder_images
from lava_vpr.images.lists import LIST_SUFFIXES, listed_images
from lava_vpr.images.videos import sample_video, video_frames
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.rows.registry import Registry
from lava_vpr.vectors.files import VECTOR_SUFFIXES, read_vectors
from lava_vpr.vectors.source import VectorSource

_NOTES = logging.getLogger("lava_vpr")


@dataclass(frozen=True)
class Wanted:
    """What is asked of a source.

    Attributes:
        path: Its path, which exists.
        every: Seconds between two images, where they come faster.
        stop: So many images are wanted at most; None: all.
        topic: Its topic, of a ROS bag; None: the only one.
        events: How events become images.
    """

    path: Path
    every: float = 1.0
    stop: int | None = None
    topic: str | None = None
    events: EventsConfig = field(default_factory=EventsConfig)


@dataclass(frozen=True, eq=False)
class Film:
    """Images that are no files of their own.

    Attributes:
        numbers: The number of each image that is taken, int64 (n,), increasing.
        show: The images with such numbers, in the order that is asked, each uint8 (h, w) or (h, w, 3) BGR, or vectors,
            float32 (values,); an `InputError` where one cannot be read.
        stamps: When each was taken, in seconds (`lava_vpr.positions.stamps`), float64 (n,); None if nobody says.
        word: What one of them is called: ``frame``.
        since_start: Whether stamps count from the first image, so that a user may say when that was.
    """

    numbers: NDArray[np.int64]
    show: Callable[[NDArray[np.int64]], Iterator[NDArray[Any]]]
    stamps: NDArray[np.float64] | None = None
    word: str = "frame"
    since_start: bool = False


@dataclass(frozen=True, eq=False)
class Found:
    """What a source holds.

    Attributes:
        paths: The file of each image; with a ``film`` the files that it is in.
        film: The images, where they are no files.
        vectors: Vectors in place of images.
    """

    paths: tuple[str, ...]
    film: Film | None = None
    vectors: VectorSource | None = None


@dataclass(frozen=True)
class Reader:
    """A sort of source.

    Attributes:
        name: Its name.
        title: What it is, for people.
        takes: Whether a path that exists is one; it may look into the file, but not read all of it.
        open: What is in it; an `InputError` of one line where it cannot be used.
        suffixes: How names of its files end, in small letters, for messages; () of a folder.
    """

    name: str
    title: str
    takes: Callable[[Path], bool]
    open: Callable[[Wanted], Found]
    suffixes: tuple[str, ...] = ()


READERS: Registry[Reader] = Registry("reader", InputError, group="lava_vpr.readers", row_class=Reader)
"""Every sort of source by name, in the order in which they are asked."""


def _ends(suffixes: tuple[str, ...]) -> Callable[[Path], bool]:
    """Whether a path is a file whose name ends so."""
    return lambda path: path.suffix.lower() in suffixes and path.is_file()


def _video(wanted: Wanted) -> Found:
    numbers, stamps = sample_video(wanted.path, wanted.every, wanted.stop)
    show = partial(video_frames, wanted.path)
    return Found((str(wanted.path),), Film(numbers, show, stamps, since_start=True))


def _bag(wanted: Wanted) -> Found:
    numbers, stamps = sample_bag(wanted.path, wanted.topic, wanted.every, wanted.stop)
    show = partial(bag_frames, wanted.path, wanted.topic)
    return Found(tuple(bag_files(wanted.path)), Film(numbers, show, stamps))


def _events(wanted: Wanted) -> Found:
    drive = survey(wanted.path, wanted.events, wanted.every)
    _NOTES.info("%s", drive.told())
    numbers = np.arange(len(drive.stamps), dtype=np.int64)
    return Found((str(wanted.path),), Film(numbers, drive.frames, drive.stamps, "window", since_start=True))


READERS.register(
    Reader("bag", "a ROS bag: a file, or the folder of one", takes=is_bag, open=_bag, suffixes=BAG_SUFFIXES)
)
READERS.register(
    Reader(
        "folder",
        "a folder of images, by natural sort",
        takes=Path.is_dir,
        open=lambda wanted: Found(tuple(folder_images(wanted.path))),
    )
)
READERS.register(
    Reader(
        "list",
        "a text or CSV file that lists images",
        takes=_ends(LIST_SUFFIXES),
        open=lambda wanted: Found(tuple(listed_images(wanted.path))),
        suffixes=LIST_SUFFIXES,
    )
)
READERS.register(Reader("video", "a video", takes=_ends(VIDEO_SUFFIXES), open=_video, suffixes=VIDEO_SUFFIXES))
READERS.register(
    Reader(
        "events",
        "a recording of an event camera, in windows",
        takes=lambda path: path.suffix.lower() in EVENT_SUFFIXES and path.is_file() and is_events(path),
        open=_events,
        suffixes=EVENT_SUFFIXES,
    )
)
READERS.register(
    Reader(
        "vectors",
        "a file of vectors, one for each image",
        takes=_ends(VECTOR_SUFFIXES),
        open=lambda wanted: Found((str(wanted.path),), vectors=read_vectors(wanted.path)),
        suffixes=VECTOR_SUFFIXES,
    )
)
READERS.register(
    Reader(
        "image",
        "one image",
        takes=_ends(IMAGE_SUFFIXES),
        open=lambda wanted: Found((str(wanted.path),)),
        suffixes=IMAGE_SUFFIXES,
    )
)


def reader_of(path: Path) -> Reader | None:
    """The first row that takes ``path``, which exists; None if none does."""
    return next((row for row in READERS.values() if row.takes(path)), None)


def suffixes() -> tuple[str, ...]:
    """How names of files end that some row takes, in the order of the rows; images last."""
    return tuple(dict.fromkeys(suffix for row in READERS.values() for suffix in row.suffixes))
