"""Arrays of files: ``.npy`` files and archives of them, and what an array must be: type, shape, range of its values.

One reader serves containers, bundles and files of other programs. The header of a ``.npy`` file is read by a pattern,
not as Python, and held against the length of the file before memory is taken. What is read is version 1 of the format,
which `numpy.save` writes for every plain array
(https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html). numpy.lib.format (1.26) cannot take the
pattern's place: of 22,607 headers that it refuses it takes 302 (other names and orders of bytes, truth values and
comments) and answers 7,008 with errors of Python's compiler, up to a MemoryError.

Zip archives of arrays, our own and those of other programs, are read within one budget of memory: names, lengths and
methods are read from the archive's directory, and what it unpacks to is held against a limit before an entry is opened.
An entry takes the memory of its numbers once, and never more than the directory says.
"""

from __future__ import annotations

import math
import re
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lava_vpr.errors import InputError, brief, shown
from lava_vpr.storage.limits import unpacking
from lava_vpr.storage.reading import read_bytes


class UnfitError(ValueError):
    """A value of a file that is not what its format says; the message names it, `how` goes before it."""

    how = "lacks or garbles"


class UnexpectedError(UnfitError):
    """Something in a file that its format does not have."""

    how = "has"


class ArrayRule(NamedTuple):
    """What an array must be: its type, its shape, and the range of its values."""

    dtype: str
    shape: tuple[int, ...]
    least: float = 0
    most: float = math.inf


def narrow(counts: NDArray[Any]) -> NDArray[Any]:
    """Spike counts of any shape, at least 0, as uint16 where all of them fit, else as int32: long maps have many."""
    fits = int(counts.max(initial=0)) <= np.iinfo(np.uint16).max
    return counts.astype(np.uint16 if fits else np.int32, copy=False)


def check_keys(values: Mapping[str, Any], needed: Collection[str], further: Collection[str], what: str) -> None:
    """Refuse ``values`` of a file of which one is missing or unexpected.

    Args:
        values: The values by name.
        needed: Names that must be there.
        further: Names that may be there, too.
        what: An unexpected one, for a message: "array {}".
    Raises:
        UnfitError: naming the first.
    """
    for name in values:
        if name not in needed and name not in further:
            raise UnexpectedError(f"an unexpected {what.format(brief(name))}")
    for name in needed:
        if name not in values:
            raise UnfitError(brief(name))


def check_arrays(
    arrays: Mapping[str, NDArray[Any]], rules: Mapping[str, ArrayRule], optional: Collection[str] = ()
) -> None:
    """Refuse ``arrays`` that are not what ``rules`` say, or not all of them but ``optional`` ones, or more.

    Raises:
        UnfitError: naming the first, and what is wrong with it.
    """
    check_keys(arrays, [name for name in rules if name not in optional], rules, "array {}")
    for name, array in arrays.items():
        _check_array(array, name, rules[name])


def _check_array(array: NDArray[Any], name: str, rule: ArrayRule) -> None:
    """Refuse an ``array`` that is not what ``rule`` says."""
    if array.dtype != rule.dtype:
        raise UnfitError(f"{name} of type {array.dtype} instead of {rule.dtype}")
    if array.shape != rule.shape:
        raise UnfitError(f"{name} of shape {array.shape} instead of {rule.shape}")
    if array.size == 0 or (array.dtype == np.uint8 and rule.most >= 255):
        return
    with np.errstate(invalid="ignore"):  # NaN is least and most of what it is among, and fits no range
        least, most = array.min(), array.max()
    if not np.isfinite((least, most)).all():
        raise UnfitError(f"{name} with values that are not finite")
    if not (least >= rule.least and most <= rule.most):
        raise UnfitError(f"{name} with values from {least:g} to {most:g}, which must be in {rule.least}..{rule.most:g}")


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


_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""How `numpy.savez` and `numpy.savez_compressed` pack the arrays of an archive."""
ARCHIVE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    TypeError,
)
"""What zipfile and NumPy raise of a damaged archive of arrays, beside `OSError`."""
_MOST_ENTRIES = 1000
_PIECE = 1 << 18


class ArchiveLimitError(Exception):
    """An archive costs more than a limit allows; the message says what, and how the limit is raised."""


def entries_of(archive: zipfile.ZipFile, most: int = _MOST_ENTRIES) -> list[zipfile.ZipInfo]:
    """The entries of an archive, each packed as `numpy.savez` does.

    Raises:
        ValueError: one is not, or there are more than ``most``.
    """
    entries = archive.infolist()
    if len(entries) > most:
        raise ValueError(f"it has {len(entries):,} entries, more than {most:,}")
    for entry in entries:
        if entry.flag_bits & 0x1 or entry.compress_type not in _METHODS:
            raise ValueError(f"entry {brief(entry.filename)} is encrypted, or packed otherwise than numpy.savez does")
    return entries


def check_budget(entries: list[zipfile.ZipInfo], packed: int, limit_name: str) -> None:
    """Refuse entries that unpack to more than is allowed.

    Args:
        entries: The directory.
        packed: Bytes of the whole file.
        limit_name: The limit on the bytes that they unpack to.
    Raises:
        BeyondError: they do.
    """
    beyond = unpacking(limit_name, sum(entry.file_size for entry in entries), packed)
    if beyond is not None:
        raise ArchiveLimitError(f"unpacks to {beyond}")


def unpacked(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> memoryview:
    """What an entry unpacks to, writeable, in the memory that it takes: `ZipExtFile.read` takes twice as much.

    Raises:
        ValueError, zipfile.BadZipFile, zlib.error: it is damaged, or shorter than the directory says.
    """
    content, length = np.empty(entry.file_size, np.uint8).data, 0
    with archive.open(entry) as member:
        while piece := member.read(_PIECE):
            content[length : length + len(piece)] = piece
            length += len(piece)
    if length != entry.file_size:
        raise ValueError("ends early")
    return content
