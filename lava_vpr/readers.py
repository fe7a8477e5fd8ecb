"""Sources of images, stored and live, one row each: what is taken for one, and its images one by one.

`open_source` asks the rows of `READERS` in their order; the first that takes a source opens it. A package can bring
further ones (`lava_vpr.rows.registry`), which are asked after those that are built in. `lava_vpr.traverse` puts an
index on a stored source; `lava_vpr.watch` takes the frames of any as they come.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief, printable, shown
from lava_vpr.events.files import EVENT_STREAM, EVENT_SUFFIXES, event_samples, is_events, windows_of
from lava_vpr.images.bags import BAG_SUFFIXES, bag_files, bag_samples, is_bag, split_topic
from lava_vpr.images.files import (
    IMAGE_SUFFIXES,
    LIST_SUFFIXES,
    VIDEO_SUFFIXES,
    advice,
    folder_images,
    is_unread,
    listed_images,
)
from lava_vpr.images.imagefiles import appearing, read_image
from lava_vpr.images.sampling import Sample, every_so_often
from lava_vpr.images.videos import CAMERA, camera_samples, video_samples
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.positions.frames import stamps_of_names
from lava_vpr.rows.registry import Registry
from lava_vpr.vectors.files import VECTOR_SUFFIXES, Vectors, VectorSource, read_vectors

EVENTS = EventsConfig()
"""How events become images unless a model says otherwise."""


class Frame(NamedTuple):
    """An image of a source, or why there is none.

    Attributes:
        name: Its file name, or ``frame 000012`` with the frame's number, ``window 000012`` of events.
        stamp: When it was taken, in seconds (`lava_vpr.positions.frames`); None if nobody says.
        image: uint8 (h, w) or (h, w, 3) BGR; or a vector, float32 (values,); or why it cannot be read.
    """

    name: str
    stamp: float | None
    image: NDArray[Any] | InputError


@dataclass(frozen=True)
class Wanted:
    """What is asked of a source.

    Attributes:
        source: The source as the user wrote it.
        path: Its path, which exists unless it is one that has a name alone.
        every: Seconds between two images, where they come faster.
        topic: Its topic, of a ROS bag; None: the only one.
        events: How events become images.
        live: Whether it is watched: a folder is then waited at for further images.
        existing: Whether images that are in a watched folder already are taken, too.
    """

    source: str
    path: Path
    every: float = 1.0
    topic: str | None = None
    events: EventsConfig = EVENTS
    live: bool = False
    existing: bool = True


@dataclass(frozen=True, eq=False)
class Found:
    """What a source holds.

    Attributes:
        paths: The files that it is in; without a ``walk`` each is one image.
        walk: Its samples from the first on, in increasing numbers, whenever it is called; of a live source they come
            once, and may have no end.
        word: What an image without a name is called: ``frame`` and its number.
        since_start: Whether stamps count from the first image, so that a user may say when that was.
        vectors: Vectors in place of images.
    """

    paths: tuple[str, ...] = ()
    walk: Callable[[], Iterator[Sample]] | None = None
    word: str = "frame"
    since_start: bool = False
    vectors: VectorSource | None = None

    def frames(self) -> Iterator[Frame]:
        """The images one by one, as they come; an error in place of one that cannot be read.

        Raises:
            InputError: the source goes away or is damaged.
        """
        for sample in samples_of_paths(self.paths) if self.walk is None else self.walk():
            name = f"{self.word} {sample.number:06d}" if sample.name is None else sample.name
            try:
                image: NDArray[Any] | InputError = sample.read()
            except InputError as error:
                image = error
            yield Frame(name, sample.stamp, image)


@dataclass(frozen=True)
class Reader:
    """A sort of source.

    Attributes:
        name: Its name.
        title: What it is, for people.
        open: What is in it, stored or live; an `InputError` of one line where it cannot be used.
        takes: Whether a path that exists is one; it may look into the file, but not read all of it.
        suffixes: How names of its files end, in small letters, for messages; () of a folder.
        named: Whether a text that is no path names one, which can only be watched: any true value says so.
    """

    name: str
    title: str
    open: Callable[[Wanted], Found]
    takes: Callable[[Path], bool] = lambda path: False
    suffixes: tuple[str, ...] = ()
    named: Callable[[str], object] = lambda source: False


READERS: Registry[Reader] = Registry("reader", InputError, group="lava_vpr.readers", row_class=Reader)
"""Every sort of source by name, in the order in which they are asked."""


def samples_of_paths(paths: Iterable[str]) -> Iterator[Sample]:
    """The images in files, with the times in their names."""
    for number, path in enumerate(paths):
        yield Sample(number, _stamp(printable(path)), partial(read_image, Path(path)), name=printable(path))


def _stamp(name: str) -> float | None:
    """The time in a file's name."""
    stamps = stamps_of_names((name,))
    return None if stamps is None else float(stamps[0])


_LONGEST = 1 << 16
"""Characters of a line that are kept: no path has as many, so that what is longer is left out as one."""


def _lines(_: Wanted) -> Found:
    return Found(walk=lambda: samples_of_paths(path for path in _typed() if path))


def _typed() -> Iterator[str]:
    """The lines of standard input, each no farther than `_LONGEST`."""
    while line := sys.stdin.readline(_LONGEST):
        rest = line
        while rest and not rest.endswith("\n"):
            rest = sys.stdin.readline(_LONGEST)
        yield line.rstrip("\r\n")


def _camera(wanted: Wanted) -> Found:
    def walk() -> Iterator[Sample]:
        taken = every_so_often(camera_samples(wanted.source), wanted.every)
        return (sample._replace(number=number) for number, sample in enumerate(taken))

    return Found(walk=walk)


def _event_stream(wanted: Wanted) -> Found:
    samples = event_samples(wanted.source, wanted.events, wanted.every)
    return Found(walk=lambda: samples, word="window")


def _folder(wanted: Wanted) -> Found:
    if not wanted.live:
        return Found(tuple(folder_images(wanted.path)))

    def walk() -> Iterator[Sample]:
        for number, (path, written, image) in enumerate(appearing(wanted.path, existing=wanted.existing)):
            name = printable(path)
            named = _stamp(name)
            yield Sample(number, written if named is None else named, partial(_given, image), name=name)

    return Found(walk=walk)


def _given(image: NDArray[Any] | InputError) -> NDArray[Any]:
    if isinstance(image, InputError):
        raise image
    return image


def found_vectors(stored: VectorSource, paths: tuple[str, ...] = ()) -> Found:
    """What a source of vectors holds, which come from the files ``paths``."""
    names, stamps = stored.names, stored.stamps if isinstance(stored, Vectors) else None

    def walk() -> Iterator[Sample]:
        for number in range(len(stored)):
            name = None if names is None else names[number]
            stamp = _stamp(name or "") if stamps is None else float(stamps[number])
            yield Sample(number, stamp, partial(stored.row, number), name=name)

    return Found(paths, walk, "vector", vectors=stored)


def _ends(suffixes: tuple[str, ...]) -> Callable[[Path], bool]:
    """Whether a path is a file whose name ends so."""
    return lambda path: path.suffix.lower() in suffixes and path.is_file()


for _row in (
    Reader("lines", "standard input", _lines, named=lambda source: source == "-"),
    Reader("camera", "a camera", _camera, named=CAMERA.fullmatch),
    Reader("event stream", "a stream of events", _event_stream, named=EVENT_STREAM.fullmatch),
    Reader(
        "bag",
        "a ROS bag: a file, or the folder of one",
        lambda wanted: Found(
            tuple(bag_files(wanted.path)),
            lambda: every_so_often(bag_samples(wanted.path, wanted.topic), wanted.every),
        ),
        is_bag,
        BAG_SUFFIXES,
    ),
    Reader("folder", "a folder of images, by natural sort", _folder, Path.is_dir),
    Reader(
        "list",
        "a text or CSV file that lists images",
        lambda wanted: Found(tuple(listed_images(wanted.path))),
        _ends(LIST_SUFFIXES),
        LIST_SUFFIXES,
    ),
    Reader(
        "video",
        "a video",
        lambda wanted: Found(
            (str(wanted.path),),
            lambda: every_so_often(video_samples(wanted.path), wanted.every),
            since_start=True,
        ),
        _ends(VIDEO_SUFFIXES),
        VIDEO_SUFFIXES,
    ),
    Reader(
        "events",
        "a recording of an event camera, in windows",
        lambda wanted: Found(
            (str(wanted.path),), windows_of(wanted.path, wanted.events, wanted.every), "window", since_start=True
        ),
        lambda path: _ends(EVENT_SUFFIXES)(path) and is_events(path),
        EVENT_SUFFIXES,
    ),
    Reader(
        "vectors",
        "a file of vectors, one for each image",
        lambda wanted: found_vectors(read_vectors(wanted.path), (str(wanted.path),)),
        _ends(VECTOR_SUFFIXES),
        VECTOR_SUFFIXES,
    ),
    Reader(
        "image",
        "one image",
        lambda wanted: Found((str(wanted.path),)),
        lambda path: _ends(IMAGE_SUFFIXES)(path) and not is_unread(path.name),
        IMAGE_SUFFIXES,
    ),
):
    READERS.register(_row)


def open_source(
    source: str,
    *,
    every: float = 1.0,
    topic: str | None = None,
    events: EventsConfig = EVENTS,
    live: bool = False,
    existing: bool = True,
) -> Found:
    """What ``source`` holds; what can be seen to be wrong with it is said at once.

    Args:
        source: What a row of `READERS` takes. Stored or watched: a folder, a list, a video, a ROS bag, a recording of
            events, vectors, an image. Only watched: ``-``, paths of images on standard input, one a line; a camera
            (`lava_vpr.images.videos`); ``events:346x260``, events on standard input (`lava_vpr.events.files`).
        every: Seconds between two images of a video, camera, bag or stream of events, at least 0.001.
        topic: Topic of a bag; None: the only one with images, or that of ``bag:/topic``.
        events: How events become images.
        live: It is watched, image by image.
        existing: Take the images that are in a watched folder already, too.
    Raises:
        InputError: it is missing, unreadable, empty, of no known type, or can only be watched.
    """
    check_every(every)
    if not source or "\0" in source:
        raise InputError(f"{brief(source)} is not a path; give a folder of images, a list, a video or an image")
    name, of_name = split_topic(source)
    path = Path(name)
    row = _first(lambda row: row.named(source))
    if row is None:
        row = _reader_of(path)
    elif not live:
        raise InputError(f"{shown(source)}: is {row.title}, which can only be watched; use lava-vpr watch")
    if topic is not None and not is_bag(path):
        raise InputError(f"{shown(source)}: is no ROS bag, and has no topics; leave out --topic")
    return row.open(Wanted(source, path, every, of_name if topic is None else topic, events, live, existing))


def check_every(every: float) -> None:
    """Refuse what is no number of seconds between two images.

    Raises:
        InputError: it is below a millisecond, or no finite number.
    """
    if not (math.isfinite(every) and every >= 0.001):
        raise InputError(f"--every is {every}, but must be a number of seconds, at least 0.001")


def _first(wants: Callable[[Reader], object]) -> Reader | None:
    """The first row that ``wants`` a source; one of a package that fails to say so is left out."""
    for row in READERS.values():
        with READERS.spared(row.name):
            if wants(row):
                return row
    return None


def _reader_of(path: Path) -> Reader:
    """The first row that takes ``path``."""
    try:
        path.stat()
    except OSError as error:
        remedy = "check the path"
        if address := re.match("([a-z0-9]{2,}):/(.*)", str(path)):  # a path has lost the second slash
            where = shown("://".join(address.groups()))
            raise InputError(f"{where}: nothing is fetched from a network; download it first") from None
        elif path.name.isdecimal():
            remedy = f"check the path; a camera is camera:{path.name}"
        raise InputError(f"{shown(path)}: cannot be opened ({error.strerror}); {remedy}") from None
    row = _first(lambda row: row.takes(path))
    if row is not None:
        return row
    if not path.is_file():
        raise InputError(f"{shown(path)}: is neither a folder nor a file; give a folder of images, a list or a video")
    if is_unread(path.name):
        raise InputError(f"{shown(path)}: is in a format that cannot be read; {advice()}")
    known = " ".join(dict.fromkeys(suffix for row in READERS.values() for suffix in row.suffixes))
    raise InputError(f"{shown(path)}: is of no known type; give a folder of images or one of {known}")
