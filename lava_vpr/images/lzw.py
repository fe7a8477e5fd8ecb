"""Unpacked size of the strips of a TIFF: decoders silently fill what a damaged width or height asks for beyond it.

Source of LZW as TIFF has it: TIFF 6.0 (Adobe), section 13.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

_CLEAR, _END, _FIRST, _CODES = 256, 257, 258, 4096
_PIECE = 1 << 20


@compiled(nogil=True)
def _lzw(data: NDArray[np.uint8]) -> int:
    """Bytes that LZW codes unpack to, up to the end or to an impossible code."""
    lengths = np.ones(_CODES, np.int64)
    width, free, held, bits, before, total = 9, _FIRST, 0, 0, 0, 0
    for byte in data:
        held, bits = (held << 8 | byte) & 0xFFFFF, bits + 8
        if bits < width:
            continue
        bits -= width
        code = held >> bits & (1 << width) - 1
        if code == _CLEAR:
            width, free, before = 9, _FIRST, 0
            continue
        if code == _END or code > free or (code >= _FIRST and before == 0):
            return total
        length = before + 1 if code == free else lengths[code]
        if before and free < _CODES:
            lengths[free] = before + 1
            free += 1
        total, before = total + length, length
        if free >= (1 << width) - 1 and width < 12:
            width += 1
    return total


def lzw_bytes(strip: bytes) -> int:
    """Bytes that a strip packed by LZW unpacks to."""
    return int(_lzw(np.frombuffer(strip, np.uint8)))


def deflate_bytes(strip: bytes) -> int:
    """Bytes that a strip packed by Deflate unpacks to, as far as it is intact."""
    unpack: Any = zlib.decompressobj()
    total, rest = 0, strip
    try:
        while piece := unpack.decompress(rest, _PIECE):
            total, rest = total + len(piece), unpack.unconsumed_tail
    except zlib.error:
        pass  # as its decoder says
    return total
