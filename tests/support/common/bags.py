"""ROS bags, written by the package rosbags: images of any encoding on any topics.

Used by cli, examples, exchange, images and support.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="needs rosbags: pip install 'lava-vpr[ros]'")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

START = 1_700_000_000
KINDS = ("bag", "db3", "mcap")
"""A ROS 1 file, and a ROS 2 folder of either storage."""


class Message(NamedTuple):
    """An image to be written.

    Attributes:
        data: Its pixels as they are stored, uint8 (h, w) or (h, w, channels); or the bytes of an image file.
        encoding: That of the message; of a file, its format.
        second: When it was recorded, since `START`.
        topic: Its topic.
        stamped: Whether its header says so, too.
        step: Bytes of a row; None: those of its pixels.
    """

    data: NDArray[np.uint8] | bytes
    encoding: str = "bgr8"
    second: float = 0.0
    topic: str = "/camera/image"
    stamped: bool = True
    step: int | None = None


def frames(images: Iterable[NDArray[np.uint8]], every: float = 1.0, **said: Any) -> list[Message]:
    """Messages of ``images``, one every so many seconds."""
    return [Message(image, second=k * every, **said) for k, image in enumerate(images)]


def bag(path: Path, messages: Iterable[Message], kind: str = "mcap") -> Path:
    """Write a bag; a ROS 1 file gets the suffix, a ROS 2 folder does not."""
    first = kind == "bag"
    types = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if first else typesys.Stores.ROS2_HUMBLE)
    if first:
        path = path.with_suffix(".bag")
        writer = rosbag1.Writer(path)
    else:
        plugin = {"db3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}[kind]
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for number, one in enumerate(messages):
            name, message = _message(types, one, number, first=first)
            if (one.topic, name) not in connections:
                connections[one.topic, name] = writer.add_connection(one.topic, name, typestore=types)
            raw = (types.serialize_ros1 if first else types.serialize_cdr)(message, name)
            writer.write(connections[one.topic, name], _nanoseconds(one.second), raw)
    return path


def _nanoseconds(second: float) -> int:
    return round((START + second) * 1000) * 1_000_000


def _message(types: Any, one: Message, number: int, *, first: bool) -> tuple[str, Any]:
    """The name of a message's type, and the message."""
    seconds, rest = divmod(_nanoseconds(one.second), 10**9) if one.stamped else (0, 0)
    time = types.types["builtin_interfaces/msg/Time"](seconds, rest)
    header = types.types["std_msgs/msg/Header"](*((number,) if first else ()), time, "camera")
    if isinstance(one.data, bytes):
        name = "sensor_msgs/msg/CompressedImage"
        return name, types.types[name](header, one.encoding, np.frombuffer(one.data, np.uint8))
    name, (height, width) = "sensor_msgs/msg/Image", one.data.shape[:2]
    step = one.data[0].size if one.step is None else one.step
    flat = np.zeros((height, step), np.uint8)
    flat[:, : one.data[0].size] = one.data.reshape(height, -1)[:, :step]
    return name, types.types[name](header, height, width, one.encoding, 0, step, flat.reshape(-1))
