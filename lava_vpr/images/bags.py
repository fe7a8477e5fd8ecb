"""Images of ROS bags, by the package rosbags: ROS 1 files, ROS 2 folders and their files (SQLite, MCAP).

Messages are read by the layouts of ROS's own types; definitions that a bag carries are never interpreted.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, shown
from lava_vpr.images.imagefiles import MIN_SIDE, decode_image
from lava_vpr.images.sampling import Sample
from lava_vpr.storage.limits import within

BAG_SUFFIXES = (".bag", ".db3", ".mcap")
_RAW, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
ENCODINGS: dict[str, tuple[int, tuple[int, ...]]] = {
    "mono8": (1, (0,)),
    "8UC1": (1, (0,)),
    "bgr8": (3, (0, 1, 2)),
    "8UC3": (3, (0, 1, 2)),
    "rgb8": (3, (2, 1, 0)),
    "bgra8": (4, (0, 1, 2)),
    "rgba8": (4, (2, 1, 0)),
}
"""Encodings of sensor_msgs/Image: bytes per pixel, and the positions of blue, green and red, or of grey, among them."""


def is_bag(path: Path) -> bool:
    """Whether ``path`` is a bag: a file with a bag's suffix, or a folder with a bag's metadata."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.suffix.lower() in BAG_SUFFIXES and path.is_file()


def bag_files(path: Path) -> list[str]:
    """The paths read for a bag: its own, and those of the files in its folder."""
    return [str(path), *(sorted(str(file) for file in path.iterdir()) if path.is_dir() else ())]


def split_topic(source: str) -> tuple[str, str | None]:
    """Split ``path:/topic`` of a bag into path and topic; any other source stays whole, with topic None."""
    path, colon, topic = source.partition(":/")
    if colon and not Path(source).exists() and is_bag(Path(path)):
        return path, "/" + topic
    return source, None


def bag_samples(path: Path, topic: str | None) -> Iterator[Sample]:
    """Every image message of a topic, uint8 (h, w) or (h, w, 3) BGR.

    Stamps, in seconds since 1970, are those of the headers, or else the times of recording.

    Args:
        path: The bag.
        topic: The topic to read; None: the only one with images.
    Raises:
        InputError: it is no bag or damaged, it has no images (on this topic), or rosbags is not installed.
    """
    first, number = 0, -1
    for number, (recorded, message, of_topic) in enumerate(_messages(path, topic)):
        first = recorded if number == 0 else first
        header = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        read = partial(_pixels, message, f"{shown(path)}: image {number} of {shown(of_topic)}")
        yield Sample(number, header if header > 0 else recorded / 1e9, read, (recorded - first) / 1e9)
    if number < 0:
        raise InputError(f"{shown(path)}: its topic of images holds none; record it again")


def _pixels(message: Any, named: str) -> NDArray[np.uint8]:
    """The image of a message; error texts begin with ``named``."""
    if not hasattr(message, "encoding"):
        return decode_image(bytes(message.data), named)
    try:
        return _unpacked(message)
    except InputError as error:
        raise InputError(f"{named}: {error}") from None


def _messages(path: Path, topic: str | None) -> Iterator[tuple[int, Any, str]]:
    """Image messages of a topic in order: nanoseconds since 1970 at which each was recorded, the message, the topic."""
    for file in map(Path, bag_files(path)):
        if file.suffix.lower() == ".db3":
            _check_whole(file)
    with _told(path):
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore

        first = path.suffix.lower() == ".bag" and not path.is_dir()
        reader: Any = (rosbag1.Reader if first else rosbag2.Reader)(path)
        types = get_typestore(Stores.ROS1_NOETIC if first else Stores.LATEST)
        read = types.deserialize_ros1 if first else types.deserialize_cdr
        reader.open()
    try:
        chosen = _chosen(path, list(reader.connections), topic)
        with _told(path):
            rest = iter(reader.messages(connections=chosen))
            listed = reader.topics[chosen[0].topic]
        wanted = listed.msgcount if len(listed.connections) == len(chosen) else None
        if path.suffix.lower() == ".mcap":  # without counts rosbags says 0
            wanted = wanted or None
        for number in count():
            with _told(path):
                found = next(rest, None)
                message = None if found is None else read(found[2], found[0].msgtype)
            if found is None and wanted not in (None, number):
                raise InputError(
                    f"{shown(path)}: is damaged, or its metadata are old ({number:,} images, {wanted:,} are listed); "
                    "copy it again, or try ros2 bag reindex"
                )
            if found is None:
                return
            yield found[1], message, found[0].topic
    finally:
        reader.close()


def _check_whole(file: Path) -> None:
    """Refuse a truncated SQLite file: SQLite would read zeros beyond its end.

    Source: https://www.sqlite.org/fileformat.html, the database header.
    """
    with _told(file), file.open("rb") as content:
        header = content.read(32)
        held = content.seek(0, 2)
    if header[:16] == b"SQLite format 3\0" and len(header) == 32:
        page = int.from_bytes(header[16:18], "big")
        wanted = (65536 if page == 1 else page) * int.from_bytes(header[28:32], "big")
        if held < wanted:
            raise InputError(f"{shown(file)}: is cut short ({held:,} of {wanted:,} bytes); copy it again")


def _chosen(path: Path, connections: list[Any], topic: str | None) -> list[Any]:
    """The connections of the requested topic, or of the only one with images."""
    with_images = [one for one in connections if one.msgtype in (_RAW, _COMPRESSED)]
    names = sorted({one.topic for one in with_images})
    listed = ", ".join(map(shown, names))
    if not names:
        others = ", ".join(shown(name) for name in sorted({one.topic for one in connections})[:10]) or "none"
        raise InputError(f"{shown(path)}: holds no images (sensor_msgs Image or CompressedImage); its topics: {others}")
    if topic is None and len(names) > 1:
        raise InputError(f"{shown(path)}: has images of {listed}; name one: {shown(path)}:{shown(names[0])}")
    if topic is not None and topic not in names:
        raise InputError(f"{shown(path)}: has no images of {shown(topic)}, but of {listed}; name one of these")
    return [one for one in with_images if topic in (None, one.topic)]


@contextmanager
def rosbags_for(path: Path, done: str) -> Iterator[None]:
    """Turn a failed import of rosbags, needed to read or write ``path``, into an error of one line.

    Raises:
        InputError: rosbags, or a package that it needs, is not installed.
    """
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] not in (
            "rosbags",
            "apsw",
            "lz4",
            "safelz4",
            "ruamel",
            "backports",
            "zstandard",
        ):
            raise
        raise InputError(
            f"{shown(path)}: ROS bags are {done} by the package rosbags, which is missing or too old; install it: "
            "pip install 'lava-vpr[ros]'"
        ) from None


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn errors of rosbags, which can have any type for a damaged file, into an error of one line."""
    try:
        with rosbags_for(path, "read"):
            yield
    except (ImportError, InputError):
        raise
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be read ({error.strerror or shown(str(error))}); check it and its permissions"
        ) from None
    except MemoryError:
        raise InputError(f"{shown(path)}: asks for more memory than there is; is it damaged? copy it again") from None
    except Exception as error:
        why = shown(" ".join(str(error).split())) or type(error).__name__
        raise InputError(
            f"{shown(path)}: is damaged, unfinished or no ROS bag ({why}); copy it again, or try ros2 bag reindex"
        ) from None


def _unpacked(message: Any) -> NDArray[np.uint8]:
    """The pixels of a sensor_msgs/Image."""
    known = ENCODINGS.get(message.encoding)
    if known is None:
        raise InputError(
            f"has the encoding {shown(message.encoding)!r}; convert it to one of {', '.join(ENCODINGS)} "
            "(cv_bridge, image_proc)"
        )
    size, order = known
    height, width, step = int(message.height), int(message.width), int(message.step)
    within("image_pixels", width * height)
    if min(width, height) < MIN_SIDE:
        raise InputError(f"has {width} x {height} pixels, needs at least {MIN_SIDE} x {MIN_SIDE}; give a larger one")
    if step < width * size or len(message.data) < height * step:
        raise InputError(
            f"is damaged: {len(message.data):,} bytes, in rows of {step:,}, are no {width} x {height} pixels of "
            f"{message.encoding}; record it again"
        )
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)
    pixels = rows[:, : width * size].reshape(height, width, size)
    return np.ascontiguousarray(pixels[:, :, 0] if len(order) == 1 else pixels[:, :, order])
