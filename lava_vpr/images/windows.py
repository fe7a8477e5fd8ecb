"""Access to a file by position that refuses to read beyond its end, and a walk over its parts that counts them."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

from lava_vpr.storage.limits import limit, within


class DamagedError(Exception):
    """The file's structure is incomplete; the text says how."""


@dataclass(frozen=True)
class Film:
    """Properties of a video file whose structure the walk has found complete.

    Attributes:
        demuxer: FFmpeg's name of the file's format.
        sizes: Width and height of each video stream in pixels, where the file gives them.
        frames: Number of frames of the first video stream, some of which may be hidden; 0 if unknown.
        span: Seconds from its first to its last frame; 0 if unknown.
        least: Fewest frames that an undamaged file shows; 0 if unknown.
    """

    demuxer: str
    sizes: tuple[tuple[int, int], ...] = ()
    frames: int = 0
    span: float = 0.0
    least: int = 0


Part = tuple[Any, int, int]
"""A part of a file: its kind, and the begin and end of its content."""


class Window:
    """A file, open or in memory.

    Args:
        content: The descriptor of a regular file, or all its bytes.
        counted: The limit on its parts.
    """

    def __init__(self, content: int | bytes, counted: str) -> None:
        self.content, self.counted, self.most, self.parts = content, counted, limit(counted), 0
        self.size = os.fstat(content).st_size if isinstance(content, int) else len(content)

    def at(self, position: int, length: int) -> bytes:
        """``length`` bytes from ``position`` on.

        Raises:
            DamagedError: the file ends before.
        """
        data = b""
        if position + length <= self.size:
            held = self.content
            data = os.pread(held, length, position) if isinstance(held, int) else held[position : position + length]
        if len(data) < length:
            raise DamagedError(f"it ends after {self.size:,} bytes, within a header")
        return data

    def numbers(self, layout: str, position: int) -> tuple[Any, ...]:
        """The values that `struct` reads with ``layout`` at ``position``."""
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
        if self.parts > self.most:
            within(self.counted, self.parts)
        return end

    def walk(
        self,
        position: int,
        end: int,
        header: Callable[[Window, int, int], Part],
        entered: Collection[Any] = (),
        align: int = 1,
    ) -> Iterator[Part]:
        """The parts that fill the file from ``position`` to ``end``, in its order; those within another follow it.

        Args:
            position, end: Where the first begins and the last ends.
            header: Reads the header at a position of a part within one that ends at another. A part of unknown length
                counts as empty: its contents follow.
            entered: Kinds of parts whose contents are parts themselves.
            align: Bytes of which each part takes a multiple.
        Raises:
            DamagedError: a part is not whole, or reaches beyond the part around it.
            InputError: as `reach`.
        """
        around = [(end, end)]  # where each part ends that is walked, and where the next one begins
        while around:
            if position >= around[-1][0]:
                position = around.pop()[1]
                continue
            kind, start, stop = header(self, position, around[-1][0])
            self.reach(stop, around[-1][0])
            yield kind, start, stop
            position = stop + (start - stop) % align
            if kind in entered:
                around.append((stop, position))
                position = start


_KIND = re.compile(rb"[\x20-\x7e\xa9]{4}")


def part_kind(kind: bytes, position: int) -> bytes:
    """``kind``, four characters that name a kind of part.

    Raises:
        DamagedError: they are none: no part begins at ``position``.
    """
    if not _KIND.fullmatch(kind):
        raise DamagedError(f"no part begins at byte {position:,}, where one should")
    return kind


def riff_chunk(file: Window, position: int, end: int) -> Part:
    """A chunk of a RIFF file, AVI or WebP; of a list, what follows its form. That of an endless recording is empty."""
    kind, length = file.numbers("<4sI", position)
    start, stop = position + 8, position + 8 + length
    if part_kind(kind, position) == b"LIST":
        start += 4
        stop = start if length in UNKNOWN_LENGTHS and file.at(start - 4, 4) == b"movi" else stop
    return kind, start, stop


UNKNOWN_LENGTHS = (0, 0xFFFFFFFF)
"""Lengths that a writer of RIFF leaves which cannot go back to them."""
