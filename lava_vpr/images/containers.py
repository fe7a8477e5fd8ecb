"""The structure of video files: a walk that checks that a video is complete before FFmpeg opens it.

FFmpeg plays the rest of a truncated file, and may read a text file as a playlist of other files. So a video is accepted
only if it is a container of a known format, and complete:

* AVI, MP4, QuickTime and Matroska (WebM) files give the length of each part, which reveals every cut. A live recording
  of unknown length must be complete up to its last part, and as long as its header says.
* An MPEG program stream gives the length of each packet only, which reveals a cut unless it falls between two packets.

PyAV (17.1, FFmpeg 8) cannot replace these walks: it accepts 58 of the 599 cuts of tests/images/test_videos.py as
complete videos, even with every packet decoded, its marks of corruption read, and frames and seconds compared with the
header (28 of 85 cuts of a program stream, 16 of 173 of Matroska, 14 of 341 of the others); these walks accept none.

Sources: AVI RIFF File Reference (Microsoft) with the OpenDML extensions 1.02; ISO/IEC 13818-1 for program streams;
`mp4` and `matroska` beside this module name theirs.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

from lava_vpr.errors import InputError
from lava_vpr.images.matroska import walk_matroska
from lava_vpr.images.mp4 import BOXES_FIRST, walk_mp4
from lava_vpr.images.windows import UNKNOWN_LENGTHS, DamagedError, Film, Part, Window, riff_chunk

_KNOWN = "AVI, MP4, QuickTime, Matroska, WebM or MPEG program stream"
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
    (re.compile(rb"\x1a\x45\xdf\xa3"), walk_matroska),
    (re.compile(rb".{4}(?:%b)" % b"|".join(BOXES_FIRST), re.DOTALL), walk_mp4),
    (re.compile(rb"\x00\x00\x01\xba"), _walk_program_stream),
)
"""The walk for each kind of file, by the bytes at its beginning."""


def examine(handle: int) -> Film:
    """Properties of a video file, found by a walk over its structure.

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
