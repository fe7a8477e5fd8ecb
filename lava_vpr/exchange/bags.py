"""Answers as a bag of ROS 2, by the package rosbags: a folder with an MCAP file, and no ROS.

Source: https://ternaris.gitlab.io/rosbags (topics Rosbag2 and Type system).
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from lava_vpr.errors import InputError, shown
from lava_vpr.exchange.ros import DEFINITIONS, TOPICS, Messages
from lava_vpr.images.bags import rosbags_for
from lava_vpr.matches import Match
from lava_vpr.matching.answers import Answers
from lava_vpr.model import Model
from lava_vpr.storage.writing import new_folder, written
from lava_vpr.traverse import Traverse

_NOTES = logging.getLogger("lava_vpr")
MOST_SECONDS = 2**31
"""A stamp of ROS 2 is from 0 to below this."""
Write = Callable[[Traverse, Answers, list[Match]], None]
"""Takes some queries, the answers to them, which have beliefs, and the same for people."""


@contextmanager
def bag_writer(path: Path, model: Model, queries: Traverse) -> Iterator[Write]:
    """Write a bag answer by answer; it appears in one step, once all is written, and not at all if that fails.

    Args:
        path: Its folder, which must not exist.
        model: What answers.
        queries: Whose answers will come.
    Yields:
        What takes the next answers.
    Raises:
        InputError: something stands at ``path``, the queries have no stamps that ROS has, or it cannot be written.
    """
    if queries.stamps is None:
        raise InputError(f"{shown(queries.source)}: a bag needs the times of its images; give them with --stamps")
    if not ((queries.stamps >= 0) & (queries.stamps < MOST_SECONDS)).all():
        raise InputError(f"{shown(queries.source)}: a bag has times from 1970 to 2038; correct those of its images")
    with rosbags_for(path, "written"):
        from rosbags.rosbag2 import StoragePlugin, Writer
    with new_folder(path, "a bag") as folder:
        bag = Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP)
        with written(path):
            bag.open()
        try:
            yield _writing(path, bag, model)
        except BaseException:
            with suppress(Exception):
                bag.__exit__(*sys.exc_info())
            raise
        with written(path):
            bag.__exit__(None, None, None)
            for file in folder.iterdir():
                with file.open("rb") as content:
                    os.fsync(content.fileno())


def _writing(path: Path, bag: Any, model: Model) -> Write:
    """What writes the messages of a model's answers to the open ``bag``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types: Any = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        types.register(get_types_from_msg(text, name))
    messages = Messages(model, lambda kind, /, **fields: types.types[kind](**fields))
    if len(messages.topics) < len(TOPICS):
        _NOTES.warning(f"{shown(path)}: has neither poses nor links, since the map has no positions")
    topics = {name: bag.add_connection(f"/{name}", TOPICS[name], typestore=types) for name in messages.topics}

    def write(some: Traverse, answers: Answers, found: list[Match]) -> None:
        rows = zip(some.indices.tolist(), found, answers.ranking.by, strict=True)
        for number, match, belief in rows:
            when = round((match.stamp or 0.0) * 1e6) * 1000
            for topic, message in messages.of(number, match, belief, divmod(when, 10**9)):
                with written(path):
                    bag.write(topics[topic], when, types.serialize_cdr(message, TOPICS[topic]))

    return write
