"""The structure of image files: a walk that sees whether a whole image is there, and finds its EXIF orientation.

Some OpenCV versions return half a picture for a file that was cut short, and OpenCV ignores the orientation of WebP.
"""

from __future__ import annotations

import re
import struct
import zlib

from lava_vpr.errors import InputError


class DamagedError(Exception):
    """The file's structure is incomplete; the text says how."""


def _walk_jpeg(data: bytes) -> bytes:
    """The EXIF block of a JPEG (TIFF structure, or empty); the walk must meet a scan and the end-of-image marker."""
    exif, position, scans = b"", 2, 0
    marker = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
    while True:
        match = marker.search(data, position)
        if match is None:
            raise DamagedError("it ends before its end-of-image marker")
        code, position = data[match.start() + 1], match.end()
        if code == 0xD9:
            if not scans:
                raise DamagedError("it holds no picture data")
            return exif
        if code == 0x01:
            continue
        if position + 2 > len(data):
            raise DamagedError("it ends within a header")
        length = struct.unpack_from(">H", data, position)[0]
        if code == 0xE1 and not exif and data[position + 2 : position + 8] == b"Exif\0\0":
            exif = data[position + 8 : position + length]
        if code == 0xDA:
            scans += 1
        position += length


def _walk_png(data: bytes) -> bytes:
    """The eXIf chunk of a PNG (or empty); all chunks up to IEND must be there, and the critical ones intact."""
    exif, position = b"", 8
    while True:
        if position + 12 > len(data):
            raise DamagedError("it ends before its IEND chunk")
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 12 + length
        if end > len(data):
            raise DamagedError("it ends within a chunk")
        critical = not kind[0] & 0x20
        if critical and zlib.crc32(data[position + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise DamagedError(f"the checksum of its {kind.decode('latin-1')!r} chunk is wrong")
        if kind == b"eXIf":
            exif = data[position + 8 : end - 4]
        if kind == b"IEND":
            return exif
        position = end


def _walk_webp(data: bytes) -> bytes:
    """The EXIF chunk of a WebP (or empty); the file must be as long as its RIFF header says."""
    end = 8 + struct.unpack_from("<I", data, 4)[0]
    if end > len(data):
        raise DamagedError(f"it has {len(data)} of {end} bytes")
    exif, position = b"", 12
    while position + 8 <= end:
        kind, length = struct.unpack_from("<4sI", data, position)
        if kind == b"EXIF":
            exif = data[position + 8 : position + 8 + length].removeprefix(b"Exif\0\0")
        position += 8 + length + length % 2
    return exif


def _walk_bmp(data: bytes) -> bytes:
    """The EXIF block of a BMP, which has none, so empty; an uncompressed BMP must have all its rows."""
    if len(data) < 34:
        raise DamagedError("it ends within its header")
    offset, header = struct.unpack_from("<II", data, 10)
    if header >= 40:
        width, height, _, depth, compression = struct.unpack_from("<iiHHI", data, 18)
        needed = offset + (abs(width) * depth + 31) // 32 * 4 * abs(height)
        if compression in (0, 3) and needed > len(data):
            raise DamagedError(f"it has {len(data)} of {needed} bytes")
    return b""


def walk(data: bytes) -> bytes:
    """The EXIF block of an image file, empty if it has none; its format's own structure shows that it is whole.

    Raises:
        DamagedError, struct.error: part of the file is missing or damaged.
        InputError: no known format.
    """
    if data[:3] == b"\xff\xd8\xff":
        return _walk_jpeg(data)
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return _walk_png(data)
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return _walk_webp(data)
    if data[:2] == b"BM":
        return _walk_bmp(data)
    if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return b""  # its decoder turns the picture itself and misses no strip
    raise InputError("is not a JPEG, PNG, BMP, TIFF or WebP image, whatever its name says; replace or remove it")


def orientation_of(exif: bytes) -> int:
    """The EXIF orientation 1..8; 1 (upright) where there is none or it makes no sense."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(exif[:4])
    if order is None or len(exif) < 8:
        return 1
    start = struct.unpack_from(order + "I", exif, 4)[0]
    if start + 2 > len(exif):
        return 1
    for k in range(struct.unpack_from(order + "H", exif, start)[0]):
        entry = start + 2 + 12 * k
        if entry + 12 > len(exif):
            return 1
        tag, kind, count, value = struct.unpack_from(order + "HHIH", exif, entry)
        if tag == 0x0112:
            return int(value) if kind == 3 and count == 1 and 1 <= value <= 8 else 1
    return 1
