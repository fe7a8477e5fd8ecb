"""Reads zip archives of arrays, our own and those of other programs, within one budget of memory.

Names, lengths and methods are read from the archive's directory, and what it unpacks to is held against a limit before
an entry is opened. An entry takes the memory of its numbers once, and never more than the directory says.
"""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib

import numpy as np

from lava_vpr.errors import brief
from lava_vpr.storage.limits import unpacking

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""How `numpy.savez` and `numpy.savez_compressed` pack the arrays of an archive."""
ARCHIVE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)
"""What zipfile and NumPy raise of a damaged archive of arrays, beside `OSError`."""
_MOST_ENTRIES = 1000
_PIECE = 1 << 18


class ArchiveLimitError(Exception):
    """An archive costs more than a limit allows; the message says what, and how the limit is raised."""


def entries_of(archive: zipfile.ZipFile, most: int = _MOST_ENTRIES) -> list[zipfile.ZipInfo]:
    """The entries of an archive, each packed as `numpy.savez` does.

    Raises:
        ValueError: one is not, or there are more than ``most``.
    """
    entries = archive.infolist()
    if len(entries) > most:
        raise ValueError(f"it has {len(entries):,} entries, more than {most:,}")
    for entry in entries:
        if entry.flag_bits & 0x1 or entry.compress_type not in _METHODS:
            raise ValueError(f"entry {brief(entry.filename)} is encrypted, or packed otherwise than numpy.savez does")
    return entries


def check_budget(entries: list[zipfile.ZipInfo], packed: int, limit_name: str) -> None:
    """Refuse entries that unpack to more than is allowed.

    Args:
        entries: The directory.
        packed: Bytes of the whole file.
        limit_name: The limit on the bytes that they unpack to.
    Raises:
        BeyondError: they do.
    """
    beyond = unpacking(limit_name, sum(entry.file_size for entry in entries), packed)
    if beyond is not None:
        raise ArchiveLimitError(f"unpacks to {beyond}")


def unpacked(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> memoryview:
    """What an entry unpacks to, writeable, in the memory that it takes: `ZipExtFile.read` takes twice as much.

    Raises:
        ValueError, zipfile.BadZipFile, zlib.error: it is damaged, or shorter than the directory says.
    """
    content, length = np.empty(entry.file_size, np.uint8).data, 0
    with archive.open(entry) as member:
        while piece := member.read(_PIECE):
            content[length : length + len(piece)] = piece
            length += len(piece)
    if length != entry.file_size:
        raise ValueError("ends early")
    return content
