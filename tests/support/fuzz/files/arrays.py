"""Mutations of arrays in NumPy's file format: other types, shapes and values, and headers that lie.

Used by storage and support.
"""

from __future__ import annotations

import io
import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

TYPES = ("u1", "i1", "u2", "i2", "<i4", ">i4", "u4", "i8", "u8", "f2", "f4", ">f4", "f8", "?", "c16", "S3", "U2", "V4")
TYPES += ("M8[s]", "O")
FEW = 1 << 16
"""Numbers of an array that is made larger, at most: the honest ones are small, and so is the machine."""


def stored(array: NDArray[Any], version: tuple[int, int] = (1, 0)) -> bytes:
    """``array`` as an npy file, in its own order and byte order."""
    if array.dtype.hasobject:
        return lying("|O", False, array.shape, b"\x80\x04]\x94.")
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, version=version, allow_pickle=False)
    return buffer.getvalue()


def lying(descr: str, fortran: bool, shape: object, data: bytes) -> bytes:
    """An npy file whose header says what it is told to."""
    text = f"{{'descr': {descr!r}, 'fortran_order': {fortran}, 'shape': {shape}, }}"
    header = text.encode("latin-1")
    padding = 64 - (10 + len(header) + 1) % 64
    header += b" " * padding + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def _type(rng: random.Random, array: NDArray[Any]) -> tuple[NDArray[Any], str]:
    name = rng.choice(TYPES)
    if name == "O":
        return array.astype(object), "becomes objects"
    if rng.random() < 0.5 and np.dtype(name).itemsize == array.dtype.itemsize:
        return array.view(name), f"bytes read as {name}"
    kept = array if name not in ("M8[s]", "V4") else array.astype("u4")
    try:
        with np.errstate(all="ignore"):
            return kept.astype(name, casting="unsafe"), f"becomes {name}"
    except (TypeError, ValueError):
        return np.zeros(array.shape, name), f"becomes {name} of zeros"


def _shape(rng: random.Random, array: NDArray[Any]) -> tuple[NDArray[Any], str]:
    flat = array.reshape(-1)
    choices: list[tuple[str, NDArray[Any]]] = [
        ("flat", flat),
        ("with one dimension more", array[None]),
        ("with one dimension more at the end", array[..., None]),
        ("without its last row", array[:-1]),
        ("without its first row", array[1:]),
        ("with its first row alone", array[:1]),
        ("with its rows twice", np.concatenate([array, array])),
        ("without rows", array[:0]),
        ("without columns", array[..., :0]),
        ("without its last column", array[..., :-1]),
        ("with its columns twice", np.concatenate([array, array], axis=-1)),
        ("transposed", array.T),
        ("in Fortran's order", np.asfortranarray(array)),
        ("backwards", array[::-1]),
        ("a number", flat[:1].reshape(()) if flat.size else np.zeros((), array.dtype)),
        ("long", np.resize(flat, max(1, FEW // 16))),
        ("of 32 dimensions", flat[:1].reshape((1,) * min(32, 1 + 31 * bool(flat.size))) if flat.size else flat),
    ]
    told, made = rng.choice(choices)
    return made, told


def _values(rng: random.Random, array: NDArray[Any]) -> tuple[NDArray[Any], str]:
    made = np.array(array)
    if made.dtype.kind == "f":
        info = np.finfo(made.dtype)
        # 3e38 is within float32, and its sum is not.
        odd = [np.nan, np.inf, -np.inf, -1.0, -0.0, float(info.max), float(info.tiny), 1e30, 0.5, 0.0, -1e-9]
    elif made.dtype.kind in "iu":
        limits = np.iinfo(made.dtype)
        odd = [limits.min, limits.max, limits.max - 1, 0, 1, 2, 7, 8, 127]
        odd += [value for value in (-1, 255, 4096, 65536, 131072, 1 << 24) if limits.min <= value <= limits.max]
    else:
        odd = [0, 1]
    value = rng.choice(odd)
    if made.size == 0:
        return made, "as it is"
    if rng.random() < 0.65:
        at = rng.randrange(made.size)
        made.reshape(-1)[at] = value
        return made, f"{value!r} at {at}"
    if rng.random() < 0.5 and made.ndim:
        made[rng.randrange(len(made))] = value
        return made, f"{value!r} in a row"
    made[...] = value
    return made, f"{value!r} everywhere"


def _order(rng: random.Random, array: NDArray[Any]) -> tuple[NDArray[Any], str]:
    made = np.array(array)
    if made.ndim == 0 or len(made) < 2:
        return made, "as it is"
    a, b = rng.sample(range(len(made)), 2)
    if rng.random() < 0.5:
        made[a] = made[b]
        return made, f"row {b} also at {a}"
    made[[a, b]] = made[[b, a]]
    return made, f"rows {a} and {b} exchanged"


def _near(rng: random.Random, array: NDArray[Any]) -> tuple[NDArray[Any], str]:
    made = np.array(array)
    if made.size == 0 or made.dtype.kind not in "iuf":
        return made, "as it is"
    at, step = rng.randrange(made.size), rng.choice([-1, 1, 2, 100])
    with np.errstate(all="ignore"):
        made.reshape(-1)[at : at + 1] += np.array(step).astype(made.dtype)
    return made, f"{step} added at {at}"


def _lie(rng: random.Random, array: NDArray[Any]) -> tuple[bytes, str]:
    """A header that does not fit the numbers."""
    data, descr = array.tobytes(), array.dtype.str
    shape = tuple(array.shape)
    rows = shape[0] if shape else 1
    rest = shape[1:]
    choices: list[tuple[str, bytes]] = [
        ("a header of one row more", lying(descr, False, (rows + 1, *rest), data)),
        ("a header of one row less", lying(descr, False, (max(0, rows - 1), *rest), data)),
        ("a header of 10^12 rows", lying(descr, False, (10**12, *rest), data)),
        ("a header of 2^62 x 4 numbers", lying(descr, False, (2**62, 4), data)),
        ("a header of -1 rows", lying(descr, False, (-1, *rest), data)),
        ("a header of half a row", lying(descr, False, "(0.5,)", data)),
        ("a header of True rows", lying(descr, False, "(True,)", data)),
        ("a header of 10^5000 rows", lying(descr, False, f"({'9' * 5000},)", data)),
        ("a shape that is no tuple", lying(descr, False, "'many'", data)),
        ("an unknown type", lying("<q9", False, shape, data)),
        ("a type of 2^31 bytes", lying("|V2147483647", False, shape, data)),
        ("a structured type", lying([("a", "<f4")], False, shape, data)),  # type: ignore[arg-type]
        ("a header that calls", lying("<f4'+__import__('os').name+'", False, shape, data)),
        ("a header nested deeply", lying(descr, False, "(" * 2000 + ")" * 2000, data)),
        ("the other order", lying(descr, True, shape, data)),
        ("bytes behind its end", stored(array) + b"more"),
        ("a cut-off end", stored(array)[: -max(1, array.itemsize)]),
        ("no numbers", stored(array)[:20]),
        ("nothing", b""),
        ("format 3.0", stored(array, (3, 0))),
        ("format 9.9", b"\x93NUMPY\x09\x09" + stored(array)[8:]),
        ("a text instead of an array", b"hello"),
    ]
    told, made = rng.choice(choices)
    return made, told


_CHANGES: tuple[tuple[float, Callable[[random.Random, NDArray[Any]], tuple[Any, str]]], ...] = (
    (3, _type),
    (3, _shape),
    (7, _values),
    (2, _order),
    (2, _near),
    (2.5, _lie),
)


def changed(rng: random.Random, array: NDArray[Any]) -> tuple[bytes, str]:
    """The npy file of ``array`` with a change, and what that is."""
    weights, changes = zip(*_CHANGES, strict=True)
    made, told = rng.choices(changes, weights)[0](rng, array)
    return (made if isinstance(made, bytes) else stored(made)), told


def read(data: bytes) -> NDArray[Any]:
    """The array of an honest npy file."""
    array: NDArray[Any] = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    return array
