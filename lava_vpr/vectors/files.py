"""Vectors in files: ``.npy``, ``.npz`` and HDF5, by their suffix; no pickle, and never more than the limits allow.

Also what a traverse of vectors holds instead of images, and the checks of an array of them.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief, said, shown
from lava_vpr.inputs.vectors import LARGEST_VALUE
from lava_vpr.positions.frames import XY, Positions
from lava_vpr.storage.arrays import (
    ARCHIVE_ERRORS,
    ArchiveLimitError,
    array_of,
    check_budget,
    entries_of,
    note_zeros,
    read_array,
    unpacked,
)
from lava_vpr.storage.reading import open_regular

REMEDY = "give one row of finite numbers for each image, as float32 (images, values)"
_BLOCK = 1 << 22
"""Numbers that are looked at together."""


class VectorSource(Protocol):
    """Vectors of one drive, by number from 0, each of as many values."""

    @property
    def values(self) -> int:
        """Values of each vector."""

    @property
    def names(self) -> tuple[str, ...] | None:
        """A name for each vector; None: nobody says."""

    def __len__(self) -> int:
        """The number of vectors."""

    def row(self, number: int) -> NDArray[np.float32]:
        """Vector ``number``, finite, float32 (values,)."""


@dataclass(frozen=True, eq=False)
class Vectors:
    """Vectors in memory, checked by `checked_vectors`.

    Attributes:
        array: One row for each image, any real type, (images, values).
        names: A name for each; None: nobody says.
        positions: Where each image was taken; None: nobody says.
        stamps: When each image was taken, in seconds, float64 (images,); None: nobody says.
    """

    array: NDArray[Any]
    names: tuple[str, ...] | None = None
    positions: Positions | None = None
    stamps: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.array)

    @property
    def values(self) -> int:
        """Values of each vector."""
        return int(self.array.shape[1])

    def row(self, number: int) -> NDArray[np.float32]:
        """Vector ``number``, float32 (values,)."""
        return np.ascontiguousarray(self.array[number], np.float32)


def checked_vectors(array: NDArray[Any], where: str, remedy: str = REMEDY) -> NDArray[Any]:
    """``array`` itself, seen to hold vectors: whole or real numbers (images, values), finite, of sizes that add up.

    Args:
        array: Vectors from wherever.
        where: What a message begins with, the file or argument.
        remedy: What a message ends with.
    Raises:
        InputError: it holds none; a row is named where one row is wrong.
    """
    if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
        raise InputError(f"{where}: holds {array.dtype}, not real numbers; {remedy}")
    if array.ndim != 2:
        raise InputError(f"{where}: has shape {array.shape}, not (images, values); {remedy}")
    if 0 in array.shape:
        raise InputError(f"{where}: is empty, of shape {array.shape}; {remedy}")
    rows = max(1, _BLOCK // array.shape[1])
    for start in range(0, len(array), rows):
        with np.errstate(invalid="ignore"):  # NaN compares as false
            fits = (np.abs(array[start : start + rows].astype(np.float64)) <= LARGEST_VALUE).all(axis=1)
        if not fits.all():
            row = start + int(np.flatnonzero(~fits)[0])
            finite = bool(np.isfinite(array[row]).all())
            cause = f"values beyond {LARGEST_VALUE:g}" if finite else "NaN or infinite values"
            raise InputError(f"{where}: row {row} holds {cause}; {'scale them' if finite else 'compute it again'}")
    return array


def load_descriptors(path: Path, n_images: int | None = None) -> NDArray[Any]:
    """Descriptors from a .npy file, one row for each image, as they are stored; they cannot be written to.

    Args:
        path: File written by ``numpy.save``: real numbers, (images, values).
        n_images: How many rows it must have, if known.
    Raises:
        InputError: it cannot be read, or holds no vectors (`checked_vectors`), or another number of rows.
    """
    remedy = "write it with numpy.save, one row of floats for each image"
    array = checked_vectors(read_array(path, remedy), shown(path), remedy)
    note_zeros(array, shown(path))
    if n_images is not None and len(array) != n_images:
        raise InputError(
            f"{shown(path)}: has {len(array)} rows for {n_images} images; give one row for each image, in their order"
        )
    return array


DESCRIPTORS = "descriptors"
BESIDE = ("names", "positions", "stamps", "frame")
"""Further arrays that a file of vectors may have, by name."""
_REMEDY = "write it with numpy.savez(file, descriptors=..., names=...)"


class StoredVectors(NamedTuple):
    """What a file holds of vectors, as far as it was understood.

    Attributes:
        array: The vectors.
        beside: The file's further arrays, by name (`BESIDE`).
    """

    array: NDArray[Any]
    beside: Mapping[str, NDArray[Any]]


def _stored(arrays: Mapping[str, NDArray[Any]], path: Path, remedy: str) -> StoredVectors:
    """The vectors among the ``arrays`` of a file: `DESCRIPTORS`, or the only one (images, values) not in `BESIDE`.

    Args:
        arrays: All that the file holds, by name.
        path: The file, for messages.
        remedy: What a message tells to do.
    Raises:
        InputError: there are none, or nothing says which they are.
    """
    beside = {key: arrays[key] for key in BESIDE if key in arrays}
    named = arrays.keys() & {DESCRIPTORS}
    found = [*named] or [name for name, array in arrays.items() if array.ndim == 2 and name not in BESIDE]
    if len(found) == 1:
        return StoredVectors(arrays[found[0]], beside)
    cause = f"{len(found)} arrays (images, values)" if found else f"no array (images, values) among {brief([*arrays])}"
    raise InputError(f"{shown(path)}: has {cause}; name the one with the vectors {DESCRIPTORS!r}, or {remedy}")


def read_npz(path: Path) -> StoredVectors:
    """The vectors in an archive that `numpy.savez` wrote, and its further arrays (`BESIDE`).

    Raises:
        InputError: it cannot be read, is damaged, unpacks to more than the limit ``array_bytes``, holds pickled objects
            or no vectors.
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            arrays = _arrays(archive, os.fstat(file.fileno()).st_size, path)
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror or error}); {_REMEDY}") from None
    except ArchiveLimitError as error:
        raise InputError(f"{shown(path)}: {error}") from None
    except ARCHIVE_ERRORS as error:
        raise InputError(f"{shown(path)}: is no sound .npz archive ({said(error)}); {_REMEDY}") from None
    return _stored(arrays, path, _REMEDY)


def _arrays(archive: zipfile.ZipFile, packed: int, path: Path) -> dict[str, NDArray[Any]]:
    """Every array of numbers or texts in ``archive``, a file of ``packed`` bytes, by its name."""
    entries = entries_of(archive)
    check_budget(entries, packed, "array_bytes")
    arrays: dict[str, NDArray[Any]] = {}
    for entry in entries:
        name = entry.filename.removesuffix(".npy")
        try:
            arrays[name] = array_of(unpacked(archive, entry), texts=name in BESIDE)
        except ValueError as error:
            raise InputError(f"{shown(path)}: {brief(name)} {error}; {_REMEDY}") from None
    return arrays


_LONGEST_NAME = 1024


def _hdf5(path: Path) -> StoredVectors:
    """What stands at the top of an HDF5 file; groups are left alone."""
    from lava_vpr.storage import hdf5  # h5py takes a tenth of a second: who has no such file does not wait for it

    held = hdf5.read(path, "file of vectors", "array_bytes", "array_bytes")
    arrays = {name: np.asarray(value) for name, value in held.items() if not isinstance(value, dict)}
    texts = {name: array.astype(str) for name, array in arrays.items() if array.dtype == object}
    return _stored(arrays | texts, path, "write one matrix at the top of the file")


READERS: dict[str, Callable[[Path], StoredVectors]] = {
    ".npy": lambda path: StoredVectors(read_array(path, REMEDY), {}),
    ".npz": read_npz,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
}
"""What reads a file, by its suffix."""
VECTOR_SUFFIXES = tuple(READERS)


def read_vectors(path: Path) -> Vectors:
    """The vectors in a file, with its further arrays.

    Args:
        path: ``.npy``: the vectors alone, as `numpy.save` writes them. ``.npz``, as `numpy.savez` writes it: the array
            ``descriptors``, or the only one that is (images, values); beside it ``names``, a text for each;
            ``positions`` (images, 2), in the frame that ``frame`` names (`lava_vpr.positions.frames`), metres without;
            ``stamps``, in seconds. ``.h5`` or ``.hdf5``: datasets of these names at the top of the file.
    Raises:
        InputError: it cannot be read, is larger than the limit ``array_bytes``, holds no vectors, or a further array
            does not fit them.
    """
    stored = READERS[path.suffix.lower()](path)
    array = checked_vectors(stored.array, shown(path))
    note_zeros(array, shown(path))
    n = len(array)
    return Vectors(
        array,
        _names(stored.beside.get("names"), n, path),
        _positions(stored.beside.get("positions"), stored.beside.get("frame"), n, path),
        _stamps(stored.beside.get("stamps"), n, path),
    )


def _names(array: NDArray[Any] | None, n: int, path: Path) -> tuple[str, ...] | None:
    """A name for each vector, if there are names."""
    if array is None:
        return None
    names = tuple(str(name) for name in array.ravel()) if array.dtype.kind == "U" else ()
    if array.ndim != 1 or len(names) != n:
        raise InputError(
            f"{shown(path)}: has names of type {array.dtype} and shape {array.shape} for {n} vectors; give a text each"
        )
    for number, name in enumerate(names):
        if not name or len(name) > _LONGEST_NAME or "\0" in name:
            raise InputError(f"{shown(path)}: name {number} is {brief(name)}; give each vector a name in one line")
    return names


def _positions(array: NDArray[Any] | None, frame: NDArray[Any] | None, n: int, path: Path) -> Positions | None:
    """Where each image was taken, if there are positions."""
    if array is None:
        if frame is not None:
            raise InputError(f"{shown(path)}: has a frame, but no positions; add them, or leave it out")
        return None
    if array.shape[:1] != (n,):
        raise InputError(f"{shown(path)}: positions are of shape {array.shape} for {n} vectors; give one for each")
    name = XY if frame is None else str(frame.ravel()[0]) if frame.size == 1 and frame.dtype.kind == "U" else ""
    try:
        return Positions(array, name)
    except InputError as error:
        raise InputError(f"{shown(path)}: {error}") from None


def _stamps(array: NDArray[Any] | None, n: int, path: Path) -> NDArray[np.float64] | None:
    """When each image was taken, if there are times."""
    if array is None:
        return None
    if array.shape != (n,) or array.dtype.kind not in "fiu" or not np.isfinite(array.astype(np.float64)).all():
        raise InputError(
            f"{shown(path)}: has stamps of type {array.dtype} and shape {array.shape} for {n} vectors; give a finite "
            "number of seconds each"
        )
    return array.astype(np.float64)
