"""One-file container of named arrays and a JSON header: models and checkpoints.

Layout: a magic line, the SHA-256 of the rest in hexadecimal, a newline, then a compressed ``.npz`` (no pickle) whose
entry ``header`` is UTF-8 JSON. Equal content gives equal bytes. Files are written under a temporary name, flushed to
the disk and renamed, so that a crash or a full disk leaves what was there before.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ModelFileError
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
            f"{path}: the {kind} cannot be written ({error.strerror}); free space or choose another place"
        ) from None


def load(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of the container at ``path``.

    Raises:
        ModelFileError: missing, not a lava-vpr file, of another kind or version, truncated or altered.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ModelFileError(f"{path}: the {kind} cannot be read ({error.strerror}); check the path") from None
    return unpack(data, path, kind)


def unpack(data: bytes, path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of what `pack` made; ``path`` is for messages.

    Raises:
        ModelFileError: as `load`.
    """
    magic = _magic(kind)
    if not data.startswith(magic):
        raise ModelFileError(_foreign(path, kind, data))
    digest, separator, payload = data[len(magic) :].partition(b"\n")
    if not separator or hashlib.sha256(payload).hexdigest().encode() != digest:
        raise ModelFileError(f"{path}: the {kind} is damaged (checksum differs); {_REMEDY[kind]}")
    try:
        with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
            header = json.loads(archive["header"].tobytes())
            arrays = {name[2:]: archive[name] for name in archive.files if name.startswith("a.")}
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ModelFileError(f"{path}: the {kind} does not hold what it should ({error}); {_REMEDY[kind]}") from None
    return header, arrays


_REMEDY = {
    "model": "train it again or fetch an intact copy",
    "references": "deploy the model again",
    "checkpoint": "delete it and train from the start, without --resume",
}


def _magic(kind: str) -> bytes:
    return f"lava-vpr {kind} 1\n".encode()


def _foreign(path: Path, kind: str, data: bytes) -> str:
    if not data:
        return f"{path}: the file is empty, not a lava-vpr {kind}; {_REMEDY[kind]}"
    first = data[:40].split(b"\n", 1)[0]
    if first.startswith(b"lava-vpr "):
        return f"{path}: is a {first.decode(errors='replace')!r} file, not a 'lava-vpr {kind} 1'; give the right file"
    return f"{path}: is not a lava-vpr {kind} (made by another program?); give a file written by `lava-vpr train`"
