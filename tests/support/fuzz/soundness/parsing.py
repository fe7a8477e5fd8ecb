"""Containers, arrays and JSON read by other means than the program's.

Used by support.
"""

from __future__ import annotations

import ast
import hashlib
import json
import math
import struct
import zlib
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from support.fuzz.soundness.rules import Findings

MOST = 1 << 28
"""Bytes that the array of a small file may take."""


def array_of(data: bytes, findings: Findings, where: str) -> NDArray[Any] | None:
    """The array in npy bytes, or None."""
    try:
        if data[:6] != b"\x93NUMPY" or data[6] not in (1, 2, 3):
            raise ValueError("magic")
        wide = data[6] > 1
        size = struct.unpack_from("<I" if wide else "<H", data, 8)[0]
        start = (12 if wide else 10) + size
        header = ast.literal_eval(data[12 if wide else 10 : start].decode("utf-8" if data[6] == 3 else "latin-1"))
        if set(header) != {"descr", "fortran_order", "shape"} or not isinstance(header["descr"], str):
            raise ValueError("keys")
        dtype, shape = np.dtype(header["descr"]), tuple(header["shape"])
        if dtype.kind not in "biuf" or any(type(n) is not int or n < 0 for n in shape):
            raise ValueError("type or shape")
        count = math.prod(shape)
        if len(data) - start != count * dtype.itemsize:
            raise ValueError(f"{len(data) - start} bytes for {count} numbers")
    except (
        ValueError,
        SyntaxError,
        TypeError,
        KeyError,
        IndexError,
        struct.error,
        RecursionError,
        MemoryError,
    ) as error:
        findings.need(False, "F3", f"{where} is no array of numbers ({error!r:.80})")
        return None
    flat = np.frombuffer(data[start:], dtype)
    return flat.reshape(shape, order="F" if header["fortran_order"] else "C")


def json_of(data: bytes, findings: Findings, rule: str, where: str) -> Any:
    """The JSON value of ``data``, or None."""

    def refuse(word: str) -> NoReturn:
        raise ValueError(word)

    try:
        return json.loads(data.decode("utf-8"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        findings.need(False, rule, f"{where} is no JSON ({error!r:.80})")
        return None


def entries_of(data: bytes, findings: Findings) -> dict[str, bytes]:
    """The entries of a zip archive by their local headers, which must agree with the directory."""
    found: dict[str, bytes] = {}
    try:
        end = data.rindex(b"PK\x05\x06")
        count, size, at, comment = struct.unpack_from("<HIIH", data, end + 10)
        findings.need(end + 22 + comment == len(data) and comment == 0, "F2", "bytes behind the archive")
        findings.need(at + size == end, "F2", "bytes between or before the parts of the archive")
        behind = 0
        for _ in range(count):
            fields = struct.unpack_from("<4sHHHHHHIIIHHHHHII", data, at)
            flags, method, crc, packed, unpacked, n, extra, note = (fields[k] for k in (3, 4, 7, 8, 9, 10, 11, 12))
            name = data[at + 46 : at + 46 + n].decode("utf-8")
            start = fields[-1]
            local = struct.unpack_from("<4sHHHHHIIIHH", data, start)
            findings.need(fields[0] == b"PK\x01\x02" and local[0] == b"PK\x03\x04", "F2", f"{name}: no entry")
            body = start + 30 + local[9] + local[10]
            findings.need(data[start + 30 : start + 30 + local[9]].decode() == name, "F2", f"{name}: of two names")
            findings.need(start == behind, "F2", f"{name}: bytes before it")
            packed, unpacked = _large(data[at + 46 + n : at + 46 + n + extra], packed, unpacked)
            raw = data[body : body + packed]
            content = zlib.decompressobj(-15).decompress(raw, MOST) if method == 8 else raw
            findings.need(method in (0, 8) and not flags & 1, "F2", f"{name}: packed by method {method}")
            findings.need(len(content) == unpacked and zlib.crc32(content) == crc, "F2", f"{name}: is damaged")
            findings.need(name not in found, "F2", f"{name}: there twice")
            found[name] = content
            behind, at = body + packed, at + 46 + n + extra + note
    except (ValueError, struct.error, zlib.error, IndexError) as error:
        findings.need(False, "F2", f"no zip archive ({error!r:.80})")
    return found


def _large(extra: bytes, packed: int, unpacked: int) -> tuple[int, int]:
    """Sizes of an entry with zip64's extra field."""
    at = 0
    while at + 4 <= len(extra):
        kind, size = struct.unpack_from("<HH", extra, at)
        if kind == 1:
            numbers = [n for (n,) in struct.iter_unpack("<Q", extra[at + 4 : at + 4 + size])]
            if unpacked == 0xFFFFFFFF:
                unpacked = numbers.pop(0)
            if packed == 0xFFFFFFFF:
                packed = numbers.pop(0)
        at += 4 + size
    return packed, unpacked


def container_of(data: bytes, kind: str, findings: Findings) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of a container; empty where there is none."""
    line, _, rest = data.partition(b"\n")
    digest, _, payload = rest.partition(b"\n")
    findings.need(line == f"lava-vpr {kind} 1".encode(), "F1", f"begins with {line[:30]!r}")
    findings.need(digest == hashlib.sha256(payload).hexdigest().encode(), "F1", "another checksum")
    entries = entries_of(payload, findings)
    arrays: dict[str, NDArray[Any]] = {}
    for name, content in entries.items():
        findings.need(name == "header.npy" or (name[:2] == "a." and name[-4:] == ".npy"), "F2", f"holds {name[:40]!r}")
        array = array_of(content, findings, name)
        if array is not None:
            arrays[name.removesuffix(".npy")] = array
    stored = arrays.pop("header", None)
    findings.need(stored is not None and stored.dtype == np.uint8 and stored.ndim == 1, "F3", "no header of bytes")
    header = None if stored is None else json_of(stored.tobytes(), findings, "F3", "header")
    findings.need(isinstance(header, dict), "F3", "the header is no object")
    return (header if isinstance(header, dict) else {}), {name[2:]: array for name, array in arrays.items()}
