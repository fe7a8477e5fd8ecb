"""The structure of MP4 and QuickTime files. Source: ISO/IEC 14496-12, and the QuickTime File Format."""

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
