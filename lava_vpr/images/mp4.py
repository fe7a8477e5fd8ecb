"""The structure of MP4 and QuickTime files: a walk that checks that all boxes and samples are present.

Sources: ISO/IEC 14496-12 and the QuickTime File Format.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.windows import DamagedError, Film, Part, Window, part_kind
from lava_vpr.storage.limits import within

BOXES_FIRST = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
"""Types of box with which a file may begin."""

_ENTERED = (b"moov", b"trak", b"mdia", b"minf", b"dinf", b"stbl", b"edts")


def box(file: Window, position: int, end: int) -> Part:
    """The box at ``position``, within content that ends at ``end``."""
    length, kind = file.numbers(">I4s", position)
    start = position + 8
    if length == 1:
        length, start = file.numbers(">Q", start)[0], start + 8
    elif length == 0 and kind == b"mdat":
        length = end - position  # up to the end of the file
    if length < start - position:
        raise DamagedError(f"no part begins at byte {position:,}, where one should")
    return part_kind(kind, position), start, position + length


class _Track:
    """One track and its boxes by type; of boxes of the same type the first (the data handler follows the media
    handler)."""

    def __init__(self, file: Window) -> None:
        self.file = file
        self.boxes: dict[bytes, tuple[int, int]] = {}

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
        """Check that every chunk of samples lies within one of the file's parts with media."""
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

    def scale(self) -> int:
        """Ticks of its clock per second; 0 if unknown."""
        if b"mdhd" not in self.boxes:
            return 0
        start = self.boxes[b"mdhd"][0]
        return int(self.file.numbers(">I", start + (20 if self.file.at(start, 1)[0] else 12))[0])

    def span(self, movie_scale: int) -> float:
        """Seconds from the first frame to the last that is shown."""
        steps = self.table(b"stts", ">u4,>u4")
        scale = self.scale()
        if not scale or not len(steps) or not self.sizes().size:
            return 0.0
        whole = float((steps[:, 0].astype(np.float64) * steps[:, 1]).sum()) / scale
        shown, last = self.shown(movie_scale), float(steps[-1, 1]) / scale
        return max(0.0, (whole if shown is None else min(whole, shown)) - last)

    def edits(self) -> NDArray[np.int64]:
        """The segments of the edit list, int64 (n, 2): duration by the movie's clock, and start by the track's."""
        wide = b"elst" in self.boxes and self.file.at(self.boxes[b"elst"][0], 1)[0] == 1
        rows = self.table(b"elst", ",".join([">i4"] * (5 if wide else 3)))
        rows = rows[:, [0, 2]] << 32 | rows[:, [1, 3]] & 0xFFFFFFFF if wide else rows[:, :2]
        return rows[rows[:, 1] >= 0]  # other rows are pauses

    def shown(self, movie_scale: int) -> float | None:
        """Total duration of the edit list in seconds; None without one."""
        if b"elst" not in self.boxes or not movie_scale:
            return None
        return float(self.edits()[:, 0].sum()) / movie_scale

    def least(self, movie_scale: int) -> int:
        """Fewest frames that it shows, without those at the rounded ends of its edit list; 0 if unknown."""
        steps, sizes, moved = self.table(b"stts", ">u4,>u4"), self.sizes(), self.table(b"ctts", ">i4,>i4")
        if len(sizes) and steps[:, 0].sum() != len(sizes):  # compact sizes are not counted here
            raise DamagedError(f"it has times of {steps[:, 0].sum():,} frames, and sizes of {len(sizes):,}")
        if (moved[:, :1] < 0).any():
            raise DamagedError("its table 'ctts' has a negative count")
        if b"elst" not in self.boxes or not len(sizes):
            return len(sizes)
        edits, scale = self.edits(), self.scale()
        if len(edits) != 1 or not movie_scale or (len(moved) and moved[:, 0].sum() != len(sizes)):
            return 0
        each = np.repeat(steps[:, 1], steps[:, 0])
        times = np.cumsum(each) - each + (np.repeat(moved[:, 1], moved[:, 0]) if len(moved) else 0)
        length, first = edits[0].tolist()
        return int(((times >= first) & (times < first + (length - 1) * scale / movie_scale)).sum())

    def check_source(self) -> None:
        """Check that the media are in this file."""
        if b"dref" not in self.boxes:
            return
        start, end = self.boxes[b"dref"]
        for _, first, _ in self.file.walk(start + 8, end, box):
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
    """Properties of an MP4 or QuickTime file, which must be complete.

    Raises:
        DamagedError: part of it is missing.
        InputError: its media are in other files.
    """
    tracks: list[_Track] = []
    media: list[tuple[int, int]] = []
    scale, movie = 0, False
    for kind, start, end in file.walk(0, file.size, box, _ENTERED):
        if kind == b"moov":
            movie = movie or end > start
        elif kind == b"mvhd":
            scale = file.numbers(">I", start + (20 if file.at(start, 1)[0] else 12))[0]
        elif kind == b"mdat":
            media.append((start, end))
        elif kind == b"sidx":
            _check_index(file, start, end)
        elif kind == b"trak":
            tracks.append(_Track(file))
        elif tracks:
            tracks[-1].boxes.setdefault(kind, (start, end))
    if not movie:
        raise DamagedError("its table of contents (moov) is missing")
    films = [track for track in tracks if track.is_video()]
    for track in films:
        track.check_source()
        track.check_samples(media)
    # An edit list hides frames, and rounds the time that it shows.
    frames = 0 if not films or b"elst" in films[0].boxes else len(films[0].sizes())
    span, least = (films[0].span(scale), films[0].least(scale)) if films else (0.0, 0)
    return Film("mov", tuple(track.size() for track in films), frames, span, least)


def _check_index(file: Window, start: int, end: int) -> None:
    """Check that the fragments that an index lists are present."""
    wide = file.at(start, 1)[0] > 0
    offset = file.numbers(">Q", start + 20)[0] if wide else file.numbers(">I", start + 16)[0]
    position = start + (28 if wide else 20)
    for row in range(file.numbers(">H", position + 2)[0]):
        if position + 8 + 12 * row > end:
            raise DamagedError("its index of fragments is not whole")
        offset += file.numbers(">I", position + 4 + 12 * row)[0] & 0x7FFFFFFF
    file.reach(end + offset)
