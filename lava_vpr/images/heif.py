"""HEIC and HEIF photos: a walk over the boxes of a file, and decoding by the optional package pillow-heif or pi-heif.

The walk checks a file before libheif, which both wrap, sees it: all boxes and items must be whole, and no picture
may have a format that no phone writes. libheif turns the picture as the file says; its EXIF orientation only repeats
that.

Sources: ISO/IEC 14496-12 (boxes and items), ISO/IEC 23008-12 (HEIF), ITU-T H.265.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, said
from lava_vpr.images.mp4 import box
from lava_vpr.images.windows import DamagedError, Part, Window

HEIF_SUFFIXES = (".heic", ".heif", ".hif")
INSTALL = "pip install 'lava-vpr[heic]'"
_ENTERED = (b"meta", b"iinf", b"iprp", b"ipco")
_PICTURE, _EXIF = b"hvc1", b"Exif"
_FOREIGN = (b"av01", b"avc1", b"evc1", b"j2k1", b"mski", b"unci", b"vvc1")
"""Kinds of pictures that libheif may decode, too, and no phone writes."""
_ZEROS = bytes(8)  # H.265 never has more than two bytes 0 in a row, lengths and padding never so many
PACKAGES = ("pillow_heif", "pi_heif")
"""The modules that decode, with the same functions; the first is the one that is maintained."""


def decoder() -> Any | None:
    """The first of `PACKAGES` that can be imported, or None."""
    for name in PACKAGES:
        with suppress(ImportError):
            package = import_module(name)
            package.libheif_version()  # imports what is compiled
            return package
    return None


def decoded(package: Any, data: bytes) -> NDArray[np.uint8]:
    """The main picture of a file, upright, by the ``package``: (h, w, 3) BGR, or (h, w); 8 bits.

    Raises:
        DamagedError: it cannot be decoded.
    """
    try:
        image = np.array(package.open_heif(data, bgr_mode=True))
    except Exception as error:  # of any type for a damaged file
        raise DamagedError(f"its picture data cannot be decoded: {said(error)}") from None
    if image.ndim == 3:
        image = image[..., :3] if image.shape[2] > 2 else image[..., 0]
    return np.ascontiguousarray(image)


def walk_heif(file: Window) -> tuple[int, int, bytes]:
    """Walk over a HEIC or HEIF file: the largest width and height that it gives, and its EXIF block, or empty.

    Raises:
        DamagedError: part of the file is missing.
        InputError: it holds a picture of another kind, or too many parts.
    """
    width, height, block = 0, 0, b""
    kinds: dict[int, bytes] = {}
    parts: list[tuple[int, int, int]] = []
    for kind, start, _ in file.walk(0, file.size, _box, _ENTERED):
        if kind == b"ispe":
            wide, high = file.numbers(">II", start + 4)
            width, height = max(width, wide), max(height, high)
        elif kind == b"infe":
            number, _, item = file.numbers(">IH4s" if file.at(start, 1)[0] > 2 else ">HH4s", start + 4)
            if item in _FOREIGN:
                raise InputError(
                    f"holds a picture of kind {item.decode()!r}, but only HEVC is read; convert it to JPEG"
                )
            kinds[number] = item
        elif kind == b"iloc":
            parts += _parts(file, start)
    if not width * height:
        raise DamagedError("it holds no picture")
    for number, start, end in parts:
        if kinds.get(number) == _PICTURE and _ZEROS in file.at(start, end - start):
            raise DamagedError("zeros stand where a picture was")
        if kinds.get(number) == _EXIF and not block:
            skipped = 4 + file.numbers(">I", start)[0]
            block = file.at(start, end - start)[skipped:].removeprefix(b"Exif\0\0")
    return width, height, block


def _box(file: Window, position: int, end: int) -> Part:
    """The box at ``position``; other boxes within it follow its version and, if it is a list, their number."""
    kind, start, stop = box(file, position, end)
    if kind == b"meta":
        start += 4
    elif kind == b"iinf":
        start += 8 if file.at(start, 1)[0] else 6
    return kind, start, stop


def _parts(file: Window, position: int) -> Iterator[tuple[int, int, int]]:
    """The number of an item, and where the content of each of its parts begins and ends, from the box 'iloc'."""

    def number(size: int) -> int:
        """The next ``size`` bytes as a number."""
        nonlocal position
        position += size
        return int.from_bytes(file.at(position - size, size), "big")

    version, _, sizes = number(1), number(3), number(2)
    offset, length, base, index = (sizes >> bits & 15 for bits in (12, 8, 4, 0))
    long = 4 if version == 2 else 2
    for _ in range(number(long)):
        item, method, _, first, many = number(long), number(2 if version else 0), number(2), number(base), number(2)
        for _ in range(many):
            _, begin = number(index if version else 0), first + number(offset)
            end = begin + number(length)
            if not method & 15:  # others: within a box of the file's head, or made of other items
                yield item, begin, file.reach(end)
