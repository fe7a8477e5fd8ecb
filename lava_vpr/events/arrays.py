"""Events in files of arrays. HDF5, by the package h5py: the layouts of DSEC, of Metavision (Prophesee), and plain
datasets; ``.npz``: a structured array with fields such as tonic's (x, y, t, p), or an array for each.

Links to other files are not followed, and no part takes more memory than the limit on a chunk. Members of an archive
are read block by block, packed or not, so that none is in memory as a whole.
"""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, brief, said, shown
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
from lava_vpr.storage.arrays import (
    ARCHIVE_ERRORS,
    NPY_BEGIN,
    array_header,
    entries_of,
    header_length,
)
from lava_vpr.storage.limits import limit, within
from lava_vpr.storage.reading import open_regular

HDF5_SUFFIXES = (".h5", ".hdf5")
_TABLES = ("CD/events", "events", "EXT_CD/events")
_GROUPS = ("events", "CD", "")
_KEEP_IT = "convert it to events/t, events/x and events/y"


class Holder(NamedTuple):
    """An opened file of arrays.

    Attributes:
        names: The names of its arrays, for a message.
        parts: Finds the arrays of times, columns and rows; None: there are none.
        size: Width and height of the sensor, if the file gives them.
        start_s: Seconds to add to the times.
        take: Returns so many elements of an array from an index on; calls go through the array in order.
        remedy: The remedy for a file without events.
    """

    names: Callable[[], str]
    parts: Callable[[], Parts | None]
    size: Callable[[Parts], tuple[int, int] | None]
    start_s: Callable[[], float]
    take: Callable[[Any, int, int], Any]
    remedy: str


Opened = Callable[[Path], AbstractContextManager[Holder]]


def holds(opened: Opened, path: Path) -> bool:
    """Whether the file ``path`` holds events in a known layout; also False if it cannot be opened."""
    with contextlib.suppress(InputError), opened(path) as file:
        return file.parts() is not None
    return False


def open_arrays(opened: Opened, path: Path) -> EventRecording:
    """The events of a file of arrays.

    Raises:
        InputError: it is damaged, has no events, or exceeds a limit.
    """
    with opened(path) as file:
        parts = file.parts()
        if parts is None:
            raise InputError(f"{shown(path)}: holds no events ({file.names()}); {file.remedy}")
        return EventRecording(path, lambda: _blocks(opened, path), file.size(parts), file.start_s())


def _blocks(opened: Opened, path: Path) -> Iterator[Raw]:
    """The events, block by block."""
    with opened(path) as file:
        parts = file.parts() or []
        yield from in_blocks(parts, len(parts[0][0]) if parts else 0, file.take)


@contextlib.contextmanager
def hdf5(path: Path) -> Iterator[Holder]:
    """An opened HDF5 file; errors of h5py, which can be of any type for a damaged file, are reported in one line."""
    import h5py  # here: most commands read no HDF5, and it takes a tenth of a second

    try:
        with contextlib.suppress(ImportError):
            import hdf5plugin  # noqa: F401  # compressions that h5py lacks, where it is installed

        with h5py.File(path, "r", locking=False) as file:
            yield Holder(
                lambda: "at its top: " + (", ".join(brief(name) for name in list(file)[:10]) or "nothing"),
                partial(_found, file, shown(path)),
                partial(_size, file, shown(path)),
                partial(_offset, file, shown(path)),
                lambda dataset, first, count: dataset[first : first + count],
                _KEEP_IT,
            )
    except InputError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        why = said(error)
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
    """Refuse arrays that are stored in other files, exceed a limit, or have chunks that are too large."""
    if dataset.is_virtual or dataset.external:
        raise InputError(f"{where}: keeps {brief(dataset.name)} in other files; copy the events into one")
    name, size = brief(dataset.name), dataset.dtype.itemsize
    within("events", len(dataset), f"{where}: has")
    within("event_chunk_bytes", (dataset.chunks or (0,))[0] * size, f"{where}: stores {name} in chunks of")
    if BLOCK * size > limit("event_chunk_bytes"):
        raise InputError(f"{where}: has rows of {size} bytes in {name}; {_KEEP_IT}")


def _size(file: Any, where: str, parts: Parts) -> tuple[int, int] | None:
    """Width and height of the sensor, if attributes of the file, its groups or datasets give them."""
    times = parts[0][0]
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
    """Seconds to add to the times, from DSEC's ``t_offset`` in microseconds."""
    import h5py

    for name in ("t_offset", "events/t_offset"):
        offset = file.get(name) if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
        if isinstance(offset, h5py.Dataset) and offset.shape in ((), (1,)) and offset.dtype.kind in "iuf":
            value = float(np.asarray(offset[()]).reshape(-1)[0])
            if not abs(value) < 1e18:
                raise InputError(f"{where}: t_offset is {value}, no number of microseconds; correct it")
            return value / 1e6
    return 0.0


NPZ_SUFFIXES = (".npz",)
_SAVE_IT = "save arrays t, x and y with numpy.savez"


@dataclass(frozen=True)
class _Member:
    """An array of the archive: its name in it, type and length."""

    name: str
    dtype: np.dtype[Any]
    length: int

    def __len__(self) -> int:
        return self.length


@contextlib.contextmanager
def npz(path: Path) -> Iterator[Holder]:
    """An opened ``.npz`` file; an error in it is reported in one line."""
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive, contextlib.ExitStack() as stack:
            members = _members(archive)
            streams: dict[str, Any] = {}

            def take(member: _Member, first: int, count: int) -> NDArray[Any]:
                if member.name not in streams:
                    streams[member.name] = stack.enter_context(archive.open(member.name))
                    streams[member.name].read(header_length(streams[member.name].read(NPY_BEGIN)) - NPY_BEGIN)
                return _next(streams[member.name], member, count)

            yield Holder(
                lambda: "but " + (", ".join(brief(name) for name in sorted(members)[:10]) or "nothing"),
                lambda: in_tables(members.values()) or apart(members.get),
                partial(_size_npz, members, take, shown(path)),
                lambda: 0.0,
                take,
                _SAVE_IT,
            )
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror or error}); check it") from None
    except ARCHIVE_ERRORS as error:
        raise InputError(
            f"{shown(path)}: is damaged, cut short or no .npz file ({said(error)}); copy it again"
        ) from None
    except MemoryError:
        raise InputError(f"{shown(path)}: cannot be unpacked (MemoryError); {_SAVE_IT}") from None


def _members(archive: zipfile.ZipFile) -> dict[str, _Member]:
    """The one-dimensional arrays of plain numbers, and tables of them, by name."""
    found = {}
    for entry in entries_of(archive):
        name, suffix = entry.filename[:-4], entry.filename[-4:]
        if suffix != ".npy":
            continue
        with archive.open(entry) as stream:
            begin = stream.read(NPY_BEGIN)
            length = header_length(begin)
            try:
                header = array_header(begin + stream.read(length - len(begin)))
            except ValueError:  # a kind of table that holds no events here; whole, or its checksum says otherwise
                while stream.read(BLOCK):
                    pass
                continue
        if len(header.shape) == 1 and header.dtype is not None:
            member = _Member(entry.filename, header.dtype, header.shape[0])
            if entry.file_size != length + member.length * member.dtype.itemsize:
                raise ValueError(f"{name} is not as long as its header says")
            found[name] = member
    return found


def _size_npz(
    members: dict[str, _Member], take: Callable[[_Member, int, int], NDArray[Any]], where: str, parts: Parts
) -> tuple[int, int] | None:
    """Width and height of the sensor, if the archive has an array ``size`` of two numbers within limits."""
    check_lengths([len(member) for member, _ in parts], where)
    for number, name in ((len(parts[0][0]), "events"), (BLOCK * parts[0][0].dtype.itemsize, "event_chunk_bytes")):
        within(name, number, f"{where}: has")
    member = members.get("size")
    if member is None or len(member) != 2 or member.dtype.kind not in "iu":
        return None
    width, height = take(member, 0, 2).tolist()
    return check_size((width, height), where)


def _next(stream: BinaryIO | Any, member: _Member, count: int) -> NDArray[Any]:
    """The next ``count`` elements."""
    data = stream.read(count * member.dtype.itemsize)
    if len(data) < count * member.dtype.itemsize:
        raise ValueError(f"{member.name} ends early")
    return np.frombuffer(data, member.dtype)
