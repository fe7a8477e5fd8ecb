"""A view into a large file by position: what is asked for must be there whole, and the parts of a file are counted."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from typing import Any

from lava_vpr.storage.limits import within


class DamagedError(Exception):
    """The file's structure is incomplete; the text says how."""


@dataclass(frozen=True)
class Film:
    """What a video file says of itself, once the walk over its structure has found it whole.

    Attributes:
        demuxer: FFmpeg's name of the file's format.
        sizes: Width and height of each video stream in pixels, where the file tells them.
        frames: Number of frames of the first video stream, or 0 where the file does not tell it; some may be hidden.
        span: Seconds from its first to its last frame, 0 where the file does not tell them.
    """

    demuxer: str
    sizes: tuple[tuple[int, int], ...] = ()
    frames: int = 0
    span: float = 0.0


class Window:
    """An open file.

    Args:
        handle: The descriptor of a regular file.
    """

    def __init__(self, handle: int) -> None:
        self.handle = handle
        self.size = os.fstat(handle).st_size
        self.parts = 0

    def at(self, position: int, length: int) -> bytes:
        """``length`` bytes from ``position`` on.

        Raises:
            DamagedError: the file ends before.
        """
        data = os.pread(self.handle, length, position) if position + length <= self.size else b""
        if len(data) < length:
            raise DamagedError(f"it ends after {self.size:,} bytes, within a header")
        return data

    def numbers(self, layout: str, position: int) -> tuple[Any, ...]:
        """What `struct` reads with ``layout`` from ``position`` on."""
        return struct.unpack(layout, self.at(position, struct.calcsize(layout)))

    def reach(self, end: int, beyond: int | None = None) -> int:
        """``end``, where a part of the file ends; one more part is counted.

        Args:
            end: Where the part says that it ends.
            beyond: Where the part around it ends; None: the file.
        Raises:
            DamagedError: it ends beyond that.
            InputError: the file has more parts than allowed; the text lacks the file's name.
        """
        if end > self.size:
            raise DamagedError(f"it has {self.size:,} of {end:,} bytes")
        if beyond is not None and end > beyond:
            raise DamagedError("a part reaches beyond the part around it")
        self.parts += 1
        within("video_parts", self.parts)
        return end
