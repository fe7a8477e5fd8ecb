"""The structure of MP4, QuickTime, Matroska and WebM files.

Source: ISO/IEC 14496-12 and the QuickTime File Format; RFC 9559 and RFC 8794 (EBML) of Matroska.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.windows import DamagedError, Film, Window
from lava_vpr.storage.limits import within

BOXES_FIRST = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
"""Types of the box with which a file may begin."""

_Box = tuple[bytes, int, int]  # type, start of the content, end


def _boxes(file: Window, position: int, end: int) -> Iterator[_Box]:
    """The boxes that fill the file from ``position`` to ``end``."""
    while position < end:
        if position + 8 > end:
            raise DamagedError("it ends within a header")
        length, kind = file.numbers(">I4s", position)
        start = position + 8
        if length == 1:
            length, start = file.numbers(">Q", start)[0], start + 8
        elif length == 0 and kind == b"mdat":
            length = end - position  # up to the end of the file
        if length < start - position or not all(0x20 <= c < 0x7F or c == 0xA9 for c in kind):
            raise DamagedError(f"no part begins at byte {position:,}, where one should")
        position = file.reach(position + length, end if end < file.size else None)
        yield kind, start, position


class _Track:
    """The boxes of one track, by type."""

    def __init__(self, file: Window, start: int, end: int) -> None:
        self.file = file
        self.boxes: dict[bytes, tuple[int, int]] = {}
        self.enter(start, end)

    def enter(self, start: int, end: int) -> None:
        """Note all boxes between; of equal ones the first (a handler of the data follows that of the medium)."""
        for kind, first, last in _boxes(self.file, start, end):
            self.boxes.setdefault(kind, (first, last))
            if kind in (b"mdia", b"minf", b"dinf", b"stbl", b"edts"):
                self.enter(first, last)

    def is_video(self) -> bool:
        """Whether the track shows pictures."""
        return b"hdlr" in self.boxes and self.file.at(self.boxes[b"hdlr"][0] + 8, 4) == b"vide"

    def table(self, kind: bytes, layout: str, skip: int = 4) -> NDArray[np.int64]:
        """The rows of a table box, int64 (n, columns).

        Args:
            kind: Its type.
            layout: A row's columns as NumPy types of one size.
            skip: Bytes before the count of rows.
        """
        if kind not in self.boxes:
            return np.zeros((0, len(layout.split(","))), np.int64)
        start, end = self.boxes[kind]
        rows = self.file.numbers(">I", start + skip)[0]
        columns = layout.split(",")
        width = np.dtype(columns[0]).itemsize * len(columns)
        start += skip + 4
        within("video_parts", rows)
        if start + rows * width > end:
            raise DamagedError(f"its table {kind.decode('latin-1')!r} is not whole")
        data = np.frombuffer(self.file.at(start, rows * width), columns[0])
        return data.reshape(-1, len(columns)).astype(np.int64)

    def sizes(self) -> NDArray[np.int64]:
        """Bytes of each sample, int64 (n,)."""
        if b"stsz" not in self.boxes:
            return np.zeros(0, np.int64)
        same, count = self.file.numbers(">II", self.boxes[b"stsz"][0] + 4)
        within("video_parts", count)
        return np.full(count, same, np.int64) if same else self.table(b"stsz", ">u4", skip=8)[:, 0]

    def check_samples(self, media: list[tuple[int, int]]) -> None:
        """Every chunk of samples must lie within one of the file's parts with media."""
        offsets = self.table(b"stco", ">u4")[:, 0]
        if b"co64" in self.boxes:
            offsets = self.table(b"co64", ">i8")[:, 0]
        runs, sizes = self.table(b"stsc", ">u4,>u4,>u4"), self.sizes()
        if not len(sizes):
            return  # compact sizes, or all samples are in fragments
        if not len(runs) or not len(offsets) or runs[0, 0] != 1 or (np.diff(runs[:, 0]) <= 0).any():
            raise DamagedError("its tables of samples do not say where they are")
        chunks = np.repeat(runs[:, 1], np.diff(np.append(runs[:, 0], max(len(offsets), runs[-1, 0]) + 1)))
        if len(chunks) != len(offsets) or chunks.sum() < len(sizes) or (chunks <= 0).any():
            raise DamagedError(f"its tables of samples do not place all {len(sizes):,}")
        bounds = np.minimum(np.cumsum(chunks), len(sizes))
        totals = np.concatenate([[0], np.cumsum(sizes)])
        ends = offsets + np.diff(totals[np.concatenate([[0], bounds])])
        starts, stops = np.array(media, np.int64).reshape(-1, 2).T
        part = np.searchsorted(starts, offsets, side="right") - 1
        if not len(starts) or (part < 0).any() or (ends > stops[part]).any():
            raise DamagedError("frames are missing")

    def span(self, movie_scale: int) -> float:
        """Seconds from the first frame to the last that is shown."""
        steps = self.table(b"stts", ">u4,>u4")
        if b"mdhd" not in self.boxes or not len(steps) or not self.sizes().size:
            return 0.0
        start = self.boxes[b"mdhd"][0]
        scale = self.file.numbers(">I", start + (20 if self.file.at(start, 1)[0] else 12))[0]
        if not scale:
            return 0.0
        whole = float((steps[:, 0].astype(np.float64) * steps[:, 1]).sum()) / scale
        shown, last = self.shown(movie_scale), float(steps[-1, 1]) / scale
        return max(0.0, (whole if shown is None else min(whole, shown)) - last)

    def shown(self, movie_scale: int) -> float | None:
        """Seconds that the edit list shows; None without one."""
        if b"elst" not in self.boxes or not movie_scale:
            return None
        wide = self.file.at(self.boxes[b"elst"][0], 1)[0] == 1
        if wide:
            rows = self.table(b"elst", ">u4,>u4,>i4,>i4,>u4")
            parts = (rows[:, 0] * 2.0**32 + rows[:, 1])[rows[:, 2] >= 0]
        else:
            rows = self.table(b"elst", ">i4,>i4,>i4")
            parts = rows[rows[:, 1] >= 0, 0].astype(np.float64)
        return float(parts.sum()) / movie_scale

    def check_source(self) -> None:
        """The media must lie in this file."""
        if b"dref" not in self.boxes:
            return
        start, end = self.boxes[b"dref"]
        for _, first, _ in _boxes(self.file, start + 8, end):
            if not self.file.at(first, 4)[3] & 1:
                raise InputError("plays other files, which it names, instead of its own content; convert it to MP4")

    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        start = self.boxes[b"stsd"][0] if b"stsd" in self.boxes else None
        if start is None or not self.file.numbers(">I", start + 4)[0]:
            return 0, 0
        width, height = struct.unpack(">HH", self.file.at(start + 8 + 32, 4))
        return width, height


def walk_mp4(file: Window) -> Film:
    """What an MP4 or QuickTime file says of itself; it must be whole.

    Raises:
        DamagedError: part of it is missing.
        InputError: its media lie in other files.
    """
    movie: list[_Box] = []
    media: list[tuple[int, int]] = []
    for kind, start, end in _boxes(file, 0, file.size):
        if kind == b"moov":
            movie = list(_boxes(file, start, end))
        elif kind == b"mdat":
            media.append((start, end))
        elif kind == b"sidx":
            _check_index(file, start, end)
    if not movie:
        raise DamagedError("its table of contents (moov) is missing")
    scale = 0
    for kind, start, _ in movie:
        if kind == b"mvhd":
            scale = file.numbers(">I", start + (20 if file.at(start, 1)[0] else 12))[0]
    tracks = [_Track(file, start, end) for kind, start, end in movie if kind == b"trak"]
    films = [track for track in tracks if track.is_video()]
    for track in films:
        track.check_source()
        track.check_samples(media)
    # An edit list hides frames, and rounds the time that it shows.
    frames = 0 if not films or b"elst" in films[0].boxes else len(films[0].sizes())
    return Film("mov", tuple(track.size() for track in films), frames, films[0].span(scale) if films else 0.0)


def _check_index(file: Window, start: int, end: int) -> None:
    """The fragments that an index lists must be there."""
    wide = file.at(start, 1)[0] > 0
    offset = file.numbers(">Q", start + 20)[0] if wide else file.numbers(">I", start + 16)[0]
    position = start + (28 if wide else 20)
    for row in range(file.numbers(">H", position + 2)[0]):
        if position + 8 + 12 * row > end:
            raise DamagedError("its index of fragments is not whole")
        offset += file.numbers(">I", position + 4 + 12 * row)[0] & 0x7FFFFFFF
    file.reach(end + offset)


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
