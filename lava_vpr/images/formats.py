"""The structure of image files: a walk that checks that an image is complete, and finds its size and orientation.

Some OpenCV versions return half a picture for a truncated file. OpenCV also ignores the orientation of WebP, and
allocates memory for any size that a file claims. A walk cannot detect overwritten samples of a BMP or TIFF without
compression or packed by PackBits, nor zeros in fewer than the last 128 bytes of a WebP. Pillow (12.3) cannot replace
the walk: it accepts 4 of 459 cuts like those of tests/images/test_imagefiles.py as complete images (PNG, uncompressed
TIFF), and 129 of 442 files with a tail of zeros (WebP, TIFF packed by Deflate). The walk and OpenCV together accept
none. Pillow also decodes each image a second time, which takes longer than all the work done here. Source of TIFF and
BigTIFF: TIFF 6.0 (Adobe), and the BigTIFF design of libtiff.
"""

from __future__ import annotations

import contextlib
import re
import struct
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.files import advice
from lava_vpr.images.heif import decoded, decoder, walk_heif
from lava_vpr.images.windows import DamagedError, Part, Window, riff_chunk
from lava_vpr.storage.limits import within

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _FORMAT = 256, 257, 258, 259, 277, 339
_STRIPS, _STRIP_BYTES, _TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES = 273, 279, 322, 323, 324, 325
_ORIENTATION, _SHORT = 274, {3: "H"}
_COLOURS, _FILL_ORDER, _ROWS, _PLANES, _YCBCR = 262, 266, 278, 284, 6
_TYPES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}  # of whole numbers; others are not asked for
# Strips compressed by LZW, JPEG or Deflate end in a code for the end or a checksum, never in so many zeros.
_ENDED, _ZEROS = (5, 7, 8, 32946), 8
_LZW, _COUNTED = 5, (5, 8, 32946)  # those whose unpacked bytes are counted
_SGI_LOG = (34676, 34677)  # compressions that code floats as integers
_NEXT = -1  # no tag: where another directory is, after the entries of the first; 0: nowhere
_FORMATS = {1: "uint", 2: "int", 3: "float"}
_ASKED = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _FORMAT, _STRIPS, _STRIP_BYTES}
_ASKED |= {_TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES, _COLOURS, _FILL_ORDER, _ROWS, _PLANES, _NEXT}


def entries(
    file: Window, asked: Collection[int], types: Mapping[int, str] = _TYPES, at: int | None = None
) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """The requested (``asked``) entries of a directory, each once, of these ``types``: tag and numbers, or text.

    Args:
        file: A TIFF, or an EXIF block.
        asked: The requested tags.
        types: How `struct` reads a value of each type.
        at: Where the directory begins; None: the first.
    Raises:
        DamagedError: one of them lies beyond the end.
    """
    asked, order = set(asked), "<" if file.at(0, 2) == b"II" else ">"
    big = file.at(2, 2) in (b"+\0", b"\0+")
    (first,) = file.numbers(order + ("Q" if big else "I"), 8 if big else 4)
    position = first if at is None else at
    (count,) = file.numbers(order + ("Q" if big else "H"), position)
    position, size, field = (position + 8, 20, 8) if big else (position + 2, 12, 4)
    for entry in range(position, position + count * size, size):
        tag, kind, number = file.numbers(order + ("HHQ" if big else "HHI"), entry)
        if tag in asked and kind in types:
            asked.discard(tag)  # of equal ones the first
            within("image_parts", number)
            letters, start = types[kind], entry + size - field
            layout = order + (f"{number}{letters}" if len(letters) == 1 else letters * number)
            if struct.calcsize(layout) > field:
                (start,) = file.numbers(order + ("Q" if big else "I"), start)
            yield tag, file.numbers(layout, start)
    if _NEXT in asked:
        yield _NEXT, file.numbers(order + ("Q" if big else "I"), position + count * size)


_NEEDED = {b"VP8 ": 6, b"VP8L": 4}
# Without so many last bytes no honest WebP can be decoded: what libwebp writes has 3 (VP8L: 2) that are not needed.
_PNG_TEXTS = (b"zTXt", b"iTXt", b"tEXt", b"iCCP")  # no pixels, but seconds to unpack


@dataclass(frozen=True)
class Header:
    """Properties of an image file, found by the walk.

    Attributes:
        width, height: Largest size in pixels that the file gives for its picture.
        data: The bytes to decode: the file without parts that cost time and hold no pixels.
        exif: Its EXIF block (TIFF structure), or empty.
        shortened: If the file ends in zeros: bytes that can be decoded only if these zeros were not needed, that is,
            stand where a picture was; else empty.
        pictures: Whether it holds further pictures after the first: pages or frames.
        zeros: Rows of zeros at the end of the picture's data, where these are not compressed.
        picture: Decodes the picture and sets it upright, where OpenCV cannot.
    """

    width: int
    height: int
    data: bytes
    exif: bytes = b""
    shortened: bytes = b""
    pictures: bool = False
    zeros: int = 0
    picture: Callable[[], NDArray[np.uint8]] | None = None


def _zeros_at_end(data: bytes) -> int:
    """Bytes at the end of ``data`` that are 0."""
    return len(data) - len(data.rstrip(b"\0"))


def _walk_jpeg(data: bytes, file: Window) -> Header:
    """Walk over a JPEG, which must have a frame header, a scan and the end-of-image marker."""
    exif, position, scans, width, height = b"", 2, 0, 0, 0
    marker = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
    while True:
        match = marker.search(data, position)
        if match is None:
            raise DamagedError("it ends before its end-of-image marker")
        code, position = data[match.start() + 1], match.end()
        if code == 0xD9:
            if not scans:
                raise DamagedError("it holds no picture data")
            return Header(width, height, data, exif)
        if code == 0x01:
            continue
        (length,) = file.numbers(">H", position)
        if code == 0xE1 and not exif and data[position + 2 : position + 8] == b"Exif\0\0":
            exif = data[position + 8 : position + length]
        if 0xC0 <= code <= 0xCF and code not in (0xC4, 0xC8, 0xCC):
            high, wide = file.numbers(">HH", position + 3)
            width, height = max(width, wide), max(height, high)
        if code == 0xDA:
            scans += 1
            within("jpeg_scans", scans)
        position += length


def _png_chunk(file: Window, position: int, end: int) -> Part:
    """A chunk of a PNG, with its checksum."""
    length, kind = file.numbers(">I4s", position)
    return kind, position + 8, position + 12 + length


def _walk_png(data: bytes, file: Window) -> Header:
    """Walk over a PNG, which must have all chunks up to IEND, the critical ones intact."""
    exif, texts, pictures = b"", [(0, 0)], False
    width, height = file.numbers(">II", 16)
    for kind, start, end in file.walk(8, file.size, _png_chunk):
        if (kind == b"IHDR") != (start == 16):
            raise DamagedError("its IHDR chunk is not the first")
        critical = not kind[0] & 0x20
        if critical and zlib.crc32(data[start - 4 : end - 4]) != file.numbers(">I", end - 4)[0]:
            raise DamagedError(f"the checksum of its {kind.decode('latin-1')!r} chunk is wrong")
        if kind == b"eXIf":
            exif = data[start : end - 4]
        pictures |= kind == b"acTL" and file.numbers(">I", start)[0] > 1
        if kind in _PNG_TEXTS:
            texts.append((start - 8, end))
        if kind == b"IEND":
            starts = [*(start for start, _ in texts[1:]), len(data)]
            pieces = [data[last:start] for (_, last), start in zip(texts, starts, strict=True)]
            rest = b"".join(pieces) if len(pieces) > 1 else data
            return Header(width, height, rest, exif, pictures=pictures)
    raise DamagedError("it ends before its IEND chunk")


def _walk_webp(data: bytes, file: Window) -> Header:
    """Walk over a WebP, whose chunks must fill the length in its RIFF header."""
    exif, width, height, shortened, frames = b"", 0, 0, b"", 0
    for kind, start, end in file.walk(12, file.reach(8 + file.numbers("<I", 4)[0]), riff_chunk, align=2):
        frames += kind == b"ANMF"
        if kind == b"EXIF":
            exif = data[start:end].removeprefix(b"Exif\0\0")
        elif kind in (b"VP8 ", b"VP8L", b"VP8X"):
            wide, high = _webp_size(kind, file, start)
            width, height = max(width, wide), max(height, high)
            zeros = _NEEDED.get(kind, end - start + 1)
            if data[start:end].endswith(bytes(zeros)):
                rest = data[start : end - zeros]
                parted = kind + struct.pack("<I", len(rest)) + rest + bytes(len(rest) % 2)
                shortened = b"RIFF" + struct.pack("<I", 4 + len(parted)) + b"WEBP" + parted
    return Header(width, height, data, exif, shortened, frames > 1)


def _webp_size(kind: bytes, file: Window, start: int) -> tuple[int, int]:
    """Width and height that a part of a WebP gives. Source: RFC 9649 and RFC 6386, section 9.1."""
    if kind == b"VP8X":
        return 1 + int.from_bytes(file.at(start + 4, 3), "little"), 1 + int.from_bytes(file.at(start + 7, 3), "little")
    if kind == b"VP8L":
        (bits,) = file.numbers("<I", start + 1)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    width, height = file.numbers("<HH", start + 6)
    return width & 0x3FFF, height & 0x3FFF


def _walk_bmp(data: bytes, file: Window) -> Header:
    """Walk over a BMP: an uncompressed one must have exactly its rows, a run-length coded one its end code."""
    said, _, offset, header = file.numbers("<IIII", 2)
    compression = length = zeros = 0
    if header < 40:
        width, height, _, depth = file.numbers("<HHHH", 18)
    else:
        width, height, _, depth, compression, length = file.numbers("<iiHHII", 18)
    if compression in (0, 3):
        row = (abs(width) * depth + 31) // 32 * 4
        end = file.reach(offset + row * abs(height))
        zeros = _zeros_at_end(data[offset:end]) // max(1, row)
        if header == 40 and said == len(data) >= end + max(4, row):  # longer headers may have a profile there
            raise DamagedError(f"its rows end {len(data) - end:,} bytes before it does")
    if compression in (1, 2):
        file.reach(offset + length)
        runs = data[offset : offset + length if length else None].rstrip(b"\0")
        if not runs.endswith(b"\0\1"):
            raise DamagedError("it lacks the end of its runs")
    return Header(abs(width), abs(height), data, zeros=zeros)


def _walk_tiff(data: bytes, file: Window) -> Header:
    """Walk over a TIFF, whose strips must all be complete; its size is that of its first picture, or of a larger tile.

    Raises:
        DamagedError: part of the file is missing.
        InputError: its samples are not unsigned integers of up to 16 bits.
    """
    tags, zeros = dict(entries(file, _ASKED)), 0
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
            if _first(tags, _COMPRESSION, 1) == 1:
                found = _zeros_at_end(data[start : start + length])
                zeros = found + zeros * (found == length)
    _check_strips(data, tags)
    tile_width, tile_height = _first(tags, _TILE_WIDTH), _first(tags, _TILE_HEIGHT)
    if tile_width * tile_height > width * height:
        width, height = tile_width, tile_height
    zeros //= max(1, width * bits * samples // 8)
    return Header(width, height, data, pictures=bool(_first(tags, _NEXT)), zeros=zeros)  # its decoder turns the picture


def _check_strips(data: bytes, tags: dict[int, tuple[int, ...]]) -> None:
    """Check that each strip packed by LZW or Deflate unpacks to its rows: a decoder would fill missing ones
    silently."""
    packing, bits = _first(tags, _COMPRESSION, 1), set(tags.get(_BITS) or (1,))
    strips = [data[at : at + size] for at, size in zip(tags.get(_STRIPS, ()), tags.get(_STRIP_BYTES, ()), strict=False)]
    if packing not in _COUNTED or _TILES in tags or _first(tags, _COLOURS) == _YCBCR or len(bits) > 1:
        return
    if packing == _LZW and (_first(tags, _FILL_ORDER, 1) != 1 or any(strip[:2] == b"\0\1" for strip in strips)):
        return  # bits in another order
    from lava_vpr.images.lzw import deflate_bytes, lzw_bytes

    height, samples = _first(tags, _HEIGHT), _first(tags, _SAMPLES, 1)
    apart = _first(tags, _PLANES, 1) == 2
    row = (_first(tags, _WIDTH) * bits.pop() * (1 if apart else samples) + 7) // 8
    many = min(_first(tags, _ROWS, height), height)
    firsts = [*range(0, height, max(1, many))] * (samples if apart else 1)
    for first, strip in zip(firsts, strips, strict=False):
        found = (lzw_bytes if packing == _LZW else deflate_bytes)(strip)
        if not min(many, height - first) * row <= found <= many * row:
            raise DamagedError(f"a strip of {many} rows of {row:,} bytes unpacks to {found:,}")
    if len(firsts) != len(strips):
        raise DamagedError(f"it has {len(strips):,} strips of its {len(firsts):,}")


def _first(tags: dict[int, tuple[int, ...]], tag: int, otherwise: int = 0) -> int:
    """The first number of a tag."""
    return (tags.get(tag) or (otherwise,))[0]


def _walk_heif(data: bytes, file: Window) -> Header:
    """Walk over a HEIC or HEIF file, which must have all parts of its items."""
    package = decoder()
    if package is None:
        raise InputError(_unread())
    width, height, exif = walk_heif(file)
    return Header(width, height, data, exif, picture=lambda: decoded(package, data))


def _unread() -> str:
    """What a message says of a file in a format of phones that no decoder here reads."""
    return f"is a HEIC, HEIF or AVIF image, which cannot be read, whatever its name says; {advice()}"


_AVIF = re.compile(rb".{4}ftyp(avif|avis)", re.DOTALL)
"""The beginnings of AVIF files, and below those of HEIC and HEIF files. Source: ISO/IEC 23008-12 and the AV1 Image File
Format, their brands."""
_WALKERS: tuple[tuple[re.Pattern[bytes], Callable[[bytes, Window], Header]], ...] = (
    (re.compile(rb"\xff\xd8\xff"), _walk_jpeg),
    (re.compile(rb"\x89PNG\r\n\x1a\n"), _walk_png),
    (re.compile(rb"RIFF.{4}WEBP", re.DOTALL), _walk_webp),
    (re.compile(rb"BM"), _walk_bmp),
    (re.compile(rb"II[*+]\0|MM\0[*+]"), _walk_tiff),
    (re.compile(rb".{4}ftyp(heic|heix|heim|heis|hevc|hevx|mif1|msf1)", re.DOTALL), _walk_heif),
)
"""The walk for each kind of file, by the bytes at its beginning."""


def walk(data: bytes) -> Header:
    """Properties of the picture in an image file, which is complete by the structure of its format.

    Raises:
        DamagedError: part of the file is missing or damaged.
        InputError: the format is unknown, or the file exceeds a limit.
    """
    walker = next((walker for begins, walker in _WALKERS if begins.match(data)), None)
    if walker is None and _AVIF.match(data):
        raise InputError(_unread())
    if walker is None:
        raise InputError("is not a JPEG, PNG, BMP, TIFF or WebP image, whatever its name says; replace or remove it")
    found = walker(data, Window(data, "image_parts"))
    within("image_pixels", found.width * found.height, f"has {found.width} x {found.height} =")
    return found


def orientation_of(exif: bytes) -> int:
    """The EXIF orientation 1..8; 1 (upright) where there is none or it makes no sense."""
    if exif[:4] in (b"II*\0", b"MM\0*"):
        with contextlib.suppress(DamagedError, InputError):
            for _, numbers in entries(Window(exif, "image_parts"), (_ORIENTATION,), _SHORT):
                return numbers[0] if len(numbers) == 1 and 1 <= numbers[0] <= 8 else 1
    return 1
