"""Events in ``.npz`` files: a structured array with fields such as tonic's (x, y, t, p), or an array for each.

Members are read from the archive block by block, packed or not, so that none is in memory as a whole.
"""

from __future__ import annotations

import contextlib
import warnings
import zipfile
from collections.abc import Iterator
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
from lava_vpr.storage.limits import within
from lava_vpr.storage.reading import open_regular
from lava_vpr.storage.text import shown

NPZ_SUFFIXES = (".npz",)
_KEEP_IT = "save arrays t, x and y with numpy.savez"


class _Member(NamedTuple):
    """An array of the archive: its name in it, type and length, and where its numbers begin."""

    name: str
    dtype: np.dtype[Any]
    length: int


def is_npz(path: Path) -> bool:
    """Whether the archive ``path`` holds events; False, too, if it cannot be opened."""
    with contextlib.suppress(InputError), _opened(path) as archive:
        return _found(_members(archive)) is not None
    return False


def open_npz(path: Path) -> EventRecording:
    """The events of an ``.npz`` file.

    Raises:
        InputError: it is damaged, holds no events, or more than the limits allow.
    """
    with _opened(path) as archive:
        members = _members(archive)
        parts = _found(members)
        if parts is None:
            held = ", ".join(brief(name) for name in sorted(members)[:10]) or "nothing"
            raise InputError(f"{shown(path)}: holds no events (but {held}); {_KEEP_IT}")
        check_lengths([member.length for member, _ in parts], shown(path))
        for number, name in ((parts[0][0].length, "events"), (BLOCK * parts[0][0].dtype.itemsize, "event_chunk_bytes")):
            within(name, number, f"{shown(path)}: has")
        size = _size(archive, members, shown(path))
    return EventRecording(path, lambda: _blocks(path), size)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
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
        raise InputError(f"{shown(path)}: cannot be unpacked (MemoryError); {_KEEP_IT}") from None


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


def _found(members: dict[str, _Member]) -> Parts | None:
    """The members with times, columns and rows; None: there are none."""
    return in_tables(members.values()) or apart(members.get)


def _size(archive: zipfile.ZipFile, members: dict[str, _Member], where: str) -> tuple[int, int] | None:
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


def _blocks(path: Path) -> Iterator[Raw]:
    """The events, some at a time."""
    with _opened(path) as archive, contextlib.ExitStack() as stack:
        parts = _found(_members(archive)) or []
        streams = {member.name: stack.enter_context(archive.open(member.name)) for member, _ in parts}
        for stream in streams.values():
            _header(stream)
        yield from in_blocks(
            parts,
            parts[0][0].length if parts else 0,
            lambda member, first, count: _next(streams[member.name], member, count),
        )
