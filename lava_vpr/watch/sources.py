"""What can be watched: each source gives image after image, as they come, and says of one that it cannot be read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.images.bags import is_bag, split_topic
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.readers import Frame, Wanted, frames_of_paths, live_reader, reader_of
from lava_vpr.storage.text import shown
from lava_vpr.traverse import EVENTS, Traverse, check_every, open_traverse


def open_source(
    source: str,
    *,
    every: float = 1.0,
    existing: bool = True,
    topic: str | None = None,
    events: EventsConfig = EVENTS,
) -> Iterator[Frame]:
    """The images of ``source`` as they come; what can be seen to be wrong with it is said at once.

    Args:
        source: What a row of `lava_vpr.readers.READERS` takes: a folder that images are written to; ``-``, paths of
            images on standard input, one a line; a video; a camera (`lava_vpr.images.cameras`); ``events:346x260``,
            events on standard input (`lava_vpr.events.live`); a ROS bag; a recording of events; ...
        every: Seconds between two images of a video, camera, bag or stream of events.
        topic: Topic of a bag; None: the only one with images, or that of ``bag:/topic``.
        existing: Take the images that are in the folder already, too.
        events: How events become images.
    Raises:
        InputError: it cannot be watched; from the iterator: it goes away or is damaged.
    """
    check_every(every)
    name, of_name = split_topic(source) if "\0" not in source else (source, None)
    wanted = Wanted(Path(name), every, None, of_name if topic is None else topic, events, existing, source)
    row = live_reader(source)
    if row is None and source and "\0" not in source and wanted.path.exists():
        if topic is not None and not is_bag(wanted.path):
            raise InputError(f"{shown(source)}: is no ROS bag, and has no topics; leave out --topic")
        row = reader_of(wanted.path)
    if row is not None and row.watch is not None:
        return row.watch(wanted)
    return _of_traverse(open_traverse(source, every=every, events=events))


def _of_traverse(traverse: Traverse) -> Iterator[Frame]:
    """The images of a source that was opened as a whole, one by one."""
    if traverse.film is None:
        return frames_of_paths(traverse.paths)
    stamps = [None] * len(traverse) if traverse.stamps is None else traverse.stamps.tolist()
    return (Frame(*seen) for seen in zip(traverse.names, stamps, traverse.images(), strict=True))
