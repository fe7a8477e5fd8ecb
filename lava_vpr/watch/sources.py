"""What can be watched: each source gives image after image, as they come, and says of one that it cannot be read."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.bags import bag_images, is_bag, split_topic
from lava_vpr.images.files import VIDEO_SUFFIXES
from lava_vpr.images.imagefiles import read_image
from lava_vpr.images.videos import video_stream
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.positions.names import stamps_of_names
from lava_vpr.storage.text import shown
from lava_vpr.traverse import EVENTS, Traverse, open_traverse, printable
from lava_vpr.watch.camera import camera_images, is_camera
from lava_vpr.watch.events import event_images, is_event_stream
from lava_vpr.watch.folder import appearing


class Seen(NamedTuple):
    """An image of a source.

    Attributes:
        name: Its file name, or ``frame 000012`` with the frame's number, ``window 000012`` of events.
        stamp: When it was taken, in seconds (`lava_vpr.positions.stamps`); None if nobody says.
        image: uint8 (h, w) or (h, w, 3) BGR; or a vector, float32 (values,); or why it cannot be read.
    """

    name: str
    stamp: float | None
    image: NDArray[Any] | InputError


def open_source(
    source: str,
    *,
    every: float = 1.0,
    existing: bool = True,
    topic: str | None = None,
    events: EventsConfig = EVENTS,
) -> Iterator[Seen]:
    """The images of ``source`` as they come; what can be seen to be wrong with it is said at once.

    Args:
        source: A folder that images are written to; ``-``, paths of images on standard input, one a line; a video;
            a camera (`lava_vpr.watch.camera`); ``events:346x260``, events on standard input
            (`lava_vpr.watch.events`); a ROS bag; a recording of events; or what else `open_traverse` takes.
        every: Seconds between two images of a video, camera, bag or stream of events.
        topic: Topic of a bag; None: the only one with images, or that of ``bag:/topic``.
        existing: Take the images that are in the folder already, too.
        events: How events become images.
    Raises:
        InputError: it cannot be watched; from the iterator: it goes away or is damaged.
    """
    if not (math.isfinite(every) and every >= 0.001):
        raise InputError(f"--every is {every}, but must be a number of seconds, at least 0.001")
    if source == "-":
        return _of_standard_input()
    if is_camera(source):
        return _of_camera(source, every)
    if is_event_stream(source):
        return _of_events(event_images(source, events, every))
    name, of_name = split_topic(source) if "\0" not in source else (source, None)
    path = Path(name)
    if source and "\0" not in source and is_bag(path):
        return _of_bag(path, of_name if topic is None else topic, every)
    if topic is not None:
        raise InputError(f"{shown(source)}: is no ROS bag, and has no topics; leave out --topic")
    if source and "\0" not in source and path.is_dir():
        return _of_folder(path, existing)
    if path.suffix.lower() in VIDEO_SUFFIXES and path.is_file():
        return _of_video(path, every)
    return _of_traverse(open_traverse(source, every=every, events=events))


def _of_standard_input() -> Iterator[Seen]:
    for line in iter(sys.stdin.readline, ""):
        path = line.rstrip("\r\n")
        if path:
            yield Seen(printable(path), _stamp(path), _read(path))


def _of_camera(source: str, every: float) -> Iterator[Seen]:
    for number, (stamp, image) in enumerate(camera_images(source, every)):
        yield Seen(f"frame {number:06d}", stamp, image)


def _of_folder(folder: Path, existing: bool) -> Iterator[Seen]:
    for path, written, image in appearing(folder, existing=existing):
        told = _stamp(path)
        yield Seen(printable(path), written if told is None else told, image)


def _of_video(path: Path, every: float) -> Iterator[Seen]:
    for number, stamp, image in video_stream(path, every):
        yield Seen(f"frame {number:06d}", stamp, image)


def _of_events(images: Iterable[tuple[int, float, NDArray[np.uint8]]]) -> Iterator[Seen]:
    for number, stamp, image in images:
        yield Seen(f"window {number:06d}", stamp, image)


def _of_bag(path: Path, topic: str | None, every: float) -> Iterator[Seen]:
    for found in bag_images(path, topic, every):
        image: NDArray[np.uint8] | InputError
        try:
            image = found.pixels()
        except InputError as error:
            image = error
        yield Seen(f"frame {found.number:06d}", found.stamp, image)


def _of_traverse(traverse: Traverse) -> Iterator[Seen]:
    if traverse.film is not None:
        stamps = [None] * len(traverse) if traverse.stamps is None else traverse.stamps.tolist()
        return (Seen(*seen) for seen in zip(traverse.names, stamps, traverse.images(), strict=True))
    return (Seen(printable(path), _stamp(path), _read(path)) for path in traverse.paths)


def _read(path: str) -> NDArray[np.uint8] | InputError:
    """The image in a file, or why it cannot be read."""
    try:
        return read_image(Path(path))
    except InputError as error:
        return error


def _stamp(path: str) -> float | None:
    """The time that a file's name tells."""
    stamps = stamps_of_names((printable(path),))
    return None if stamps is None else float(stamps[0])
