"""Reads vectors from ``.npz`` archives, without pickle, and never more than the limits allow."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.storage.archives import ARCHIVE_ERRORS, ArchiveLimitError, check_budget, entries_of, unpacked
from lava_vpr.storage.npy import array_of
from lava_vpr.storage.reading import open_regular
from lava_vpr.storage.text import shown

DESCRIPTORS = "descriptors"
BESIDE = ("names", "positions", "stamps", "frame")
"""What may stand beside vectors, by its name."""
_REMEDY = "write it with numpy.savez(file, descriptors=..., names=...)"


def chosen(shapes: Mapping[str, tuple[int, ...]], path: Path, remedy: str) -> str:
    """The name of the array that holds the vectors: `DESCRIPTORS`, or the only one (images, values) not in `BESIDE`.

    Args:
        shapes: The shape of each array in the file.
        path: The file, for messages.
        remedy: What a message tells to do.
    Raises:
        InputError: there is none, or nothing says which it is.
    """
    if DESCRIPTORS in shapes:
        return DESCRIPTORS
    found = [name for name, shape in shapes.items() if len(shape) == 2 and name not in BESIDE]
    if len(found) == 1:
        return found[0]
    cause = f"{len(found)} arrays (images, values)" if found else f"no array (images, values) among {brief([*shapes])}"
    raise InputError(f"{shown(path)}: has {cause}; name the one with the vectors {DESCRIPTORS!r}, or {remedy}")


def read_npz(path: Path) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
    """The vectors in an archive that `numpy.savez` wrote, and what stands beside them (`BESIDE`).

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
        raise InputError(f"{shown(path)}: is no sound .npz archive ({_cause(error)}); {_REMEDY}") from None
    name = chosen({name: array.shape for name, array in arrays.items()}, path, _REMEDY)
    return arrays[name], {key: arrays[key] for key in BESIDE if key in arrays}


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


def _cause(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
