"""The structure of TIFF and BigTIFF files. Source: TIFF 6.0 (Adobe), and the BigTIFF design of libtiff."""

from __future__ import annotations

import struct

from lava_vpr.errors import InputError
from lava_vpr.images.damage import DamagedError, within

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _FORMAT = 256, 257, 258, 259, 277, 339
_STRIPS, _STRIP_BYTES, _TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES = 273, 279, 322, 323, 324, 325
_TYPES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}  # of whole numbers; others are not asked for
# Strips compressed by LZW, JPEG or Deflate end in a code for the end or a checksum, never in so many zeros.
_ENDED, _ZEROS = (5, 7, 8, 32946), 8
_SGI_LOG = (34676, 34677)  # compressions that code floats as integers
_FORMATS = {1: "uint", 2: "int", 3: "float"}
_ASKED = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _FORMAT, _STRIPS, _STRIP_BYTES}
_ASKED |= {_TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES}


def _directory(data: bytes) -> dict[int, tuple[int, ...]]:
    """The whole numbers of the first directory, by tag."""
    order = "<" if data[:2] == b"II" else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    position = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)[0]
    if position + 8 > len(data):
        raise DamagedError("it ends before its directory")
    count = struct.unpack_from(order + ("Q" if big else "H"), data, position)[0]
    position, size, field = (position + 8, 20, 8) if big else (position + 2, 12, 4)
    if position + count * size > len(data):
        raise DamagedError("it ends within its directory")
    found: dict[int, tuple[int, ...]] = {}
    for entry in range(position, position + count * size, size):
        tag, kind, number = struct.unpack_from(order + ("HHQ" if big else "HHI"), data, entry)
        if tag not in _ASKED or kind not in _TYPES or tag in found:
            continue
        within("image_parts", number)
        length = number * struct.calcsize("<" + _TYPES[kind])
        start = entry + size - field
        if length > field:
            start = struct.unpack_from(order + ("Q" if big else "I"), data, start)[0]
        if start + length > len(data):
            raise DamagedError("it ends within a table of its directory")
        found[tag] = struct.unpack_from(f"{order}{number}{_TYPES[kind]}", data, start)
    return found


def walk_tiff(data: bytes) -> tuple[int, int]:
    """Width and height of the first picture of a TIFF, or of a tile if that is larger; all its strips must be there.

    Raises:
        DamagedError, struct.error: part of the file is missing.
        InputError: its samples are no unsigned numbers of up to 16 bits.
    """
    tags = _directory(data)
    width, height = _first(tags, _WIDTH), _first(tags, _HEIGHT)
    bits, form, samples = max(tags.get(_BITS) or (1,)), _first(tags, _FORMAT, 1), _first(tags, _SAMPLES, 1)
    if form in _FORMATS and (bits > 16 or form > 1):
        kind = "float32" if _first(tags, _COMPRESSION) in _SGI_LOG else f"{_FORMATS[form]}{bits}"
        raise InputError(f"holds {kind} samples, whose range is unknown; save it with 8 or 16 bits, unsigned")
    if form not in _FORMATS or samples > 4:
        raise InputError(f"holds {samples} unknown samples a pixel; save it as grey or colour with 8 or 16 bits")
    for offsets, lengths in ((_STRIPS, _STRIP_BYTES), (_TILES, _TILE_BYTES)):
        for start, length in zip(tags.get(offsets, ()), tags.get(lengths, ()), strict=False):
            if start + length > len(data):
                raise DamagedError(f"it has {len(data):,} of {start + length:,} bytes")
            if _first(tags, _COMPRESSION, 1) in _ENDED and data[start : start + length].endswith(bytes(_ZEROS)):
                raise DamagedError("zeros stand where a picture was")
    tile_width, tile_height = _first(tags, _TILE_WIDTH), _first(tags, _TILE_HEIGHT)
    return (tile_width, tile_height) if tile_width * tile_height > width * height else (width, height)


def _first(tags: dict[int, tuple[int, ...]], tag: int, otherwise: int = 0) -> int:
    """The first number of a tag."""
    return (tags.get(tag) or (otherwise,))[0]
