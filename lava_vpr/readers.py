"""Sources of images, one row each: what is taken for one, and how it becomes the images of a traverse.

`lava_vpr.traverse.open_traverse` asks the rows of `READERS` in their order; the first that takes a path reads it. A
package can bring further ones (`lava_vpr.rows.plugins`), which are asked after those that are built in.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.events.files import EVENT_SUFFIXES, is_events, survey
from lava_vpr.events.live import event_images, is_event_stream
from lava_vpr.images.appearing import appearing
from lava_vpr.images.bags import BAG_SUFFIXES, bag_files, bag_frames, bag_images, is_bag, sample_bag
from lava_vpr.images.cameras import camera_images, is_camera
from lava_vpr.images.files import IMAGE_SUFFIXES, VIDEO_SUFFIXES, folder_images
from lava_vpr.images.imagefiles import read_image
from lava_vpr.images.lists import LIST_SUFFIXES, listed_images
from lava_vpr.images.videos import sample_video, video_frames, video_stream
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.positions.names import stamps_of_names
from lava_vpr.rows.registry import Registry
from lava_vpr.storage.text import printable
from lava_vpr.vectors.files import VECTOR_SUFFIXES, read_vectors
from lava_vpr.vectors.source import VectorSource

_NOTES = logging.getLogger("lava_vpr")


class Frame(NamedTuple):
    """An image of a source that is watched.

    Attributes:
        name: Its file name, or ``frame 000012`` with the frame's number, ``window 000012`` of events.
        stamp: When it was taken, in seconds (`lava_vpr.positions.stamps`); None if nobody says.
        image: uint8 (h, w) or (h, w, 3) BGR; or a vector, float32 (values,); or why it cannot be read.
    """

    name: str
    stamp: float | None
    image: NDArray[Any] | InputError


@dataclass(frozen=True)
class Wanted:
    """What is asked of a source.

    Attributes:
        path: Its path, which exists.
        every: Seconds between two images, where they come faster.
        stop: So many images are wanted at most; None: all.
        topic: Its topic, of a ROS bag; None: the only one.
        events: How events become images.
        existing: Whether images that are in a watched folder already are taken, too.
        source: The source as the user wrote it.
    """

    path: Path
    every: float = 1.0
    stop: int | None = None
    topic: str | None = None
    events: EventsConfig = field(default_factory=EventsConfig)
    existing: bool = True
    source: str = ""


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
        open: What is in it; an `InputError` of one line where it cannot be used. None: it can only be watched.
        suffixes: How names of its files end, in small letters, for messages; () of a folder.
        watch: Its images one by one, as they come, for ``lava-vpr watch``; what can be seen to be wrong with it is an
            `InputError` at once. None: those of ``open``.
        named: Whether a text that is no path names one, which can only be watched.
    """

    name: str
    title: str
    takes: Callable[[Path], bool] = lambda path: False
    open: Callable[[Wanted], Found] | None = None
    suffixes: tuple[str, ...] = ()
    watch: Callable[[Wanted], Iterator[Frame]] | None = None
    named: Callable[[str], bool] = lambda source: False


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


def _numbered(word: str, images: Iterable[tuple[int, float, NDArray[np.uint8]]]) -> Iterator[Frame]:
    """Frames of numbers, stamps and images."""
    return (Frame(f"{word} {number:06d}", stamp, image) for number, stamp, image in images)


def frames_of_paths(paths: Iterable[str]) -> Iterator[Frame]:
    """The images in files; an error in place of one that cannot be read."""
    return (Frame(printable(path), _stamp(path), _tried(partial(read_image, Path(path)))) for path in paths)


def _watched_lines(_: Wanted) -> Iterator[Frame]:
    lines = (line.rstrip("\r\n") for line in iter(sys.stdin.readline, ""))
    return frames_of_paths(path for path in lines if path)


def _watched_camera(wanted: Wanted) -> Iterator[Frame]:
    images = camera_images(wanted.source, wanted.every)
    return _numbered("frame", ((number, *seen) for number, seen in enumerate(images)))


def _watched_folder(wanted: Wanted) -> Iterator[Frame]:
    for path, written, image in appearing(wanted.path, existing=wanted.existing):
        named = _stamp(path)
        yield Frame(printable(path), written if named is None else named, image)


def _watched_bag(wanted: Wanted) -> Iterator[Frame]:
    for found in bag_images(wanted.path, wanted.topic, wanted.every):
        yield Frame(f"frame {found.number:06d}", found.stamp, _tried(found.pixels))


def _tried(read: Callable[[], NDArray[np.uint8]]) -> NDArray[np.uint8] | InputError:
    """What ``read`` returns, or why it cannot."""
    try:
        return read()
    except InputError as error:
        return error


def _stamp(path: str) -> float | None:
    """The time in a file's name."""
    stamps = stamps_of_names((printable(path),))
    return None if stamps is None else float(stamps[0])


READERS.register(Reader("lines", "standard input", watch=_watched_lines, named=lambda source: source == "-"))
READERS.register(Reader("camera", "a camera", watch=_watched_camera, named=is_camera))
READERS.register(
    Reader(
        "event stream",
        "a stream of events",
        watch=lambda wanted: _numbered("window", event_images(wanted.source, wanted.events, wanted.every)),
        named=is_event_stream,
    )
)
READERS.register(
    Reader(
        "bag",
        "a ROS bag: a file, or the folder of one",
        takes=is_bag,
        open=_bag,
        suffixes=BAG_SUFFIXES,
        watch=_watched_bag,
    )
)
READERS.register(
    Reader(
        "folder",
        "a folder of images, by natural sort",
        takes=Path.is_dir,
        open=lambda wanted: Found(tuple(folder_images(wanted.path))),
        watch=_watched_folder,
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
READERS.register(
    Reader(
        "video",
        "a video",
        takes=_ends(VIDEO_SUFFIXES),
        open=_video,
        suffixes=VIDEO_SUFFIXES,
        watch=lambda wanted: _numbered("frame", video_stream(wanted.path, wanted.every)),
    )
)
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


def live_reader(source: str) -> Reader | None:
    """The row of a source that has no path; None if ``source`` names none."""
    return next((row for row in READERS.values() if row.named(source)), None)


def suffixes() -> tuple[str, ...]:
    """How names of files end that some row takes, in the order of the rows; images last."""
    return tuple(dict.fromkeys(suffix for row in READERS.values() for suffix in row.suffixes))
