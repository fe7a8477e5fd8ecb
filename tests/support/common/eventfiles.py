"""Files of events, written plainly: AEDAT4 byte by byte, HDF5 and npz in the layouts of the field; read, or refused.

Used by cli, events, storage, support and vectors.
"""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.events.files import open_events, windows_of
from lava_vpr.inputs.windows import EventsConfig

MAGIC = b"#!AER-DAT4.0\r\n"
EVENT = struct.Struct("<qhh?3x")


class Made(NamedTuple):
    """Events: microseconds, column, row and sign, each (n,), of a sensor of some width and height."""

    t: NDArray[np.int64]
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    p: NDArray[np.bool_]
    size: tuple[int, int] = (24, 16)


def made(count: int = 3000, seconds: float = 3.0, seed: int = 0, size: tuple[int, int] = (24, 16)) -> Made:
    """Random events in the order of their times, from 0 on."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, round(seconds * 1e6), count))
    t[0] = 0
    return Made(t, rng.integers(0, size[0], count), rng.integers(0, size[1], count), rng.random(count) < 0.5, size)


def described(size: tuple[int, int], streams: str = "") -> str:
    """The description in XML of a file whose stream 0 has events."""
    width, height = size
    return (
        '<dv version="2.0"><node name="outInfo" path="/outInfo/">'
        '<node name="0" path="/outInfo/0/"><attr key="typeIdentifier" type="string">EVTS</attr>'
        f'<node name="info" path="/outInfo/0/info/"><attr key="sizeX" type="int">{width}</attr>'
        f'<attr key="sizeY" type="int">{height}</attr></node></node>{streams}</node></dv>'
    )


def header(text: str, packing: int = 0, end: int = -1) -> bytes:
    """What stands before the packets: a flatbuffer with the packing, where packets end, and the description."""
    encoded = text.encode()
    names = struct.pack("<HHHHH2x", 10, 20, 4, 8, 16)  # lengths of this list and of the table; where its fields are
    table = struct.pack("<iiqI", 16, packing, end, 4)
    whole = struct.pack("<I4s", 24, b"IOHE") + names + bytes(4) + table
    whole += struct.pack("<I", len(encoded)) + encoded + b"\0"
    return MAGIC + struct.pack("<I", len(whole)) + whole


def packet(events: Made) -> bytes:
    """The flatbuffer of some events, its length before it."""
    names = struct.pack("<HHH2x", 6, 8, 4)
    whole = struct.pack("<I4s", 16, b"EVTS") + names + struct.pack("<iI", 8, 8) + bytes(4)
    rows = zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True)
    whole += struct.pack("<I", len(events.t)) + b"".join(EVENT.pack(*row) for row in rows)
    return struct.pack("<I", len(whole)) + whole


def packed(data: bytes, packing: int) -> bytes:
    """A packet as a file with this packing holds it: 0 plain, 1 and 2 LZ4, 3 and 4 Zstandard."""
    if packing == 0:
        return data
    if packing in (1, 2):
        import lz4.frame

        return bytes(lz4.frame.compress(data))
    try:
        from compression import zstd
    except ImportError:
        from backports import zstd
    return bytes(zstd.compress(data))


def aedat4(path: Path, events: Made, packing: int = 1, every: int = 500, streams: str = "") -> Path:
    """Write an AEDAT4 file, so many events a packet."""
    parts = []
    for first in range(0, len(events.t), every):
        some = Made(*(values[first : first + every] for values in events[:4]), events.size)
        data = packed(packet(some), packing)
        parts.append(struct.pack("<iI", 0, len(data)) + data)
    path.write_bytes(header(described(events.size, streams), packing) + b"".join(parts))
    return path


def dsec(path: Path, events: Made, offset: int = 0) -> Path:
    """Write HDF5 as DSEC lays it out."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, kind in (("t", "<u4"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")):
            file.create_dataset(
                f"events/{name}", data=getattr(events, name).astype(kind), chunks=True, compression="lzf"
            )
        file["t_offset"] = np.int64(offset)
        file["ms_to_idx"] = np.searchsorted(events.t, np.arange(0, int(events.t[-1]) // 1000 + 1) * 1000)
        file.attrs["width"], file.attrs["height"] = events.size
    return path


def table_of(events: Made, parts: list[tuple[str, str]]) -> NDArray[Any]:
    """A structured array of ``parts``: name and type."""
    return np.rec.fromarrays([getattr(events, name) for name, _ in parts], dtype=parts).view(np.ndarray)


def metavision(path: Path, events: Made) -> Path:
    """Write HDF5 with the table CD/events, as Metavision's tools do, packed in no way of their own."""
    import h5py

    with h5py.File(path, "w") as file:
        file["CD/events"] = table_of(events, [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    return path


def plain(path: Path, events: Made) -> Path:
    """Write HDF5 with datasets at its top, times in seconds."""
    import h5py

    with h5py.File(path, "w") as file:
        file["timestamps"], file["xs"], file["ys"] = events.t / 1e6, events.x, events.y
    return path


def tonic(path: Path, events: Made) -> Path:
    """Write an npz with a structured array of tonic's type."""
    table = table_of(events, [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "?")])
    np.savez_compressed(path, events=table, size=np.array(events.size))
    return path


def apart(path: Path, events: Made) -> Path:
    """Write an npz with an array for each part."""
    np.savez(path, t=events.t, x=events.x, y=events.y, p=events.p)
    return path


WRITERS: dict[str, tuple[str, Callable[..., Path]]] = {
    "aedat4": (".aedat4", aedat4),
    "dsec": (".h5", dsec),
    "metavision": (".hdf5", metavision),
    "plain": (".h5", plain),
    "tonic": (".npz", tonic),
    "apart": (".npz", apart),
}
"""The end of the name and the writer of each kind of file."""


def written(kind: str, folder: Path, events: Made, **options: Any) -> Path:
    """Write events to a new file of a kind."""
    end, write = WRITERS[kind]
    return write(folder / f"{kind}{end}", events, **options)


def repacked(path: Path, method: int) -> Path:
    """Pack the archive ``path`` by another of zipfile's methods."""
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


HEAD = 16
"""Bytes of the head of a collection of texts, and of each text in it."""


def damage(path: Path, text: int, length: int) -> Path:
    """Damage an HDF5 file so that the HDF5 library never returns from reading its texts of variable length.

    Let text ``text`` of the first collection in a file tell another ``length``; texts have at most 8 bytes.
    """
    data = bytearray(path.read_bytes())
    at = data.index(b"GCOL") + HEAD + text * (HEAD + 8)
    struct.pack_into("<Q", data, at + 8, length)
    path.write_bytes(data)
    return path


def read(path: Path) -> Made:
    """All events of a file, without their signs."""
    recording = open_events(path)
    parts = list(recording.events())
    t, x, y = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "x", "y"))
    return Made(t, x, y, np.zeros(len(t), np.bool_), recording.size or (0, 0))


def refused(path: Path, *words: str) -> None:
    """Opening and reading the file ends in one line with these words."""
    with pytest.raises(InputError) as caught:
        list(windows_of(path, EventsConfig(window_ms=100), 0.1)())
    told = str(caught.value)
    assert "\n" not in told
    assert all(word in told for word in (path.name, *words)), told
