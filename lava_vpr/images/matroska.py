"""The structure of Matroska and WebM files. Source: RFC 9559 and RFC 8794 (EBML)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from lava_vpr.errors import InputError
from lava_vpr.images.windows import DamagedError, Film, Window

_DOCTYPE, _SEGMENT, _INFO, _TRACKS, _CLUSTER = 0x4282, 0x18538067, 0x1549A966, 0x1654AE6B, 0x1F43B675
_SCALE, _DURATION, _TIMESTAMP, _SIMPLE_BLOCK, _GROUP, _BLOCK = 0x2AD7B1, 0x4489, 0xE7, 0xA3, 0xA0, 0xA1
_TRACK, _NUMBER, _TYPE, _VIDEO, _WIDTH, _HEIGHT, _PERIOD = 0xAE, 0xD7, 0x83, 0xE0, 0xB0, 0xBA, 0x23E383
_TOP = {_INFO, _TRACKS, _CLUSTER, 0x114D9B74, 0x1C53BB6B, 0x1941A469, 0x1043A770, 0x1254C367}
_SLACK_S = 1.0  # between the length that a live recording gives for itself and its last block


class _Walk:
    """One walk over a Matroska file."""

    def __init__(self, file: Window) -> None:
        self.file = file
        self.scale = 1_000_000  # nanoseconds of a tick
        self.duration = 0.0  # ticks
        self.sizes: list[tuple[int, int]] = []
        self.video = -1  # number of the first video track
        self.cluster = 0  # time stamp of the cluster, in ticks
        self.frames = 0  # blocks of the video
        self.times: list[int] = []  # first and last of the video's blocks, in ticks
        self.latest = 0  # of all blocks, in ticks

    def element(self, position: int) -> tuple[int, int, int]:
        """Number, start of the content and its length (-1: unknown) of the element at ``position``."""
        head = self.file.at(position, min(12, self.file.size - position))
        length = 9 - head[0].bit_length() if head else 0
        if not 1 <= length <= 4:
            raise DamagedError(f"no part begins at byte {position:,}, where one should")
        size_length = 9 - head[length].bit_length() if len(head) > length else 9
        if len(head) < length + size_length:
            raise DamagedError("it ends within a header" if size_length < 9 else f"byte {position:,} begins no part")
        size = int.from_bytes(head[length : length + size_length], "big") & ((1 << 7 * size_length) - 1)
        unknown = size == (1 << 7 * size_length) - 1
        return int.from_bytes(head[:length], "big"), position + length + size_length, -1 if unknown else size

    def children(self, position: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Number, start and end of each element between; all have known lengths."""
        while position < end:
            number, start, length = self.element(position)
            if length < 0:
                raise DamagedError("a part within another has no length")
            position = self.file.reach(start + length, end)
            yield number, start, position

    def whole(self, start: int, end: int) -> int:
        """The unsigned number that an element holds."""
        return int.from_bytes(self.file.at(start, min(8, end - start)), "big")

    def film(self) -> Film:
        """What the file says of itself."""
        _, start, length = self.element(0)
        end = self.file.reach(start + max(0, length))
        kind = [self.file.at(s, min(8, e - s)) for n, s, e in self.children(start, end) if n == _DOCTYPE]
        if kind[:1] not in ([b"matroska"], [b"webm"]):
            raise InputError("is no Matroska or WebM video, though it begins like one; convert it to MP4 (H.264)")
        number, start, length = self.element(end)
        if number != _SEGMENT:
            raise DamagedError(f"no segment begins at byte {end:,}")
        live = length < 0
        position, end = start, self.file.reach(self.file.size if live else start + length)
        while position < end:
            position = self.top(position, end)
        declared, seconds = self.duration * self.scale / 1e9, self.latest * self.scale / 1e9
        if live and declared > seconds + _SLACK_S:
            raise DamagedError(f"it holds {seconds:.1f} of {declared:.1f} seconds")
        span = (self.times[1] - self.times[0]) * self.scale / 1e9 if self.times else 0.0
        return Film("matroska,webm", tuple(self.sizes), self.frames, span)

    def top(self, position: int, end: int) -> int:
        """Walk over one element of the segment; where it ends is returned."""
        number, start, length = self.element(position)
        if length < 0 and number != _CLUSTER:
            raise DamagedError("a part within another has no length")
        stop = end if length < 0 else self.file.reach(start + length, end)
        if number == _CLUSTER:
            return self.blocks(start, stop, unknown=length < 0)
        if number in (_INFO, _TRACKS):
            for child, first, last in self.children(start, stop):
                if child == _SCALE:
                    self.scale = self.whole(first, last)
                elif child == _DURATION and last - first in (4, 8):
                    self.duration = self.file.numbers(">f" if last - first == 4 else ">d", first)[0]
                elif child == _TRACK:
                    self.track(first, last)
        return stop

    def track(self, start: int, end: int) -> None:
        """Note a track if it is a video."""
        number, kind, size = -1, 0, [0, 0]
        for child, first, last in self.children(start, end):
            if child == _NUMBER:
                number = self.whole(first, last)
            elif child == _TYPE:
                kind = self.whole(first, last)
            elif child == _VIDEO:
                for part, a, b in self.children(first, last):
                    if part in (_WIDTH, _HEIGHT):
                        size[part == _HEIGHT] = self.whole(a, b)
        if kind == 1:
            self.sizes.append((size[0], size[1]))
            self.video = number if self.video < 0 else self.video

    def blocks(self, position: int, end: int, *, unknown: bool) -> int:
        """Walk over the blocks of a cluster; one of unknown length ends where the next top element begins."""
        while position < end:
            number, start, length = self.element(position)
            if unknown and number in _TOP:
                return position
            if length < 0:
                raise DamagedError("a part within another has no length")
            position = self.file.reach(start + length, end)
            if number == _TIMESTAMP:
                self.cluster = self.whole(start, position)
            elif number == _SIMPLE_BLOCK:
                self.block(start)
            elif number == _GROUP:
                for child, first, _ in self.children(start, position):
                    if child == _BLOCK:
                        self.block(first)
        return end

    def block(self, start: int) -> None:
        """Note the time of a block."""
        track, start, _ = self.vint(start)
        time = self.cluster + struct.unpack(">h", self.file.at(start, 2))[0]
        self.latest = max(self.latest, time)
        if track == self.video:
            self.frames += 1
            self.times = [min(self.times[0], time), max(self.times[1], time)] if self.times else [time, time]

    def vint(self, position: int) -> tuple[int, int, int]:
        """A number of variable length, where it ends, and its length in bytes."""
        first = self.file.at(position, 1)[0]
        length = 9 - first.bit_length()
        if length > 8:
            raise DamagedError(f"byte {position:,} begins no block")
        value = int.from_bytes(self.file.at(position, length), "big") & ((1 << 7 * length) - 1)
        return value, position + length, length


def walk_matroska(file: Window) -> Film:
    """What a Matroska or WebM file says of itself; it must be whole.

    Raises:
        DamagedError: part of it is missing.
        InputError: it is of another type.
    """
    return _Walk(file).film()
