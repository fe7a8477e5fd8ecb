"""Reads arrays as bundles hold them: ``.npy`` files of version 1, C order, little endian, numbers only.

The header is compared with the length of the file before memory is taken, and read by a pattern, not as Python.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_MAGIC = b"\x93NUMPY\x01\x00"
_SIZES = rb"|\d{1,12},|\d{1,12}(?:, \d{1,12}){1,7}"
_HEADER = re.compile(rb"\{'descr': '([<|][uifb]\d)', 'fortran_order': False, 'shape': \((%s)\), \} *\n" % _SIZES)

Shape = tuple[int | str, ...]
"""The length of each axis, or what it counts if any will do."""


def array_of(data: bytes, kind: DTypeLike = None, shape: Shape | None = None) -> NDArray[Any]:
    """The array in the content of a file that `lava_vpr.deploy.bundle.folder.array_bytes` made.

    Args:
        data: The content.
        kind: The type that its numbers must have; None: any.
        shape: The shape that it must have; None: any.
    Raises:
        ValueError: there is none, or one of another type or shape; fit for a message, as in "FILE: is no array".
    """
    begin = len(_MAGIC) + 2
    end = begin + int.from_bytes(data[len(_MAGIC) : begin], "little")
    header = _HEADER.fullmatch(data[begin:end])
    if not data.startswith(_MAGIC) or header is None:
        raise ValueError("is no array (its header is none that lava-vpr writes)")
    found = np.dtype(header[1].decode())
    sizes = tuple(int(size) for size in header[2].split(b",") if size.strip())
    if len(data) - end != math.prod(sizes) * found.itemsize:
        raise ValueError(f"is no array (its header says {found} {sizes}, but {len(data) - end:,} bytes follow)")
    fits = shape is None or (
        len(sizes) == len(shape)
        and all(isinstance(wanted, str) or size == wanted for size, wanted in zip(sizes, shape, strict=True))
    )
    if not fits or (kind is not None and found != np.dtype(kind)):
        wanted = "an array" if kind is None else str(np.dtype(kind))
        named = "" if shape is None else f" ({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"is {found} {sizes}, but must be {wanted}{named}")
    return np.frombuffer(data, found, offset=end).reshape(sizes).copy()
