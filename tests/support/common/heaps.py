"""HDF5 files whose texts of variable length are damaged, so that the HDF5 library never returns from reading them.

Used by cli, events and storage.
"""

from __future__ import annotations

import struct
from pathlib import Path

HEAD = 16
"""Bytes of the head of a collection of texts, and of each text in it."""


def damage(path: Path, text: int, length: int) -> Path:
    """Let text ``text`` of the first collection in a file tell another ``length``; texts have at most 8 bytes."""
    data = bytearray(path.read_bytes())
    at = data.index(b"GCOL") + HEAD + text * (HEAD + 8)
    struct.pack_into("<Q", data, at + 8, length)
    path.write_bytes(data)
    return path
