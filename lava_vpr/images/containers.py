"""The structure of video files: a walk that sees whether a whole video is there, before FFmpeg opens it.

FFmpeg plays what is left of a file that was cut short, and takes a text for a playlist of other files. So a video is
taken only if its content is that of a container known here, and if that is whole:

* AVI, MP4, QuickTime and Matroska (WebM) files say how long each part is, which shows every cut; those of a live
  recording of unknown length are whole up to their last part, and no shorter than they say.
* An MPEG program stream says it of each packet only: it shows a cut unless that fell between two packets.

PyAV (17.1, FFmpeg 8) cannot take the place of these walks: of the 599 cuts of tests/images/test_videos.py it takes 58
for a whole video, with every packet decoded, its marks of corruption looked at, and frames and seconds held against
the header (28 of 85 cuts of a program stream, 16 of 173 of Matroska, 14 of 341 of the others); these walks take none.

Sources: AVI RIFF File Reference (Microsoft) with the OpenDML extensions 1.02; ISO/IEC 13818-1 for program streams.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

from lava_vpr.errors import InputError
from lava_vpr.images.films import BOXES_FIRST, walk_matroska, walk_mp4
from lava_vpr.images.windows import DamagedError, Film, Window

_KNOWN = "AVI, MP4, QuickTime, Matroska, WebM or MPEG program stream"
_AVI_UNKNOWN = (0, 0xFFFFFFFF)  # lengths that a writer leaves which cannot go back to them
_AVI_ENDLESS = 1 << 30  # the number of frames that FFmpeg leaves then


class _Avi:
    """One walk over an AVI file."""

    def __init__(self, file: Window) -> None:
        self.file = file
        self.streams: list[bytes] = []  # header of each stream
        self.formats: list[bytes] = []
        # By the stream's two digits: its chunks, those that are not empty, and the number of the last of these.
        self.counts: dict[bytes, tuple[int, int, int]] = {}

    def film(self) -> Film:
        """What the file says of itself."""
        position = 0
        while position + 12 <= self.file.size:
            kind, length, form = self.file.numbers("<4sI4s", position)
            if kind != b"RIFF" or form not in (b"AVI ", b"AVIX"):
                break  # what follows is no part of the video
            position = self.children(position + 12, self.end(position + 8, length, None))
        sizes, first = [], (0, 0.0)
        for number, header in enumerate(self.streams):
            if header[:4] != b"vids" or len(header) < 48:
                continue
            scale, rate, _, declared = struct.unpack_from("<4I", header, 20)
            chunks, frames, last = self.counts.get(b"%02d" % number, (0, 0, 0))
            if chunks < declared < _AVI_ENDLESS:
                raise DamagedError(f"it holds {chunks:,} of {declared:,} frames")
            if not first[0] and rate:
                first = frames, last * scale / rate
            if len(self.formats) > number and len(self.formats[number]) >= 12:
                width, height = struct.unpack_from("<ii", self.formats[number], 4)
                sizes.append((abs(width), abs(height)))
        return Film("avi", tuple(sizes), *first)

    def end(self, start: int, length: int, beyond: int | None) -> int:
        """Where a part ends that begins at ``start``."""
        if length in _AVI_UNKNOWN and (beyond is None or length):
            return self.file.reach(self.file.size if beyond is None else beyond)
        return self.file.reach(start + length, beyond)

    def children(self, position: int, end: int) -> int:
        """Walk over the parts from ``position`` to ``end``, which is returned; lists are entered."""
        while position + 8 <= end:
            kind, length = self.file.numbers("<4sI", position)
            if not all(0x20 <= c < 0x7F for c in kind):
                raise DamagedError(f"no part begins at byte {position:,}, where one should")
            start = position + 8
            if kind == b"LIST":
                form = self.file.at(start, 4)
                unknown = length in _AVI_UNKNOWN and form == b"movi"
                position = self.children(start + 4, end if unknown else self.file.reach(start + length, end))
                position += 0 if unknown else length % 2
                continue
            position = self.file.reach(start + length, end)
            if kind in (b"strh", b"strf"):
                (self.streams if kind == b"strh" else self.formats).append(self.file.at(start, min(length, 64)))
            elif kind[:2].isdigit():
                chunks, frames, last = self.counts.get(kind[:2], (0, 0, 0))
                # An empty chunk repeats the frame before it.
                self.counts[kind[:2]] = (chunks + 1, frames + 1, chunks) if length else (chunks + 1, frames, last)
            position += length % 2
        if position < end:
            raise DamagedError("it ends within a header")
        return end


def _walk_program_stream(file: Window) -> Film:
    """An MPEG program stream: every pack and packet must be there whole."""
    position = 0
    while position < file.size:
        prefix, code = file.numbers(">3sB", position)
        if prefix != b"\0\0\1" or code < 0xB9:
            raise DamagedError(f"no packet begins at byte {position:,}, where one should")
        if code == 0xB9:
            position = file.reach(position + 4)
        elif code == 0xBA:
            modern = file.at(position, 5)[4] >> 6 == 1
            length = 14 + (file.at(position, 14)[13] & 7) if modern else 12
            position = file.reach(position + length)
        else:
            position = file.reach(position + 6 + file.numbers(">H", position + 4)[0])
    return Film("mpeg")


_WALKS: tuple[tuple[re.Pattern[bytes], Callable[[Window], Film]], ...] = (
    (re.compile(rb"RIFF.{4}AVI ", re.DOTALL), lambda file: _Avi(file).film()),
    (re.compile(rb"\x1a\x45\xdf\xa3"), walk_matroska),
    (re.compile(rb".{4}(?:%b)" % b"|".join(BOXES_FIRST), re.DOTALL), walk_mp4),
    (re.compile(rb"\x00\x00\x01\xba"), _walk_program_stream),
)
"""The walk over a file, by how it begins."""


def examine(handle: int) -> Film:
    """What a video file says of itself.

    Args:
        handle: The descriptor of a regular file.
    Raises:
        DamagedError: part of it is missing.
        InputError: it is no video of a known format, or plays other files; the text lacks the file's name.
    """
    file = Window(handle)
    first = file.at(0, min(12, file.size))
    for begins, walk in _WALKS:
        if begins.match(first):
            return walk(file)
    if not first:
        raise InputError("is empty (0 bytes); copy it again or remove it")
    raise InputError(f"is no {_KNOWN} video, whatever its name says; convert it to MP4 (H.264) or to images")
