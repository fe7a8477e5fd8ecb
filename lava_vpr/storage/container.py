"""One-file container of named arrays and a JSON header: models and checkpoints.

Layout: a magic line, the SHA-256 of the rest in hexadecimal, a newline, then a compressed ``.npz`` (no pickle) whose
entry ``header`` is UTF-8 JSON. Equal content gives equal bytes. Files are written under a temporary name, flushed to
the disk and renamed, so that a crash or a full disk leaves what was there before.

A right checksum says that a file is whole, not that it is honest: what it unpacks to is bounded by `model_bytes`
(`lava_vpr.storage.arrays`), and each entry must be what its own header says, to the byte.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ModelFileError, brief, said, shown
from lava_vpr.storage.arrays import ARCHIVE_ERRORS, ArchiveLimitError, array_of, check_budget, entries_of, unpacked
from lava_vpr.storage.limits import excess
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.writing import write_atomically, written

_LEVEL = 3
"""zlib's level: files of models are as small as at its usual 6, and written twice as fast."""


def pack(kind: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A container of ``kind`` (``model``, ``season``, ``gain table``, ``checkpoint`` or ``references``).

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
    except ArchiveLimitError as error:
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
    with written(path, f"the {kind} ", ModelFileError):
        write_atomically(path, lambda file: file.write(data))


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
    except ArchiveLimitError as error:
        raise ModelFileError(f"{shown(path)}: the {kind} {error}") from None
    except MemoryError:
        raise ModelFileError(
            f"{shown(path)}: the {kind} unpacks to more than this machine has memory for; use a machine with more, or "
            "free some"
        ) from None
    except _UNFIT as error:
        raise ModelFileError(
            f"{shown(path)}: the {kind} does not hold what it should ({said(error)}); {REMEDIES[kind]}"
        ) from None


REMEDIES = {
    "model": "train it again or fetch an intact copy",
    "references": "deploy the model again",
    "season": "learn it again (lava-vpr watch --learn --season FILE)",
    "gain table": "write it again (lava-vpr query --learn --gains FILE)",
    "checkpoint": "delete it and train from the start, without --resume",
}
"""What to do about a file of each kind that cannot be used."""
_WRITERS = {"season": "watch --learn", "gain table": "query --learn --gains"}

_UNFIT = (*ARCHIVE_ERRORS, OSError)
"""What reading an archive and its entries raises when they are not what they should be."""

_MOST_ENTRIES = 65_535
"""Entries that an archive without ZIP64's own directory can have; a checkpoint has two for each stretch."""

_ENTRY = re.compile(r"(header|a\.[a-z0-9_.]{1,60})\.npy")


def _unpacked(data: bytes, start: int) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of the archive in ``data``, from ``start`` on; errors: `ArchiveLimitError`, and `_UNFIT`."""
    if data.count(b"PK\x01\x02") > _MOST_ENTRIES:  # before the directory is read, whose entries cost memory
        raise ValueError(f"it has more than {_MOST_ENTRIES:,} entries")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = entries_of(archive, _MOST_ENTRIES)
        _check_entries(entries, len(data))
        arrays = {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in entries}
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
    for entry in entries:
        name = entry.orig_filename
        if not _ENTRY.fullmatch(name):
            raise ValueError(f"an unknown entry {brief(name)}")
        beyond = excess("header_bytes", entry.file_size) if name == "header.npy" else None
        if beyond is not None:
            raise ArchiveLimitError(f"has a header of {beyond}")
    check_budget(entries, packed, "model_bytes")


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """The array in an entry, which holds an .npy file and nothing after it."""
    try:
        return array_of(unpacked(archive, entry))
    except ValueError as error:
        raise ValueError(f"entry {entry.filename} {error}") from None


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
        f"{shown(path)}: is not a lava-vpr {kind} (made by another program?); give a file written by "
        f"`lava-vpr {_WRITERS.get(kind, 'train')}`"
    )
