"""Reads ``.npy`` files: one reader for arrays in containers, in bundles, and from other programs.

The header is read by a pattern, not as Python, and held against the length of the file before memory is taken. What is
read is version 1 of the format, which `numpy.save` writes for every plain array
(https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html).
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.storage.reading import read_bytes
from lava_vpr.storage.text import shown

_MAGIC = b"\x93NUMPY\x01\x00"
_BEGIN = len(_MAGIC) + 2
_HEADER = re.compile(
    rb"\{ ?'descr': ?'([^']{1,8})', ?'fortran_order': ?(True|False), ?'shape': ?\(([0-9, ]{0,120})\),? ?\} *\n?"
)
_TYPE = re.compile(r"[<|][biufcmMSUV]\d{1,4}")
_MOST_AXES, _LONGEST_AXIS = 32, 10**12

Shape = tuple[int | str, ...]
"""The length of each axis, or what it counts if any will do."""


def array_of(
    data: bytes | memoryview, kind: DTypeLike = None, shape: Shape | None = None, *, texts: bool = False
) -> NDArray[Any]:
    """The array in the content of a ``.npy`` file: a view of ``data`` where its memory allows, writeable if that is.

    Args:
        data: The content.
        kind: The type that its numbers must have; None: any whole, real or truth values.
        shape: The shape that it must have; None: any.
        texts: Whether an array of texts of fixed length is taken, too.
    Raises:
        ValueError: there is none, or one of another type or shape; fit for a message, as in "FILE: is ...".
    """
    end = _BEGIN + int.from_bytes(data[len(_MAGIC) : _BEGIN], "little")
    header = _HEADER.fullmatch(data[_BEGIN:end])
    if bytes(data[: len(_MAGIC)]) != _MAGIC or header is None:
        raise ValueError("is no array of numbers (it does not begin as numpy.save would write it)")
    found = _type(header[1].decode("latin-1"), "biufU" if texts else "biuf")
    sizes = tuple(int(size) for size in header[3].split(b",") if size.strip())
    if (
        len(sizes) > _MOST_AXES
        or max(sizes, default=0) > _LONGEST_AXIS
        or len(data) - end != math.prod(sizes) * found.itemsize
    ):
        raise ValueError(
            f"is no array of numbers (its header says {found} {sizes}, but {len(data) - end:,} bytes follow)"
        )
    fits = shape is None or (
        len(sizes) == len(shape)
        and all(isinstance(wanted, str) or size == wanted for size, wanted in zip(sizes, shape, strict=True))
    )
    if not fits or (kind is not None and found != np.dtype(kind)):
        wanted = "an array" if kind is None else str(np.dtype(kind))
        named = "" if shape is None else f" ({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"is {found} {sizes}, but must be {wanted}{named}")
    array = np.frombuffer(data, found, offset=end).reshape(sizes, order="F" if header[2] == b"True" else "C")
    return array if array.flags.aligned else array.copy()


def _type(code: str, kinds: str) -> np.dtype[Any]:
    """The type that a header's ``code`` stands for, if it is of one of ``kinds``, as NumPy calls them."""
    if code == "|O":
        raise ValueError("is no array of numbers (but of pickled objects)")
    try:
        found = np.dtype(code) if _TYPE.fullmatch(code) else None
    except TypeError:  # numbers of seven bytes
        found = None
    if found is None or found.kind not in kinds:
        raise ValueError(f"is no array of numbers (but of {brief(code)}; whole, real and truth values are read)")
    return found


def read_array(path: Path, remedy: str) -> NDArray[Any]:
    """The array in a ``.npy`` file that another program wrote; it cannot be written to.

    Args:
        path: The file.
        remedy: What a message tells to do about a file that holds none.
    Raises:
        InputError: it cannot be read, is longer than the limit ``array_bytes``, or holds no array of numbers.
    """
    try:
        return array_of(read_bytes(path, "array_bytes"))
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror or error}); {remedy}") from None
    except ValueError as error:
        raise InputError(f"{shown(path)}: {error}; {remedy}") from None
