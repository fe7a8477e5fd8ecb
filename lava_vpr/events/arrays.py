"""Events in files of arrays. HDF5, by the package h5py: the layouts of DSEC, of Metavision (Prophesee), and plain
datasets; ``.npz``: a structured array with fields such as tonic's (x, y, t, p), or an array for each.

What a file refers to outside itself is not followed, and no part of it takes more memory than the limit on a chunk.
Members of an archive are read block by block, packed or not, so that none is in memory as a whole.
"""

from __future__ import annotations

import contextlib
import warnings
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief
from lava_vpr.events.stream import (
    BLOCK,
    EventRecording,
    Parts,
    Raw,
    apart,
    check_lengths,
    check_size,
    in_blocks,
    in_tables,
)
from lava_vpr.storage.arrays import ARCHIVE_ERRORS, entries_of
from lava_vpr.storage.limits import limit, within
from lava_vpr.storage.reading import open_regular
from lava_vpr.storage.text import shown

HDF5_SUFFIXES = (".h5", ".hdf5")
_TABLES = ("CD/events", "events", "EXT_CD/events")
_GROUPS = ("events", "CD", "")
_KEEP_IT = "convert it to events/t, events/x and events/y"


def is_hdf5(path: Path) -> bool:
    """Whether the HDF5 file ``path`` holds events in a layout that is known; False, too, if it cannot be opened."""
    with contextlib.suppress(InputError), _opened(path) as file:
        return _found(file, shown(path)) is not None
    return False


def open_hdf5(path: Path) -> EventRecording:
    """The events of an HDF5 file.

    Raises:
        InputError: it is damaged, holds no events, or more than the limits allow.
    """
    with _opened(path) as file:
        parts = _found(file, shown(path))
        if parts is None:
            held = ", ".join(brief(name) for name in list(file)[:10]) or "nothing"
            raise InputError(f"{shown(path)}: holds no events (at its top: {held}); {_KEEP_IT}")
        size = _size(file, parts[0][0], shown(path))
        start_s = _offset(file, shown(path))
    return EventRecording(path, lambda: _blocks(path), size, start_s)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The opened file; what goes wrong in h5py, which raises anything of a damaged file, is told in one line."""
    import h5py  # here: most commands read no HDF5, and it takes a tenth of a second

    try:
        with contextlib.suppress(ImportError):
            import hdf5plugin  # noqa: F401  # compressions that h5py lacks, where it is installed

        with h5py.File(path, "r", locking=False) as file:
            yield file
    except InputError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        why = brief(" ".join(str(error).split())[:160])
        if "filter" in why or "plugin" in why:
            raise InputError(
                f"{shown(path)}: is compressed in a way that h5py cannot read alone ({why}); install what can: "
                "pip install hdf5plugin"
            ) from None
        raise InputError(f"{shown(path)}: is damaged, cut short or no HDF5 file ({why}); copy it again") from None


def _found(file: Any, where: str) -> Parts | None:
    """The datasets of times, columns and rows; None: there are none."""
    tables = (_dataset(file, name) for name in _TABLES)
    parts = in_tables(table for table in tables if table is not None)
    for group in _GROUPS:
        parts = parts or apart(partial(lambda group, name: _dataset(file, f"{group}/{name}"), group))
    for dataset, _ in parts or ():
        _check(dataset, where)
    if parts is not None:
        check_lengths([len(dataset) for dataset, _ in parts], where)
    return parts


def _dataset(file: Any, name: str) -> Any:
    """The one-dimensional dataset of this name in the file itself, or None; links out of it are not followed."""
    import h5py

    at = file
    for part in [word for word in name.split("/") if word]:
        if not isinstance(at, h5py.Group) or not isinstance(at.get(part, getlink=True), h5py.HardLink):
            return None
        at = at[part]
    return at if isinstance(at, h5py.Dataset) and len(at.shape or ()) == 1 else None


def _check(dataset: Any, where: str) -> None:
    """Refuse what is stored elsewhere, too much, or in pieces that are too large."""
    if dataset.is_virtual or dataset.external:
        raise InputError(f"{where}: keeps {brief(dataset.name)} in other files; copy the events into one")
    name, size = brief(dataset.name), dataset.dtype.itemsize
    within("events", len(dataset), f"{where}: has")
    within("event_chunk_bytes", (dataset.chunks or (0,))[0] * size, f"{where}: stores {name} in chunks of")
    if BLOCK * size > limit("event_chunk_bytes"):
        raise InputError(f"{where}: has rows of {size} bytes in {name}; {_KEEP_IT}")


def _size(file: Any, times: Any, where: str) -> tuple[int, int] | None:
    """Width and height of the sensor, where attributes of the file, its groups or datasets tell it."""
    for holder in (times, times.parent, file):
        for names in (("width", "height"), ("sensor_width", "sensor_height")):
            # A text is not even read: from one that is damaged the HDF5 library may not return.
            if all(name in holder.attrs and _is_number(holder.attrs.get_id(name)) for name in names):
                return check_size((int(holder.attrs[names[0]]), int(holder.attrs[names[1]])), where)
    return None


def _is_number(attribute: Any) -> bool:
    """Whether an attribute is one whole number."""
    return attribute.shape == () and attribute.dtype.kind in "iu"


def _offset(file: Any, where: str) -> float:
    """Seconds to be added to the times: DSEC's ``t_offset``, in microseconds."""
    import h5py

    for name in ("t_offset", "events/t_offset"):
        offset = file.get(name) if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
        if isinstance(offset, h5py.Dataset) and offset.shape in ((), (1,)) and offset.dtype.kind in "iuf":
            value = float(np.asarray(offset[()]).reshape(-1)[0])
            if not abs(value) < 1e18:
                raise InputError(f"{where}: t_offset is {value}, no number of microseconds; correct it")
            return value / 1e6
    return 0.0


def _blocks(path: Path) -> Iterator[Raw]:
    """The events, some at a time."""
    with _opened(path) as file:
        parts = _found(file, shown(path)) or []
        yield from in_blocks(
            parts, len(parts[0][0]) if parts else 0, lambda dataset, first, count: dataset[first : first + count]
        )


NPZ_SUFFIXES = (".npz",)
_SAVE_IT = "save arrays t, x and y with numpy.savez"


class _Member(NamedTuple):
    """An array of the archive: its name in it, type and length, and where its numbers begin."""

    name: str
    dtype: np.dtype[Any]
    length: int


def is_npz(path: Path) -> bool:
    """Whether the archive ``path`` holds events; False, too, if it cannot be opened."""
    with contextlib.suppress(InputError), _opened_npz(path) as archive:
        return _found_npz(_members(archive)) is not None
    return False


def open_npz(path: Path) -> EventRecording:
    """The events of an ``.npz`` file.

    Raises:
        InputError: it is damaged, holds no events, or more than the limits allow.
    """
    with _opened_npz(path) as archive:
        members = _members(archive)
        parts = _found_npz(members)
        if parts is None:
            held = ", ".join(brief(name) for name in sorted(members)[:10]) or "nothing"
            raise InputError(f"{shown(path)}: holds no events (but {held}); {_SAVE_IT}")
        check_lengths([member.length for member, _ in parts], shown(path))
        for number, name in ((parts[0][0].length, "events"), (BLOCK * parts[0][0].dtype.itemsize, "event_chunk_bytes")):
            within(name, number, f"{shown(path)}: has")
        size = _size_npz(archive, members, shown(path))
    return EventRecording(path, lambda: _npz_blocks(path), size)


@contextlib.contextmanager
def _opened_npz(path: Path) -> Iterator[zipfile.ZipFile]:
    """The opened archive; what goes wrong in it is told in one line."""
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            yield archive
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror or error}); check it") from None
    except ARCHIVE_ERRORS as error:
        why = shown(" ".join(str(error).split())[:160])
        raise InputError(f"{shown(path)}: is damaged, cut short or no .npz file ({why}); copy it again") from None
    except MemoryError:  # of a header that is nested too deeply, too
        raise InputError(f"{shown(path)}: cannot be unpacked (MemoryError); {_SAVE_IT}") from None


def _members(archive: zipfile.ZipFile) -> dict[str, _Member]:
    """The one-dimensional arrays of plain numbers, and tables of such, by their names."""
    found = {}
    for name in [entry.filename for entry in entries_of(archive) if entry.filename.endswith(".npy")]:
        with archive.open(name) as stream:
            shape, dtype = _header(stream)
        if len(shape) == 1 and not dtype.hasobject:
            found[name[: -len(".npy")]] = _Member(name, dtype, shape[0])
    return found


def _header(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the array that begins here; no object is made of what it says."""
    version = npy.read_magic(stream)
    if version != (1, 0):  # the next has headers of up to 4 GiB
        raise ValueError(f"version {version} of .npy")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that NumPy under Python 2 wrote it, or that it is damaged so
        shape, _, dtype = npy.read_array_header_1_0(stream)
    if any(length < 0 for length in shape):
        raise ValueError(f"shape {shape}")
    return shape, dtype


def _found_npz(members: dict[str, _Member]) -> Parts | None:
    """The members with times, columns and rows; None: there are none."""
    return in_tables(members.values()) or apart(members.get)


def _size_npz(archive: zipfile.ZipFile, members: dict[str, _Member], where: str) -> tuple[int, int] | None:
    """Width and height of the sensor, if the archive has an array ``size`` of the two."""
    member = members.get("size")
    if member is None or member.length != 2 or member.dtype.kind not in "iu":
        return None
    with archive.open(member.name) as stream:
        _header(stream)
        width, height = _next(stream, member, 2).tolist()
    return check_size((width, height), where)


def _next(stream: BinaryIO | Any, member: _Member, count: int) -> NDArray[Any]:
    """The next ``count`` elements."""
    data = stream.read(count * member.dtype.itemsize)
    if len(data) < count * member.dtype.itemsize:
        raise ValueError(f"{member.name} ends early")
    return np.frombuffer(data, member.dtype)


def _npz_blocks(path: Path) -> Iterator[Raw]:
    """The events, some at a time."""
    with _opened_npz(path) as archive, contextlib.ExitStack() as stack:
        parts = _found_npz(_members(archive)) or []
        streams = {member.name: stack.enter_context(archive.open(member.name)) for member, _ in parts}
        for stream in streams.values():
            _header(stream)
        yield from in_blocks(
            parts,
            parts[0][0].length if parts else 0,
            lambda member, first, count: _next(streams[member.name], member, count),
        )
