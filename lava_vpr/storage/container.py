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
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ModelFileError
from lava_vpr.storage.limits import excess
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import write_atomically


def pack(kind: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A container of ``kind`` (``model``, ``checkpoint`` or ``references``)."""
    buffer = io.BytesIO()
    text = json.dumps(header, sort_keys=True, allow_nan=False).encode()
    np.savez_compressed(buffer, header=np.frombuffer(text, np.uint8), **{f"a.{k}": v for k, v in arrays.items()})
    payload = buffer.getvalue()
    return _magic(kind) + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


def save(path: Path, kind: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the container that `pack` makes to ``path``.

    Raises:
        ModelFileError: it cannot be written; what stood at ``path`` still does.
    """
    data = pack(kind, header, arrays)
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
        return _unpacked(data)
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

_ENTRY = re.compile(r"(header|a\.[a-z0-9_.]{1,60})\.npy")
_PREFIX = struct.Struct("<6sBBH")
"""What an .npy file begins with: the magic string, two numbers of its version, the length of its header."""
_NPY_HEADER = re.compile(
    r"\{'descr': '([<|])([uif][1248])', 'fortran_order': (True|False), 'shape': \(([0-9, ]{0,80})\), \} *\n"
)
_MOST_NPY_HEADER = 512
_PIECE = 1 << 20


class _Beyond(Exception):
    """A container costs more than a limit allows; the message says what, and how the limit is raised."""


def _unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of the archive at the end of ``data``; the errors are `_Beyond` and those in `_UNFIT`."""
    if data.count(b"PK\x01\x02") > _MOST_ENTRIES:  # before the directory is read, whose entries cost memory
        raise ValueError(f"it has more than {_MOST_ENTRIES:,} entries")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = archive.infolist()
        _check_entries(entries)
        arrays: dict[str, NDArray[Any]] = {}
        for entry in entries:
            with archive.open(entry) as file:
                arrays[entry.filename[: -len(".npy")]] = _array(file, entry)
    text = arrays.pop("header", None)
    if text is None:
        raise ValueError("it has no header")
    if text.dtype != np.uint8 or text.ndim != 1:
        raise ValueError(f"a header of {text.dtype} and shape {text.shape}, not of bytes")
    header = parse_json(text.tobytes())
    if not isinstance(header, dict):
        raise ValueError("its header is no JSON object")
    return header, {name[len("a.") :]: array for name, array in arrays.items()}


def _check_entries(entries: list[zipfile.ZipInfo]) -> None:
    """Refuse a directory that `pack` does not write, or whose entries unpack to more than the limits allow."""
    seen = set()
    for entry in entries:
        name = entry.orig_filename
        if not _ENTRY.fullmatch(name) or name in seen:
            raise ValueError(f"{'a second' if name in seen else 'an unknown'} entry {name[:60]!r}")
        if entry.flag_bits & 0x1 or entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"entry {name} is encrypted or compressed in an unknown way")
        seen.add(name)
        beyond = excess("header_bytes", entry.file_size) if name == "header.npy" else None
        if beyond is not None:
            raise _Beyond(f"has a header of {beyond}")
    beyond = excess("model_bytes", sum(entry.file_size for entry in entries))
    if beyond is not None:
        raise _Beyond(f"unpacks to {beyond}")


def _array(file: IO[bytes], entry: zipfile.ZipInfo) -> NDArray[Any]:
    """The array in an open entry, which holds an .npy file of version 1 and nothing after it.

    Raises:
        ValueError: it does not.
        OSError, EOFError, zipfile.BadZipFile, zlib.error: the entry is damaged.
    """
    name = entry.filename
    start = file.read(_PREFIX.size)
    magic, *version, length = _PREFIX.unpack(start) if len(start) == _PREFIX.size else (b"", 0, 0, 0)
    if magic != b"\x93NUMPY" or version != [1, 0] or length > _MOST_NPY_HEADER:
        raise ValueError(f"entry {name} is no array of numbers")
    described = _NPY_HEADER.fullmatch(file.read(length).decode("latin-1"))
    if described is None:
        raise ValueError(f"entry {name} is no array of numbers")
    order, code, fortran, sizes = described.groups()
    if (order == "|") != (code[1] == "1"):
        raise ValueError(f"entry {name} is no array of numbers")
    dtype = np.dtype(order + code)
    shape = tuple(int(size) for size in sizes.split(",") if size.strip())
    size = math.prod(shape) * dtype.itemsize
    if _PREFIX.size + length + size != entry.file_size:
        raise ValueError(f"entry {name} has {entry.file_size:,} bytes, which its shape {shape} does not need")
    content = np.empty(size, np.uint8)
    for begin in range(0, size, _PIECE):
        piece = file.read(min(_PIECE, size - begin))
        content[begin : begin + len(piece)] = np.frombuffer(piece, np.uint8)
        if len(piece) < min(_PIECE, size - begin):
            raise EOFError(f"entry {name} ends early")
    if file.read(1):
        raise ValueError(f"entry {name} goes on after its array")
    return content.view(dtype).reshape(shape, order="F" if fortran == "True" else "C")


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
