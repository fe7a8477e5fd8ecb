"""One-file container of named arrays and a JSON header: models and checkpoints.

Layout: a magic line, the SHA-256 of the rest in hexadecimal, a newline, then a compressed ``.npz`` (no pickle) whose
entry ``header`` is UTF-8 JSON. Equal content gives equal bytes. Files are written under a temporary name, flushed to
the disk and renamed, so that a crash or a full disk leaves what was there before.

A right checksum says that a file is whole, not that it is honest. What it unpacks to is added up from the archive's
directory, and held against the limit ``model_bytes``, before an entry is opened; each entry must then be what its own
header says, to the byte.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ModelFileError
from lava_vpr.storage.limits import excess, unpacking
from lava_vpr.storage.npy import METHODS, array_of
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import write_atomically

_LEVEL = 3
"""zlib's level: files of models are as small as at its usual 6, and written twice as fast."""


def pack(kind: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A container of ``kind`` (``model``, ``checkpoint`` or ``references``).

    Raises:
        ModelFileError: it unpacks to more than the limits allow, so that `unpack` would refuse it.
    """
    buffer = io.BytesIO()
    text = json.dumps(header, sort_keys=True, allow_nan=False).encode()
    parts = {"header": np.frombuffer(text, np.uint8), **{f"a.{name}": array for name, array in arrays.items()}}
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in parts.items():
            file = io.BytesIO()
            np.lib.format.write_array(file, array, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), file.getbuffer(), zipfile.ZIP_DEFLATED, _LEVEL)
    payload = buffer.getvalue()
    data = _magic(kind) + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload
    try:
        _check_entries(archive.infolist(), len(data))
    except _Beyond as error:
        raise ModelFileError(f"the {kind} {error}") from None
    return data


def save(path: Path, kind: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the container that `pack` makes to ``path``.

    Raises:
        ModelFileError: it cannot be written, or `load` would refuse it; what stood at ``path`` still does.
    """
    try:
        data = pack(kind, header, arrays)
    except ModelFileError as error:
        raise ModelFileError(f"{shown(path)}: {error}") from None
    beyond = excess("model_file_bytes", len(data))
    if beyond is not None:
        raise ModelFileError(f"{shown(path)}: the {kind} has {beyond}")
    try:
        write_atomically(path, lambda file: file.write(data))
    except OSError as error:
        raise ModelFileError(
            f"{shown(path)}: the {kind} cannot be written ({error.strerror}); free space or choose another place"
        ) from None


def load(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of the container at ``path``.

    Raises:
        ModelFileError: missing, no file, larger than the limits allow, not a lava-vpr file, of another kind or version,
            truncated, altered, or not what `pack` makes.
    """
    try:
        data = read_bytes(path, "model_file_bytes")
    except OSError as error:
        raise ModelFileError(f"{shown(path)}: the {kind} cannot be read ({error.strerror}); check the path") from None
    return unpack(data, path, kind)


def unpack(data: bytes, path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of what `pack` made; ``path`` is for messages.

    The arrays are of plain numbers and writeable; what they mean is for who reads this ``kind`` to check.

    Raises:
        ModelFileError: as `load`.
    """
    magic = _magic(kind)
    if not data.startswith(magic):
        raise ModelFileError(_foreign(path, kind, data))
    end = len(magic) + 2 * hashlib.sha256().digest_size
    digest = hashlib.sha256(memoryview(data)[end + 1 :]).hexdigest().encode() + b"\n"
    if data[len(magic) : end + 1] != digest:
        raise ModelFileError(f"{shown(path)}: the {kind} is damaged (checksum differs); {REMEDIES[kind]}")
    try:
        return _unpacked(data, end + 1)
    except _Beyond as error:
        raise ModelFileError(f"{shown(path)}: the {kind} {error}") from None
    except MemoryError:
        raise ModelFileError(
            f"{shown(path)}: the {kind} unpacks to more than this machine has memory for; use a machine with more, or "
            "free some"
        ) from None
    except _UNFIT as error:
        raise ModelFileError(
            f"{shown(path)}: the {kind} does not hold what it should ({_cause(error)}); {REMEDIES[kind]}"
        ) from None


REMEDIES = {
    "model": "train it again or fetch an intact copy",
    "references": "deploy the model again",
    "checkpoint": "delete it and train from the start, without --resume",
}
"""What to do about a file of each kind that cannot be used."""

_UNFIT = (
    ValueError,
    KeyError,
    OverflowError,
    OSError,
    EOFError,
    RuntimeError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
"""What reading an archive and its entries raises when they are not what they should be."""

_MOST_ENTRIES = 65_535
"""Entries that an archive without ZIP64's own directory can have; a checkpoint has two for each stretch."""

_LOCAL_HEADER, _DIRECTORY_ENTRY, _DIRECTORY_END, _DIRECTORY_END_64 = 30, 46, 22, 76
"""Bytes of an archive's parts without names and extra fields (APPNOTE.TXT 4.3.7, 4.3.12, 4.3.16; 4.3.14 and 4.3.15)."""
_LOCAL_LENGTHS = struct.Struct("<HH")
"""The end of a local header: bytes of the name and of the extra field."""
_DIRECTORY_COUNTS = struct.Struct("<HHHH")
"""In its end: number of this disk, of that with the directory, and how many entries are on this one and on all."""
_ENTRY = re.compile(r"(header|a\.[a-z0-9_.]{1,60})\.npy")
_PIECE = 1 << 20


class _Beyond(Exception):
    """A container costs more than a limit allows; the message says what, and how the limit is raised."""


def _unpacked(data: bytes, start: int) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of the archive in ``data``, from ``start`` on; errors are `_Beyond` and those in `_UNFIT`."""
    if data.count(b"PK\x01\x02") > _MOST_ENTRIES:  # before the directory is read, whose entries cost memory
        raise ValueError(f"it has more than {_MOST_ENTRIES:,} entries")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = sorted(archive.infolist(), key=lambda entry: entry.header_offset)
        _check_entries(entries, len(data))
        packed = _packed(entries, archive.start_dir, data, start)
    arrays = {entry.filename[: -len(".npy")]: _array(packed[entry.filename], entry) for entry in entries}
    text = arrays.pop("header", None)
    if text is None:
        raise ValueError("it has no header")
    if text.dtype != np.uint8 or text.ndim != 1:
        raise ValueError(f"a header of {text.dtype} and shape {text.shape}, not of bytes")
    header = parse_json(text.tobytes())
    if not isinstance(header, dict):
        raise ValueError("its header is no JSON object")
    return header, {name[len("a.") :]: array for name, array in arrays.items()}


def _check_entries(entries: list[zipfile.ZipInfo], packed: int) -> None:
    """Refuse a directory that `pack` does not write, or whose entries unpack to more than the limits allow.

    Args:
        entries: The directory.
        packed: Bytes of the whole file.
    """
    seen = set()
    for entry in entries:
        name = entry.orig_filename
        if not _ENTRY.fullmatch(name) or name in seen:
            raise ValueError(f"{'a second' if name in seen else 'an unknown'} entry {name[:60]!r}")
        if entry.flag_bits & 0x1 or entry.compress_type not in METHODS:
            raise ValueError(f"entry {name} is encrypted or compressed in an unknown way")
        seen.add(name)
        beyond = excess("header_bytes", entry.file_size) if name == "header.npy" else None
        if beyond is not None:
            raise _Beyond(f"has a header of {beyond}")
    beyond = unpacking("model_bytes", sum(entry.file_size for entry in entries), packed)
    if beyond is not None:
        raise _Beyond(f"unpacks to {beyond}")


def _packed(entries: list[zipfile.ZipInfo], directory: int, data: bytes, start: int) -> dict[str, memoryview]:
    """The packed bytes of each entry, if the parts of the archive are all that is in ``data`` from ``start`` on.

    zipfile would skip bytes before, between and behind them, and take a name from the directory alone; other programs
    might read such a file otherwise than we do.

    Args:
        entries: The entries, in the order in which they stand.
        directory: Where the directory begins.
        data: The whole file.
        start: Where the archive begins.
    Raises:
        ValueError, struct.error: they are not, or an entry has another name than the directory says.
    """
    whole, packed, place = memoryview(data), {}, start
    for entry in entries:
        names = place + _LOCAL_HEADER
        name, extra = _LOCAL_LENGTHS.unpack_from(data, names - _LOCAL_LENGTHS.size)
        if entry.header_offset != place or data[place : place + 4] != b"PK\x03\x04":
            raise ValueError(f"bytes before entry {entry.filename}")
        if data[names : names + name] != entry.orig_filename.encode():
            raise ValueError(f"entry {entry.filename} goes by another name, too")
        place = names + name + extra + entry.compress_size
        packed[entry.filename] = whole[place - entry.compress_size : place]
    if place != directory:
        raise ValueError("bytes before its directory")
    for entry in entries:
        place += _DIRECTORY_ENTRY + len(entry.orig_filename) + len(entry.extra) + len(entry.comment)
    place += _DIRECTORY_END + (_DIRECTORY_END_64 if directory > zipfile.ZIP64_LIMIT else 0)
    if place != len(data):
        raise ValueError("bytes behind its directory")
    if _DIRECTORY_COUNTS.unpack_from(data, len(data) - _DIRECTORY_END + 4) != (0, 0, len(entries), len(entries)):
        raise ValueError(f"a directory of {len(entries)} entries that tells another number")
    return packed


def _array(packed: memoryview, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """The array in an entry, which holds an .npy file and nothing after it; ``packed`` is as it stands in the archive.

    Raises:
        ValueError, zlib.error: it does not, or is damaged.
    """
    content, begin, checksum = np.empty(entry.file_size, np.uint8), 0, 0
    for piece in _unpacked_pieces(packed, entry):
        end = begin + len(piece)
        if end > entry.file_size:
            raise ValueError(f"entry {entry.filename} is longer than the {entry.file_size:,} bytes that it tells")
        content[begin:end] = np.frombuffer(piece, np.uint8)
        checksum, begin = zlib.crc32(piece, checksum), end
    if begin != entry.file_size or checksum != entry.CRC:
        raise ValueError(f"entry {entry.filename} ends early or is damaged")
    try:
        return array_of(content.data)
    except ValueError as error:
        raise ValueError(f"entry {entry.filename} {error}") from None


def _unpacked_pieces(packed: memoryview, entry: zipfile.ZipInfo) -> Iterator[bytes | memoryview]:
    """What an entry unpacks to, in pieces of at most `_PIECE` bytes.

    Raises:
        ValueError, zlib.error: the packed bytes are damaged, end early, or go on behind their end.
    """
    inflate = None if entry.compress_type == zipfile.ZIP_STORED else zlib.decompressobj(-zlib.MAX_WBITS)
    for begin in range(0, len(packed), _PIECE):
        rest: bytes | memoryview = packed[begin : begin + _PIECE]
        if inflate is None:
            yield rest
            continue
        while piece := inflate.decompress(rest, _PIECE):
            yield piece
            rest = inflate.unconsumed_tail
    if inflate is not None and (not inflate.eof or inflate.unused_data):
        raise ValueError(f"entry {entry.filename} does not end where its packed bytes do")


def _cause(error: Exception) -> str:
    """What ``error`` says, on one short line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def _magic(kind: str) -> bytes:
    return f"lava-vpr {kind} 1\n".encode()


def _foreign(path: Path, kind: str, data: bytes) -> str:
    if not data:
        return f"{shown(path)}: the file is empty, not a lava-vpr {kind}; {REMEDIES[kind]}"
    first = data[:40].split(b"\n", 1)[0]
    if first.startswith(b"lava-vpr "):
        return (
            f"{shown(path)}: is a {first.decode(errors='replace')!r} file, not a 'lava-vpr {kind} 1'; "
            "give the right file"
        )
    return (
        f"{shown(path)}: is not a lava-vpr {kind} (made by another program?); give a file written by `lava-vpr train`"
    )
