"""HDF5 files that anybody may have written, read into plain dictionaries without following what they name.

A file is read whole, within a limit, and opened from memory. Its objects are walked by hard links
alone: a soft or external link, a dataset that lies in other files (external or virtual), an unknown filter and any type
but numbers and texts are refused, and what all datasets unpack to is added up before the first is read.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from lava_vpr.errors import InputError, brief, said, shown
from lava_vpr.interrupts import stoppable
from lava_vpr.storage.limits import excess, limit, unpacking
from lava_vpr.storage.reading import read_bytes

_DEPTH, _OBJECTS = 8, 10_000
_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF)
_CLASSES = (h5py.h5t.INTEGER, h5py.h5t.FLOAT, h5py.h5t.STRING, h5py.h5t.ENUM, h5py.h5t.BITFIELD)
_HEAP, _SMALLEST_HEAP = b"GCOL\1", 4096
"""How a collection of texts of variable length begins, and the bytes that it has at least."""
_PART = struct.Struct("<H6xQ")
"""The head of a text, its number and length; also that of a collection, of which only the length is looked at."""
_BROKEN = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, AttributeError, UnicodeError)
"""What h5py raises about a file that is damaged."""


class UnfitHdf5(Exception):
    """The file is no HDF5 that is read here; the message says why, as in "has a soft link"."""


def read(path: Path, what: str, limit_name: str = "model_file_bytes", unpacked: str = "model_bytes") -> dict[str, Any]:
    """Everything in the HDF5 file at ``path``: groups as dictionaries, datasets as arrays, numbers and texts.

    Args:
        path: The file.
        what: What it should be, for messages: "NIR graph".
        limit_name: The limit on its bytes.
        unpacked: The limit on the bytes that it unpacks to.
    Raises:
        InputError: missing, no HDF5, truncated, damaged, too large, or with parts that are not read (see above).
    """
    try:
        data = read_bytes(path, limit_name)
    except OSError as error:
        raise InputError(f"{shown(path)}: the {what} cannot be read ({error.strerror}); check the path") from None
    if not data.startswith(b"\x89HDF\r\n\x1a\n"):
        raise InputError(f"{shown(path)}: is no HDF5 file, which a {what} is; give the right file")
    try:
        return stoppable(lambda: _content(data, unpacked))
    except UnfitHdf5 as error:
        raise InputError(f"{shown(path)}: the {what} {error}; write it again without") from None
    except MemoryError:
        raise InputError(f"{shown(path)}: the {what} unpacks to more than this machine has memory for") from None
    except _BROKEN as error:
        raise InputError(
            f"{shown(path)}: the {what} is truncated or damaged ({said(error)}); fetch an intact copy"
        ) from None


def _content(data: bytes, unpacked: str) -> dict[str, Any]:
    """Everything in an HDF5 file; see `read`.

    Raises:
        Unfit: it has parts that are not read.
        Exception: one in `_BROKEN`, or `MemoryError`.
    """
    with h5py.File(io.BytesIO(data), "r") as file:
        names = _found(file, len(data), unpacked)
        if any(file[name].dtype.kind == "O" for name in names):
            if file.id.get_create_plist().get_sizes() != (8, 8):
                raise UnfitHdf5("has lengths of other than 8 bytes")
            _check_heaps(data)
        return _values(file, names)


def _check_heaps(data: bytes) -> None:
    """Refuse collections of texts of variable length whose parts do not add up.

    The HDF5 library goes round in such a collection for ever (its issue 1707). What it refuses itself, as too small or
    longer than the file, is left to it: these may be no collections, but numbers that look alike.
    Source: HDF5 File Format Specification 3.0, III.E, Global Heap.

    Args:
        data: The whole file, whose lengths have 8 bytes.
    Raises:
        ValueError: there are such.
        Unfit: there are more texts than the limit ``rows`` allows.
    """
    collections, texts, begin = 0, 0, data.find(_HEAP)
    most = limit("rows")
    while 0 <= begin <= len(data) - _PART.size:
        size = _PART.unpack_from(data, begin)[1]
        end = begin + size
        if _SMALLEST_HEAP <= size and end <= len(data):
            collections += size
            at = begin + _PART.size
            while at + _PART.size <= end:
                number, length = _PART.unpack_from(data, at)
                step = _PART.size + (length + 7) // 8 * 8 if number else length  # number 0: what is free, all in all
                at += step
                texts += 1
                if step < _PART.size or at > end or collections > len(data):
                    raise ValueError("texts of variable length do not add up")
                if texts > most:
                    raise UnfitHdf5(f"has texts of variable length, {excess('rows', texts)}")
        begin = data.find(_HEAP, begin + 1)


def _found(file: h5py.File, packed: int, unpacked: str) -> list[str]:
    """The names of all datasets, each seen to be one that is read here.

    Raises:
        Unfit: one is not, there are too many, or they unpack to too much.
    """
    datasets: list[str] = []
    waiting, seen, total = [("", file)], 0, 0
    while waiting:
        prefix, group = waiting.pop()
        for name in group:
            path = f"{prefix}/{name}"
            seen += 1
            if seen > _OBJECTS or path.count("/") > _DEPTH:
                raise UnfitHdf5(f"has more than {_OBJECTS:,} parts, or parts nested more than {_DEPTH} deep")
            if type(group.get(name, getlink=True)) is not h5py.HardLink:
                raise UnfitHdf5(f"has {brief(path)}, a link to somewhere else")
            part = group[name]
            if isinstance(part, h5py.Group):
                waiting.append((path, part))
                continue
            total += _size(part, path)
            datasets.append(path)
    beyond = unpacking(unpacked, total, packed)
    if beyond is not None:
        raise UnfitHdf5(f"unpacks to {beyond}")
    return datasets


def _size(part: Any, path: str) -> int:
    """The bytes that a dataset unpacks to.

    Raises:
        Unfit: it is none, lies elsewhere, has an unknown filter, or is of a type that is not read.
    """
    if not isinstance(part, h5py.Dataset):
        raise UnfitHdf5(f"has {brief(path)}, which is no data")
    if part.is_virtual or part.external:
        raise UnfitHdf5(f"has {brief(path)}, whose data lie in other files")
    properties = part.id.get_create_plist()
    for number in range(properties.get_nfilters()):
        if properties.get_filter(number)[0] not in _FILTERS:
            raise UnfitHdf5(f"has {brief(path)}, which is packed by a filter other than gzip and lzf")
    plain = (
        part.id.get_type().get_class() in _CLASSES
    )  # of a type nested deeply, h5py would take minutes to make a dtype
    if part.shape is None or not plain or part.dtype.kind not in "fiubSO":
        raise UnfitHdf5(f"has {brief(path)}, which holds neither numbers nor text")
    return int(part.size) * int(part.dtype.itemsize)


def _values(file: h5py.File, names: list[str]) -> dict[str, Any]:
    """All datasets, read; groups without any are left out."""
    values: dict[str, Any] = {}
    for path in names:
        *groups, name = path.strip("/").split("/")
        into = values
        for group in groups:
            into = into.setdefault(group, {})
        into[name] = _plain(file[path][()])
    return values


def _plain(value: Any) -> Any:
    """A dataset's value: text as text, one number as that, more as an array."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.generic):
        return value.item().decode() if isinstance(value, np.bytes_) else value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind in "SO":
        return np.array([item.decode() for item in value.ravel()], dtype=object).reshape(value.shape)
    return value
