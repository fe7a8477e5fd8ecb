"""Zip archives written by hand, so that they can lie: names twice, wrong sizes, bombs, bytes turned.

Used by storage and support.
"""

from __future__ import annotations

import bz2
import functools
import io
import lzma
import random
import struct
import zipfile
import zlib
from dataclasses import dataclass, replace

import numpy as np
from support.fuzz.files import arrays

Entries = list[tuple[str, bytes]]
"""Names in a zip archive and what they hold, in order."""

STORED, DEFLATED, BZIP2, LZMA = 0, 8, 12, 14
BLOCK = 1 << 22
BOMB = 3 << 30
"""Bytes that a bomb unpacks to: more than a worker may take."""


@dataclass(frozen=True)
class Packed:
    """An entry as it stands in the archive; ``size`` and ``crc`` are what the directory says of it."""

    name: bytes
    method: int
    crc: int
    size: int
    data: bytes
    flags: int = 0


def packed(name: str, data: bytes, method: int = DEFLATED) -> Packed:
    """An honest entry."""
    if method == DEFLATED:
        deflater = zlib.compressobj(1, zlib.DEFLATED, -15)
        stored = deflater.compress(data) + deflater.flush()
    elif method == BZIP2:
        stored = bz2.compress(data)
    elif method == LZMA:
        filters = [{"id": lzma.FILTER_LZMA1}]
        props = lzma._encode_filter_properties(filters[0])  # type: ignore[attr-defined]
        coder = lzma.LZMACompressor(lzma.FORMAT_RAW, filters=filters)
        stored = struct.pack("<BBH", 9, 4, len(props)) + props + coder.compress(data) + coder.flush()
    else:
        stored = data
    return Packed(name.encode("utf-8", "surrogatepass"), method, zlib.crc32(data), len(data), stored)


def archive(entries: list[Packed]) -> bytes:
    """The archive of ``entries``."""
    out, directory = bytearray(), bytearray()
    for entry in entries:
        at = len(out)
        common = (entry.flags, entry.method, 0, 33, entry.crc, len(entry.data), entry.size, len(entry.name), 0)
        out += struct.pack("<4sHHHHHIIIHH", b"PK\x03\x04", 45, *common) + entry.name + entry.data
        directory += struct.pack("<4sHHHHHHIIIHHHHHII", b"PK\x01\x02", 45, 45, *common, 0, 0, 0, 0, at) + entry.name
    end = struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, len(entries), len(entries), len(directory), len(out), 0)
    return bytes(out + directory + end)


def zipped(entries: Entries) -> bytes:
    """The honest archive of ``entries``."""
    return archive([packed(name, data) for name, data in entries])


def unzipped(data: bytes) -> Entries:
    """The entries of an honest archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as opened:
        return [(info.filename, opened.read(info)) for info in opened.infolist()]


@functools.cache
def _zeros(first: bool) -> bytes:
    """A block of zeros, compressed; blocks can follow each other."""
    deflater = zlib.compressobj(9, zlib.DEFLATED, -15)
    return deflater.compress(bytes(BLOCK)) + deflater.flush(zlib.Z_FULL_FLUSH if first else zlib.Z_FINISH)


def _zeros_behind(head: bytes, zeros: int) -> bytes:
    """``head`` and so many zeros, compressed without ever being in memory."""
    deflater = zlib.compressobj(9, zlib.DEFLATED, -15)
    start = deflater.compress(head) + deflater.flush(zlib.Z_FULL_FLUSH)
    return start + _zeros(True) * (zeros // BLOCK - 1) + _zeros(False)


def bomb(rng: random.Random, entries: Entries) -> tuple[bytes, str]:
    """A small archive that unpacks, or claims to unpack, to much more."""
    at = rng.randrange(len(entries))
    name, data = entries[at]
    kind = rng.randrange(5)
    made = [packed(*entry) for entry in entries]
    if kind == 0:
        array = arrays.read(data)
        row = max(1, array.itemsize * int(np.prod(array.shape[1:], initial=1)))
        head = arrays.lying(array.dtype.str, False, (BOMB // row, *array.shape[1:]), b"")
        stream, size = _zeros_behind(head, BOMB), BOMB + len(head)
        told = "3 GiB of zeros, as its header says"
    elif kind == 1:
        stream, size = _zeros_behind(data, BOMB), BOMB + len(data)
        told = "3 GiB of zeros behind its end"
    elif kind == 2:
        stream, size = _zeros_behind(data, BOMB), len(data)
        told = "3 GiB of zeros that the directory does not tell"
    elif kind == 3:
        stream, size = made[at].data, 0xFFFFFFF0
        told = "said to unpack to 4 GiB"
    else:
        count = 3000
        many = [packed(f"a.{k}.npy", b"") for k in range(count)]
        return archive(made + many), f"{count} entries more"
    made[at] = replace(made[at], data=stream, size=size)
    return archive(made), f"{name}: {told}"


def changed(rng: random.Random, entries: Entries) -> tuple[bytes, str]:
    """The archive of ``entries`` with a change of its own bytes, and what that is."""
    kind = rng.randrange(9)
    if kind == 0:
        method = rng.choice([STORED, BZIP2, LZMA, 99])
        told = "an unknown method" if method == 99 else f"method {method}"
        if method == 99:
            return archive([replace(packed(*entry), method=99) for entry in entries]), told
        return archive([packed(name, data, method) for name, data in entries]), told
    whole = zipped(entries)
    if kind == 1:
        return whole[: rng.randrange(len(whole))], "the archive cut off"
    if kind == 2:
        return b"junk" * rng.randrange(1, 500) + whole, "bytes before the archive"
    if kind == 3:
        return whole + b"junk" * rng.randrange(1, 500), "bytes behind the archive"
    if kind == 4:
        return whole + whole, "the archive twice"
    raw = bytearray(whole)
    directory = raw.index(b"PK\x01\x02\x2d\0\x2d\0")
    if kind == 5:
        for _ in range(rng.choice([1, 1, 3])):
            raw[rng.randrange(directory, len(raw))] ^= 1 << rng.randrange(8)
        return bytes(raw), "bits of the directory turned"
    if kind == 6:
        raw[rng.randrange(directory)] ^= 1 << rng.randrange(8)
        return bytes(raw), "a bit of the entries turned"
    made = [packed(*entry) for entry in entries]
    at = rng.randrange(len(made))
    if kind == 7:
        made[at] = replace(made[at], flags=rng.choice([1, 0x41, 0x2001, 0x20]))
        return archive(made), f"{entries[at][0]}: said to be encrypted"
    made[at] = replace(made[at], size=made[at].size + rng.choice([-1, 1, 1000]), crc=made[at].crc ^ rng.choice([0, 1]))
    return archive(made), f"{entries[at][0]}: of a wrong size"
