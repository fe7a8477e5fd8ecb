"""Arrays of files: ``.npy`` files and archives of them, and what an array must be: type, shape, range of its values.

One reader serves containers, bundles and files of other programs. The header of a ``.npy`` file is read by a pattern,
not as Python, and checked by the length of the file before memory is taken. What is read is version 1 of the format,
which `numpy.save` writes for every plain array
(https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html). numpy.lib.format (1.26) cannot take the
pattern's place: of 22,607 headers that it refuses it takes 302 (other names and orders of bytes, truth values and
comments) and answers 7,008 with errors of Python's compiler, up to a MemoryError.

Zip archives of arrays, our own and those of other programs, are read within one budget of memory: names, lengths and
methods are read from the archive's directory, and the size that it unpacks to must be within a limit before an entry is
opened. An entry takes the memory of its numbers once, and never more than the directory says.
"""

from __future__ import annotations

import io
import logging
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import DTypeLike, NDArray

from lava_vpr.errors import InputError, brief, shown
from lava_vpr.storage.limits import unpacking
from lava_vpr.storage.reading import read_bytes


class UnfitError(ValueError):
    """A value of a file that is not what its format says; the message names it, `how` goes before it."""

    how = "has no valid"


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


_NOTES = logging.getLogger("lava_vpr")
_MAGIC = b"\x93NUMPY\x01\x00"
NPY_BEGIN = len(_MAGIC) + 2
"""Bytes of a ``.npy`` file that tell how long its header is."""
_NO_ARRAY = "is no array of numbers (it does not begin as numpy.save would write it)"
_HEADER = re.compile(
    rb"\{ ?'descr': ?(?:'([^']{1,8})'|\[([^\[\]{}]{1,8000})\]), ?'fortran_order': ?(True|False), "
    rb"?'shape': ?\(([0-9L, ]{0,120})\),? ?\} *\n?"
)
_TYPE = re.compile(r"[<>|][biufcmMSUV]\d{1,4}")
_FIELD = re.compile(rf"\('([^'\\]{{0,64}})', '({_TYPE.pattern})'(?:, \((\d{{1,4}}),\))?\)(?:, |$)")
"""A field of a table of numbers: name, type, and how many of it there are in a row if more than one."""
_MOST_AXES, _LONGEST_AXIS = 32, 10**12

Shape = tuple[int | str, ...]
"""The length of each axis, or what it counts if any will do."""


class ArrayHeader(NamedTuple):
    """What a ``.npy`` file says of its array.

    Attributes:
        kind: The type, as NumPy writes it; of a table, whose rows have fields, those.
        shape: The length of each axis.
        order: C or F.
    """

    kind: str | list[tuple[str, str] | tuple[str, str, int]]
    shape: tuple[int, ...]
    order: Literal["C", "F"]

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """The type, of a table, too; None: one that is no number or text of fixed length."""
        if isinstance(self.kind, str) and not _TYPE.fullmatch(self.kind):
            return None
        try:
            return npy.descr_to_dtype(self.kind)
        except (TypeError, ValueError):  # numbers of seven bytes, a field twice
            return None


def npy_begin(shape: tuple[int, ...], kind: DTypeLike) -> bytes:
    """What stands before the numbers of a ``.npy`` file that is written piece by piece, in the order C."""
    begin = io.BytesIO()
    described = {"descr": npy.dtype_to_descr(np.dtype(kind)), "fortran_order": False, "shape": shape}
    npy.write_array_header_1_0(begin, described)
    return begin.getvalue()


def header_length(begin: bytes | memoryview) -> int:
    """Bytes before the numbers of a ``.npy`` file, of which `NPY_BEGIN` are given.

    Raises:
        ValueError: it does not begin as one.
    """
    if bytes(begin[: len(_MAGIC)]) != _MAGIC:
        raise ValueError(_NO_ARRAY)
    return NPY_BEGIN + int.from_bytes(begin[len(_MAGIC) : NPY_BEGIN], "little")


def array_header(head: bytes | memoryview) -> ArrayHeader:
    """What is said in the ``head`` of a ``.npy`` file, all that stands before the numbers.

    Raises:
        ValueError: no array that `numpy.save` would write.
    """
    found = _HEADER.fullmatch(head[NPY_BEGIN:])
    if found is None:
        raise ValueError(_NO_ARRAY)
    sizes = tuple(int(size.rstrip(b"L")) for size in found[4].split(b",") if size.strip())  # 3L: of Python 2
    if len(sizes) > _MOST_AXES or max(sizes, default=0) > _LONGEST_AXIS:
        raise ValueError(f"is no array of numbers (its header says {brief(sizes)})")
    order: Literal["C", "F"] = "F" if found[3] == b"True" else "C"
    if found[1] is not None:
        return ArrayHeader(found[1].decode("latin-1"), sizes, order)
    text, fields, at = found[2].decode("latin-1"), [], 0
    while at < len(text):
        field = _FIELD.match(text, at)
        if field is None:
            raise ValueError(_NO_ARRAY)
        fields.append((field[1], field[2]) if field[3] is None else (field[1], field[2], int(field[3])))
        at = field.end()
    return ArrayHeader(fields, sizes, order)


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
    end = header_length(data[:NPY_BEGIN])
    header = array_header(data[:end])
    found, sizes = _type(header, "biufU" if texts else "biuf"), header.shape
    if len(data) - end != math.prod(sizes) * found.itemsize:
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
    array = np.frombuffer(data, found, offset=end).reshape(sizes, order=header.order)
    return array if array.flags.aligned else array.copy()


def _type(header: ArrayHeader, kinds: str) -> np.dtype[Any]:
    """The type of an array, if it is of one of ``kinds``, as NumPy calls them, and in our order of bytes."""
    if header.kind == "|O":
        raise ValueError("is no array of numbers (but of pickled objects)")
    found = header.dtype
    if found is None or found.kind not in kinds or not found.isnative:
        raise ValueError(f"is no array of numbers (but of {brief(header.kind)}; whole, real and truth values are read)")
    return found


def zeros_at_end(array: NDArray[Any], before: int = 0) -> int:
    """How many of the last rows of an ``array`` (rows, ...) are 0; ``before``: of the rows that stand before it."""
    rows = np.flatnonzero(array.any(axis=tuple(range(1, array.ndim))))
    return len(array) - 1 - int(rows[-1]) if len(rows) else before + len(array)


def note_zeros(array: NDArray[Any], where: str) -> None:
    """Warn of an ``array`` (rows, ...) of a file whose end holds nothing but zeros: as if the file had been cut.

    One last number that is 0 is nothing strange.
    """
    if array.size == 0 or array.ndim == 0 or array[-1].any():
        return
    zeros = zeros_at_end(array)
    if zeros > (array.ndim == 1):
        what = "rows are" if zeros > 1 else "row is"
        _NOTES.warning(f"{where}: the last {zeros} {what} 0; if they should not be, write the file again")


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
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
    TypeError,
)
"""What zipfile and NumPy raise of a damaged archive of arrays, beside `OSError`."""
_MOST_ENTRIES = 1000
_PIECE = 1 << 18


class ArchiveLimitError(Exception):
    """An archive costs more than a limit allows; the message says what, and how the limit is raised."""


def entries_of(archive: zipfile.ZipFile, most: int = _MOST_ENTRIES) -> list[zipfile.ZipInfo]:
    """The entries of an archive, each packed as `numpy.savez` does and named once.

    Raises:
        ValueError: one is not, or there are more than ``most``.
    """
    entries, seen = archive.infolist(), set()
    if len(entries) > most:
        raise ValueError(f"it has {len(entries):,} entries, more than {most:,}")
    for entry in entries:
        name = entry.filename.removesuffix(".npy")
        if name in seen:
            raise ValueError(f"it has a second entry {brief(entry.filename)}")
        seen.add(name)
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
