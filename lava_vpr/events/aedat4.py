"""Events in AEDAT4 files, as DV (iniVation) records them.

A file is a header, which is a flatbuffer with a description in XML, and packets: the number of a stream, the packet's
length, and a flatbuffer, packed by LZ4 or Zstandard where the header says so. Offsets in flatbuffers are those of
whoever wrote the file: each must lie before the packet's end, and a packet is unpacked up to a limit, whatever it
claims.

Package aedat (2.3) detects as much, with the checks of `lava_vpr.events.stream`: all of 432 cuts, and 264 of 300 wrong
bytes where this module detects 266. It has no limit on what a packet unpacks to, and panics; it would need a child
process.
Source: https://docs.inivation.com (AEDAT 4.0), https://flatbuffers.dev/internals.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

import numpy as np

from lava_vpr.errors import InputError, said, shown
from lava_vpr.events.stream import BLOCK, EventRecording, Raw, check_size
from lava_vpr.storage.limits import limit, within
from lava_vpr.storage.reading import open_regular

AEDAT4_SUFFIXES = (".aedat4",)
MAGIC = b"#!AER-DAT4.0\r\n"
EVENT = np.dtype({"names": ["t", "x", "y", "on"], "formats": ["<i8", "<i2", "<i2", "u1"], "itemsize": 16})
"""An event in a packet; its fields follow each other."""
_NONE, _LZ4, _LZ4_HIGH, _ZSTD, _ZSTD_HIGH = range(5)
_MOST_HEADER = 1 << 20
_PIECE = 1 << 16
_STREAMS = "./node[@name='outInfo']/node"
"""Where a description names its streams."""


class _BrokenError(ValueError):
    """A file that is no AEDAT4; the text says what is wrong, without the file's name."""


def open_aedat4(path: Path) -> EventRecording:
    """The events of the only stream of events in an AEDAT4 file.

    Raises:
        InputError: it is damaged, of another version, or has no or several streams of events.
    """
    with _opened(path) as reader:
        return EventRecording(path, lambda: _blocks(path), check_size(reader.size, shown(path)))


def _blocks(path: Path) -> Iterator[Raw]:
    """The events, some at a time."""
    with _opened(path) as reader:
        for events in reader.packets():
            for first in range(0, len(events), BLOCK):
                part = events[first : first + BLOCK]
                yield Raw(part["t"], part["x"], part["y"])


@contextmanager
def _opened(path: Path) -> Iterator[_Reader]:
    """The opened file; an error in it is reported in one line."""
    try:
        with open_regular(path) as file:
            yield _Reader(path, file)
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check it") from None
    except ImportError as error:
        raise InputError(
            f"{shown(path)}: is packed, and the package that unpacks it is missing ({error.name}); install it: pip "
            "install 'lava-vpr[events]'"
        ) from None
    except (_BrokenError, ElementTree.ParseError, EOFError, RuntimeError, MemoryError) as error:
        raise InputError(
            f"{shown(path)}: is damaged, cut short or no AEDAT4 file ({said(error)}); copy or export it again"
        ) from None


class _Reader:
    """An open file: how packets are packed, where they end, which stream has events, of which sensor."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path, self._file = path, file
        if self._read(len(MAGIC)) != MAGIC:
            raise _BrokenError("it does not begin as AEDAT 4.0 does")
        (length,) = struct.unpack("<I", self._read(4))
        if length > _MOST_HEADER:
            raise _BrokenError(f"a header of {length:,} bytes")
        header = self._read(length)
        compression = _field(header, 0, 0, "<i")
        end, at = _field(header, 0, 1, "<q"), _field(header, 0, 2, "<I", offset=True)
        self._packing = 0 if compression is None else compression
        self._end = -1 if end is None else end
        if at is None:
            raise _BrokenError("a header without a description")
        (text,) = struct.unpack("<I", _slice(header, at, 4))
        description = _slice(header, at + 4, text)
        self._stream, self.size = _described(description, shown(self._path))
        self._streams = {one.get("name") for one in ElementTree.fromstring(description).findall(_STREAMS)}

    def packets(self) -> Iterator[Any]:
        """The events of each packet of the stream, of the type `EVENT`."""
        while self._end < 0 or self._file.tell() < self._end:
            head = self._file.read(8)
            if not head and self._end < 0:
                return
            if len(head) < 8:
                raise _BrokenError("it ends within a packet")
            stream, length = struct.unpack("<iI", head)
            within("event_packet_bytes", length, f"{shown(self._path)}: has a packet of")
            if str(stream) not in self._streams:
                raise _BrokenError(f"a packet of stream {stream}, which its description does not name")
            if stream != self._stream:
                self._file.seek(length, 1)
                continue
            yield _elements(self._unpacked(self._read(length)))

    def _read(self, length: int) -> bytes:
        data = self._file.read(length)
        if len(data) < length:
            raise _BrokenError(f"it ends {length - len(data):,} bytes early")
        return data

    def _unpacked(self, data: bytes) -> bytes:
        """A packet as it was before it was packed, at most as long as the limit ``event_packet_bytes`` allows."""
        if self._packing == _NONE:
            return data
        if self._packing in (_LZ4, _LZ4_HIGH):
            import lz4.frame

            unpacker: Any = lz4.frame.LZ4FrameDecompressor()
        elif self._packing in (_ZSTD, _ZSTD_HIGH):
            unpacker = _zstd()
        else:
            raise _BrokenError(f"packing {self._packing} is not known")
        most, pieces, length, given = limit("event_packet_bytes"), [], 0, data
        while True:
            try:
                piece = unpacker.decompress(given, max_length=most + 1 - length)
            except Exception as error:  # LZ4 raises RuntimeError, Zstandard a kind of its own
                raise _BrokenError(f"a packet cannot be unpacked: {error}") from None
            pieces.append(piece)
            length += len(piece)
            within("event_packet_bytes", length, f"{shown(self._path)}: has a packet of")
            if unpacker.eof:
                return b"".join(pieces)
            given = b""
            if not piece:
                raise _BrokenError("a packet ends early")


def _zstd() -> Any:
    """A decompressor of Zstandard."""
    try:
        from compression import zstd
    except ImportError:
        from backports import zstd

    return zstd.ZstdDecompressor()


def _slice(data: bytes, at: int, length: int) -> bytes:
    """``length`` bytes from ``at`` on."""
    if at < 0 or length < 0 or at + length > len(data):
        raise _BrokenError(f"an offset beyond a packet of {len(data):,} bytes")
    return data[at : at + length]


def _field(data: bytes, root: int, number: int, layout: str, *, offset: bool = False) -> int | None:
    """A field of the table whose position stands at ``root``; None: the table has none.

    Args:
        data: The flatbuffer.
        root: Where the position of the table stands.
        number: Which of its fields, from 0.
        layout: Of the field, for `struct`.
        offset: The field says where something stands: that position in ``data``.
    """
    table = root + struct.unpack("<I", _slice(data, root, 4))[0]
    names = table - struct.unpack("<i", _slice(data, table, 4))[0]
    (length,) = struct.unpack("<H", _slice(data, names, 2))
    if 4 + 2 * number + 2 > length:
        return None
    (place,) = struct.unpack("<H", _slice(data, names + 4 + 2 * number, 2))
    if place == 0:
        return None
    (value,) = struct.unpack(layout, _slice(data, table + place, struct.calcsize(layout)))
    return int(table + place + value if offset else value)


_HEADS = 128
"""Bytes of a packet beside its events, at most: three numbers, two tables of one field and what aligns them."""


def _elements(packet: bytes) -> Any:
    """The events in an unpacked packet: its length, then the flatbuffer, whose first field is the list of them."""
    if _slice(packet, 8, 4) != b"EVTS":
        raise _BrokenError("a packet of the stream of events that holds none")
    at = _field(packet, 4, 0, "<I", offset=True)
    count = 0 if at is None else struct.unpack("<I", _slice(packet, at, 4))[0]
    if len(packet) - count * EVENT.itemsize > _HEADS:
        raise _BrokenError(f"a packet of {len(packet):,} bytes that tells {count:,} events")
    return np.frombuffer(b"" if at is None else _slice(packet, at + 4, count * EVENT.itemsize), EVENT)


def _described(text: bytes, where: str) -> tuple[int, tuple[int, int]]:
    """The number of the stream of events, and width and height of its sensor, from the description in XML."""
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:  # all that an XML reader can be lured by
        raise _BrokenError("its description declares a document type")
    streams = ElementTree.fromstring(text).findall(_STREAMS)
    found = [one for one in streams if one.findtext("./attr[@key='typeIdentifier']") == "EVTS"]
    if len(found) != 1:
        what = "no stream" if not found else f"{len(found)} streams"
        raise InputError(f"{where}: has {what} of events; export a file with one")
    info = "./node[@name='info']/attr[@key='{}']"
    words = [found[0].get("name", ""), *(found[0].findtext(info.format(key)) or "" for key in ("sizeX", "sizeY"))]
    if not all(word.isascii() and word.isdigit() and len(word) <= 9 for word in words):
        raise _BrokenError("its description lacks the number or the size of a stream")
    number, width, height = map(int, words)
    return number, (width, height)
