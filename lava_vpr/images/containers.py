"""The structure of video files: a walk that checks that a video is complete before FFmpeg opens it.

FFmpeg plays the rest of a truncated file, and may read a text file as a playlist of other files. So a video is accepted
only if it is a container of a known format, and complete:

* AVI, MP4, QuickTime and Matroska (WebM) files give the length of each part, which reveals every cut. A live recording
of unknown length must be complete up to its last part, and as long as its header says. * An MPEG program stream gives
the length of each packet only, which reveals a cut unless it falls between two packets.

PyAV (17.1, FFmpeg 8) cannot replace these walks: it accepts 58 of the 599 cuts of tests/images/test_videos.py as
complete videos, even with every packet decoded, its marks of corruption read, and frames and seconds compared with the
header (28 of 85 cuts of a program stream, 16 of 173 of Matroska, 14 of 341 of the others); these walks accept none.

Sources: AVI RIFF File Reference (Microsoft) with the OpenDML extensions 1.02; ISO/IEC 13818-1 for program streams;
ISO/IEC 14496-12 and the QuickTime File Format; RFC 9559 and RFC 8794 (EBML) for Matroska.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.windows import UNKNOWN_LENGTHS, DamagedError, Film, Part, Window, part_kind, riff_chunk
from lava_vpr.storage.limits import within

_KNOWN = "AVI, MP4, QuickTime, Matroska, WebM or MPEG program stream"
_BOXES_FIRST = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
"""Types of box with which a file may begin."""

_ENTERED = (b"moov", b"trak", b"mdia", b"minf", b"dinf", b"stbl", b"edts")


def _box(file: Window, position: int, end: int) -> Part:
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
        for _, first, _ in self.file.walk(start + 8, end, _box):
            if not self.file.at(first, 4)[3] & 1:
                raise InputError("plays other files, which it names, instead of its own content; convert it to MP4")

    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        start = self.boxes[b"stsd"][0] if b"stsd" in self.boxes else None
        if start is None or not self.file.numbers(">I", start + 4)[0]:
            return 0, 0
        width, height = struct.unpack(">HH", self.file.at(start + 8 + 32, 4))
        return width, height


def _walk_mp4(file: Window) -> Film:
    """Properties of an MP4 or QuickTime file, which must be complete.

    Raises:
        DamagedError: part of it is missing.
        InputError: its media are in other files.
    """
    tracks: list[_Track] = []
    media: list[tuple[int, int]] = []
    scale, movie = 0, False
    for kind, start, end in file.walk(0, file.size, _box, _ENTERED):
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


_DOCTYPE, _SEGMENT, _INFO, _TRACKS, _CLUSTER = 0x4282, 0x18538067, 0x1549A966, 0x1654AE6B, 0x1F43B675
_SCALE, _DURATION, _TIMESTAMP, _SIMPLE_BLOCK, _GROUP, _BLOCK = 0x2AD7B1, 0x4489, 0xE7, 0xA3, 0xA0, 0xA1
_TRACK, _NUMBER, _TYPE, _VIDEO, _WIDTH, _HEIGHT = 0xAE, 0xD7, 0x83, 0xE0, 0xB0, 0xBA
_MASTERS = (_INFO, _TRACKS, _TRACK, _VIDEO, _CLUSTER, _GROUP)
_SLACK_S = 1.0  # between the length that a live recording gives for itself and its last block


def _variable(data: bytes, most: int, position: int) -> tuple[int, int]:
    """The number of variable length with which ``data`` begins, its mark included, and its length in bytes.

    Raises:
        DamagedError: it is longer than ``most``, or incomplete; ``position`` is where it begins.
    """
    length = 9 - data[0].bit_length() if data else 9
    if length > min(most, len(data)):
        raise DamagedError(f"no part begins at byte {position:,}, where one should")
    return int.from_bytes(data[:length], "big"), length


def _element(file: Window, position: int, end: int) -> Part:
    """The element at ``position``; one of unknown length counts as empty: its contents follow."""
    head = file.at(position, min(12, file.size - position))
    number, first = _variable(head, 4, position)
    size, second = _variable(head[first:], 8, position)
    start, size = position + first + second, size - (1 << 7 * second)
    if size < (1 << 7 * second) - 1:
        return number, start, start + size
    if number not in (_SEGMENT, _CLUSTER):
        raise DamagedError("a part within another has no length")
    return number, start, start


class _Recording:
    """Properties collected from the elements of a Matroska file; times are in ticks."""

    def __init__(self, file: Window) -> None:
        self.file = file
        self.scale = 1_000_000  # nanoseconds of a tick
        self.duration = 0.0
        self.tracks: list[dict[int, int]] = []  # number, type, width and height, by their elements
        self.cluster = 0  # time stamp of the cluster
        self.blocks: dict[int, tuple[int, int, int]] = {}  # by the track's number: how many, first and last time

    def note(self, number: int, start: int, end: int) -> None:
        """Record the value of an element."""
        if number == _DURATION and end - start in (4, 8):
            self.duration = self.file.numbers(">f" if end - start == 4 else ">d", start)[0]
        elif number == _TRACK:
            self.tracks.append({})
        elif number in (_SIMPLE_BLOCK, _BLOCK):
            self.block(start)
        elif number in (_SCALE, _TIMESTAMP) or (number in (_NUMBER, _TYPE, _WIDTH, _HEIGHT) and self.tracks):
            value = int.from_bytes(self.file.at(start, min(8, end - start)), "big")
            if number == _SCALE:
                self.scale = value
            elif number == _TIMESTAMP:
                self.cluster = value
            else:
                self.tracks[-1][number] = value

    def block(self, start: int) -> None:
        """Record the time of a block."""
        head = self.file.at(start, min(10, self.file.size - start))
        track, length = _variable(head, 8, start)
        time = self.cluster + self.file.numbers(">h", start + length)[0]
        count, first, last = self.blocks.get(track - (1 << 7 * length), (0, time, time))
        self.blocks[track - (1 << 7 * length)] = count + 1, min(first, time), max(last, time)

    def film(self, live: bool) -> Film:
        """Properties of the file; a ``live`` recording must be as long as its header says, if it gives a length."""
        declared = self.duration * self.scale / 1e9
        seconds = max((last for _, _, last in self.blocks.values()), default=0) * self.scale / 1e9
        if live and declared > seconds + _SLACK_S:
            raise DamagedError(f"it holds {seconds:.1f} of {declared:.1f} seconds")
        films = [track for track in self.tracks if track.get(_TYPE) == 1]
        count, first, last = self.blocks.get(films[0].get(_NUMBER, -1) if films else -1, (0, 0, 0))
        sizes = tuple((track.get(_WIDTH, 0), track.get(_HEIGHT, 0)) for track in films)
        return Film("matroska,webm", sizes, count, (last - first) * self.scale / 1e9)


def _walk_matroska(file: Window) -> Film:
    """Properties of a Matroska or WebM file, which must be complete.

    Raises:
        DamagedError: part of it is missing.
        InputError: it is of another type.
    """
    _, start, end = _element(file, 0, file.size)
    kinds = [file.at(s, min(8, e - s)) for n, s, e in file.walk(start, file.reach(end), _element) if n == _DOCTYPE]
    if kinds[:1] not in ([b"matroska"], [b"webm"]):
        raise InputError("is no Matroska or WebM video, though it begins like one; convert it to MP4 (H.264)")
    number, start, stop = _element(file, end, file.size)
    if number != _SEGMENT:
        raise DamagedError(f"no segment begins at byte {end:,}")
    live, recording = stop == start, _Recording(file)
    for part in file.walk(start, file.reach(file.size if live else stop), _element, _MASTERS):
        recording.note(*part)
    return recording.film(live)


_AVI_ENDLESS = 1 << 30  # the number of frames that FFmpeg leaves where it cannot go back to it


def _walk_avi(file: Window) -> Film:
    """Properties of an AVI file; every chunk must be complete."""
    streams: list[bytes] = []  # header of each stream
    formats: list[bytes] = []
    # By the stream's two digits: its chunks, those that are not empty, and the number of the last of these.
    counts: dict[bytes, tuple[int, int, int]] = {}
    position = 0
    while position + 12 <= file.size:
        kind, length, form = file.numbers("<4sI4s", position)
        if kind != b"RIFF" or form not in (b"AVI ", b"AVIX"):
            break  # what follows is no part of the video
        begin = position + 12
        position = file.reach(file.size if length in UNKNOWN_LENGTHS else position + 8 + length)
        for kind, start, end in file.walk(begin, position, riff_chunk, (b"LIST",), 2):
            if kind in (b"strh", b"strf"):
                (streams if kind == b"strh" else formats).append(file.at(start, min(end - start, 64)))
            elif kind[:2].isdigit():
                chunks, frames, last = counts.get(kind[:2], (0, 0, 0))
                # An empty chunk repeats the frame before it.
                counts[kind[:2]] = (chunks + 1, frames + 1, chunks) if end > start else (chunks + 1, frames, last)
    sizes, first = [], (0, 0.0)
    for number, header in enumerate(streams):
        if header[:4] != b"vids" or len(header) < 48:
            continue
        scale, rate, _, declared = struct.unpack_from("<4I", header, 20)
        chunks, frames, last = counts.get(b"%02d" % number, (0, 0, 0))
        if chunks < declared < _AVI_ENDLESS:
            raise DamagedError(f"it holds {chunks:,} of {declared:,} frames")
        if not first[0] and rate:
            first = frames, last * scale / rate
        if len(formats) > number and len(formats[number]) >= 12:
            width, height = struct.unpack_from("<ii", formats[number], 4)
            sizes.append((abs(width), abs(height)))
    return Film("avi", tuple(sizes), *first)


def _packet(file: Window, position: int, end: int) -> Part:
    """The pack or packet of an MPEG program stream at ``position``."""
    prefix, code = file.numbers(">3sB", position)
    if prefix != b"\0\0\1" or code < 0xB9:
        raise DamagedError(f"no packet begins at byte {position:,}, where one should")
    if code == 0xB9:
        return code, position, position + 4
    if code != 0xBA:
        return code, position, position + 6 + file.numbers(">H", position + 4)[0]
    modern = file.at(position, 5)[4] >> 6 == 1
    return code, position, position + (14 + (file.at(position, 14)[13] & 7) if modern else 12)


def _walk_program_stream(file: Window) -> Film:
    """Properties of an MPEG program stream; every pack and packet must be complete."""
    for _ in file.walk(0, file.size, _packet):
        pass
    return Film("mpeg")


_WALKS: tuple[tuple[re.Pattern[bytes], Callable[[Window], Film]], ...] = (
    (re.compile(rb"RIFF.{4}AVI ", re.DOTALL), _walk_avi),
    (re.compile(rb"\x1a\x45\xdf\xa3"), _walk_matroska),
    (re.compile(rb".{4}(?:%b)" % b"|".join(_BOXES_FIRST), re.DOTALL), _walk_mp4),
    (re.compile(rb"\x00\x00\x01\xba"), _walk_program_stream),
)
"""The walk for each kind of file, by the bytes at its beginning."""


def examine(handle: int) -> Film:
    """What a video file says of itself.

    Args:
        handle: The descriptor of a regular file.
    Raises:
        DamagedError: part of it is missing.
        InputError: it is no video of a known format, or refers to other files; the text lacks the file's name.
    """
    file = Window(handle, "video_parts")
    first = file.at(0, min(12, file.size))
    for begins, walk in _WALKS:
        if begins.match(first):
            return walk(file)
    if not first:
        raise InputError("is empty (0 bytes); copy it again or remove it")
    raise InputError(f"is no {_KNOWN} video, whatever its name says; convert it to MP4 (H.264) or to images")
