"""Files of events: every format gives the same events; what is damaged, foreign or too much is told in one line."""

from __future__ import annotations

import contextlib
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.common import children
from support.common.eventfiles import (
    WRITERS,
    Made,
    aedat4,
    apart,
    damage,
    described,
    dsec,
    header,
    made,
    packet,
    read,
    refused,
    tonic,
    written,
)

from lava_vpr.errors import InputError
from lava_vpr.events.camera import WRITTEN, Sent, write_events
from lava_vpr.events.files import is_events, open_events, windows_of
from lava_vpr.events.stream import BLOCK
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.traverse import open_traverse

EVENTS = made()


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_gives_the_same_events(kind: str, tmp_path: Path) -> None:
    path = written(kind, tmp_path, EVENTS)
    assert is_events(path)
    found = read(path)
    for name in ("t", "x", "y"):
        np.testing.assert_array_equal(getattr(found, name), getattr(EVENTS, name))
    assert found.size == (EVENTS.size if kind in ("aedat4", "dsec", "tonic") else (0, 0))


@pytest.mark.parametrize("packing", range(5))
def test_aedat4_is_read_as_the_package_aedat_reads_it(packing: int, tmp_path: Path) -> None:
    aedat = pytest.importorskip("aedat")
    path = aedat4(tmp_path / "a.aedat4", EVENTS, packing)
    packets = [one["events"] for one in aedat.Decoder(path)]
    found = read(path)
    for name in ("t", "x", "y"):
        np.testing.assert_array_equal(getattr(found, name), np.concatenate([one[name] for one in packets]))
    assert len(packets) == 6


def test_other_streams_of_an_aedat4_are_passed_over(tmp_path: Path) -> None:
    other = '<node name="1"><attr key="typeIdentifier" type="string">IMUS</attr></node>'
    path = aedat4(tmp_path / "a.aedat4", EVENTS, 0, streams=other)
    path.write_bytes(path.read_bytes() + struct.pack("<iI", 1, 5) + b"other")
    np.testing.assert_array_equal(read(path).t, EVENTS.t)


def test_a_packet_of_a_stream_that_is_not_described_is_refused(tmp_path: Path) -> None:
    """A turned bit would take its events away."""
    path = aedat4(tmp_path / "a.aedat4", EVENTS, 0)
    path.write_bytes(path.read_bytes() + struct.pack("<iI", 1, 5) + b"other")
    refused(path, "a packet of stream 1, which its description does not name")


def test_a_packet_without_a_list_or_with_a_shorter_one_is_refused(tmp_path: Path) -> None:
    path = aedat4(tmp_path / "a.aedat4", EVENTS, 0)
    data = path.read_bytes()
    table = data.rindex(b"EVTS") + 8  # of the last packet
    for at, lost in ((table, b"\0\0"), (data.index(b"\xf4\1\0\0", table), b"\0\0\0\0")):
        path.write_bytes(data[:at] + lost + data[at + len(lost) :])
        refused(path, "bytes that tells 0 events")


def test_more_than_a_block_is_read_in_pieces(tmp_path: Path) -> None:
    many = made(2 * BLOCK + 7)
    for kind in ("dsec", "tonic", "apart", "metavision"):
        path = written(kind, tmp_path, many)
        assert [len(part.t) for part in open_events(path).events()] == [BLOCK, BLOCK, 7]
        np.testing.assert_array_equal(read(path).x, many.x)


@pytest.mark.parametrize("end", WRITTEN)
def test_what_is_written_is_read_and_equal_events_are_equal_bytes(end: str, tmp_path: Path) -> None:
    parts = [
        Sent(EVENTS.t[k : k + 700], EVENTS.x[k : k + 700].astype(np.uint16), EVENTS.y[k : k + 700].astype(np.uint16),
             EVENTS.p[k : k + 700])
        for k in range(0, 3000, 700)
    ]  # fmt: skip
    for name in ("a", "b"):
        assert write_events(tmp_path / f"{name}{end}", parts, EVENTS.size, start_s=100.0) == 3000
    path = tmp_path / f"a{end}"
    found, start_us = read(path), 100_000_000
    np.testing.assert_array_equal(found.t + (start_us if end == ".h5" else 0), EVENTS.t + start_us)
    np.testing.assert_array_equal(found.y, EVENTS.y)
    assert found.size == EVENTS.size
    assert next(windows_of(path, EventsConfig(window_ms=500), 0.5)()).stamp == 100.25
    if end == ".h5":
        assert path.read_bytes() == (tmp_path / f"b{end}").read_bytes()
        with h5py.File(path) as file:
            marks = file["ms_to_idx"][:]
            np.testing.assert_array_equal(marks, np.searchsorted(EVENTS.t, np.arange(len(marks)) * 1000))


@pytest.mark.parametrize("kind", WRITERS)
def test_files_cut_short_are_refused(kind: str, tmp_path: Path) -> None:
    whole = written(kind, tmp_path, EVENTS).read_bytes()
    path = tmp_path / f"cut{WRITERS[kind][0]}"
    for length in (0, 3, 20, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        refused(path)


@pytest.mark.parametrize("kind", WRITERS)
def test_damaged_bytes_give_events_or_one_line(kind: str, tmp_path: Path) -> None:
    whole = bytearray(written(kind, tmp_path, made(200)).read_bytes())
    path, rng, told = tmp_path / f"damaged{WRITERS[kind][0]}", np.random.default_rng(1), 0
    for _ in range(150):
        data = bytearray(whole)
        for at in rng.integers(0, min(len(data), 3000), 3).tolist():
            data[at] = int(rng.integers(256))
        path.write_bytes(data)
        try:
            for part in open_events(path).events():
                assert len(part.t) <= BLOCK
        except InputError as error:
            told += 1 if "\n" not in str(error) else -1000
    assert told > 5


def shortened(events: Made, length: int) -> Made:
    """The first ``length`` of ``events``."""
    return events._replace(t=events.t[:length], x=events.x[:length], y=events.y[:length], p=events.p[:length])


EVERY_FORMAT = ("aedat4", "dsec", "metavision", "tonic", "apart")


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        *((kind, lambda e: e._replace(t=np.roll(e.t, 1)), ("event 1 goes back by", "sort")) for kind in EVERY_FORMAT),
        *(
            (kind, lambda e: e._replace(x=e.x * 0 - 1), ("event 0 is at column",))
            for kind in ("aedat4", "tonic", "apart")
        ),
        # DSEC's files have no empty chunks: h5py writes none.
        *((kind, lambda e: shortened(e, 0), ("holds no event",)) for kind in EVERY_FORMAT if kind != "dsec"),
        *((kind, lambda e: shortened(e, 1), ("shorter than half a window",)) for kind in EVERY_FORMAT),
        ("tonic", lambda e: e._replace(x=e.x * 0, y=e.y * 0), ("3,000 of them of hot pixels); ", "hot_pixels to 0")),
    ],
)
def test_events_that_cannot_be_are_refused(
    kind: str, change: Callable[[Made], Made], words: tuple[str, ...], tmp_path: Path
) -> None:
    refused(written(kind, tmp_path, change(EVENTS)), *words)


def test_pixels_beyond_the_sensor_are_refused(tmp_path: Path) -> None:
    small = EVENTS._replace(size=(10, 8))
    for kind in ("aedat4", "dsec", "tonic"):
        refused(written(kind, tmp_path, small), "outside the sensor of 10 x 8")


def test_other_archives_are_no_events(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", descriptors=np.zeros((3, 4)))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["descriptors"] = np.zeros((3, 4))
    (tmp_path / "b.npz").write_bytes(b"no archive")
    for name in ("a.npz", "a.h5", "b.npz"):
        assert not is_events(tmp_path / name)
        refused(tmp_path / name)


def test_a_damaged_text_in_place_of_a_size_is_not_read(tmp_path: Path) -> None:
    """In a process of its own: the HDF5 library does not return from it."""
    path = dsec(tmp_path / "a.h5", EVENTS)
    with h5py.File(path, "a") as file:
        file.attrs["width"] = "24"
    damage(path, 1, 0)
    code = "import sys; from pathlib import Path; from lava_vpr.events.files import open_events; "
    code += "print(open_events(Path(sys.argv[1])).size)"
    ended = children.run([sys.executable, "-c", code, path], capture_output=True, text=True, timeout=20, check=True)
    assert ended.stdout == "None\n"


def test_hdf5_that_lies_elsewhere_is_not_followed(tmp_path: Path) -> None:
    inner = dsec(tmp_path / "inner.h5", EVENTS)
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["events"] = h5py.ExternalLink(str(inner), "/events")
    assert not is_events(tmp_path / "link.h5")
    with h5py.File(tmp_path / "virtual.h5", "w") as file:
        for name in ("t", "x", "y"):
            layout = h5py.VirtualLayout((3000,), "<i8")
            layout[:] = h5py.VirtualSource(str(inner), f"events/{name}", shape=(3000,))
            file.create_virtual_dataset(name, layout)
    refused(tmp_path / "virtual.h5", "in other files")
    (tmp_path / "numbers").write_bytes(bytes(24000))
    with h5py.File(tmp_path / "external.h5", "w") as file:
        for name in ("t", "x", "y"):
            file.create_dataset(name, (3000,), "<i8", external=[(str(tmp_path / "numbers"), 0, 24000)])
    refused(tmp_path / "external.h5", "in other files")


def test_what_is_too_much_is_refused_before_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with h5py.File(tmp_path / "sparse.h5", "w") as file:
        for name in ("t", "x", "y"):
            file.create_dataset(name, (10**14,), "<i8", chunks=(1000,))
    refused(tmp_path / "sparse.h5", "100,000,000,000,000 events", "LAVA_VPR_MAX_EVENTS")
    with h5py.File(tmp_path / "chunk.h5", "w") as file:
        for name in ("t", "x", "y"):
            file.create_dataset(name, (10**8,), "<i8", chunks=(10**8,))
    refused(tmp_path / "chunk.h5", "LAVA_VPR_MAX_EVENT_CHUNK_BYTES")
    refused(dsec(tmp_path / "wide.h5", EVENTS._replace(size=(60000, 60000))), "LAVA_VPR_MAX_SENSOR_PIXELS")
    path = aedat4(tmp_path / "bomb.aedat4", EVENTS, 1, every=3000)
    monkeypatch.setenv("LAVA_VPR_MAX_EVENT_PACKET_BYTES", "40000")
    refused(path, "LAVA_VPR_MAX_EVENT_PACKET_BYTES")
    monkeypatch.setenv("LAVA_VPR_MAX_EVENTS", "2999")
    for kind in ("dsec", "tonic", "metavision"):
        refused(written(kind, tmp_path, EVENTS), "LAVA_VPR_MAX_EVENTS")


def test_aedat4_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    body = struct.pack("<iI", 0, len(packet(EVENTS))) + packet(EVENTS)
    for head, words in (
        (header("<dv></dv>"), "no stream of events"),
        (header(described((0, 5))), "0 x 5"),
        (header(described((24, 16)), 9), "packing 9"),
        (header("<!DOCTYPE dv []>" + described((24, 16))), "document type"),
        (header(described((24, 16)).replace('name="0"', 'name="x"', 1)), "lacks the number"),
        (header("<dv"), "is damaged"),
        (b"#!AER-DAT2.0\r\n", "does not begin"),
    ):
        path.write_bytes(head + body)
        refused(path, words)


def test_what_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = aedat4(tmp_path / "a.aedat4", EVENTS)
    monkeypatch.setitem(sys.modules, "lz4.frame", None)
    refused(packed, "pip install 'lava-vpr[events]'")


def test_a_traverse_of_events_is_its_windows(tmp_path: Path) -> None:
    path = tonic(tmp_path / "a.npz", EVENTS)
    whole = open_traverse(path, every=0.5, events=EventsConfig(window_ms=100))
    assert whole.names == tuple(f"window {k:06d}" for k in range(6))
    np.testing.assert_allclose(whole.stamps, 0.05 + 0.5 * np.arange(6))
    images = list(whole.images())
    assert [image.shape for image in images] == [(16, 24)] * 6
    backwards = whole.take([5, 2, 2, 0])
    for image, k in zip(backwards.images(), (5, 2, 2, 0), strict=True):
        np.testing.assert_array_equal(image, images[k])
    np.testing.assert_array_equal(backwards.load(1), images[2])
    assert backwards.stamps.tolist() == whole.stamps[[5, 2, 2, 0]].tolist()


def test_events_that_are_zeros_at_the_end_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    events = made(3000)
    events.x[-6:], events.y[-1] = [1, 0, 0, 0, 0, 0], 0
    open_traverse(written("plain", tmp_path, events))
    told = [one.getMessage() for one in caplog.records if one.levelname == "WARNING"]
    where = tmp_path / "plain.h5"
    assert told == [f"{where}: the last 5 events have the column 0; if they should not, copy it again"]


def test_a_file_that_changed_is_told(tmp_path: Path) -> None:
    path = apart(tmp_path / "a.npz", EVENTS)
    whole = open_traverse(path, every=0.5, events=EventsConfig(window_ms=100))
    apart(path, Made(*(values[:900] for values in EVENTS[:4])))
    with pytest.raises(InputError, match="has no window 2 any more"):
        list(whole.images())


@pytest.mark.parametrize("packing", [1, 2, 3, 4])
def test_a_damaged_packet_is_told_in_one_line_by_whatever_unpacks_it(packing: int, tmp_path: Path) -> None:
    whole = aedat4(tmp_path / "a.aedat4", EVENTS, packing).read_bytes()
    first = whole.index({1: b"\x04\x22\x4d\x18", 3: b"\x28\xb5\x2f\xfd"}[(packing - 1) // 2 * 2 + 1])
    path, rng = tmp_path / "b.aedat4", np.random.default_rng(packing)
    for _ in range(40):
        data = np.frombuffer(whole, np.uint8).copy()
        places = rng.integers(first, len(data), 8)
        data[places] = rng.integers(0, 256, 8)
        path.write_bytes(data)
        with contextlib.suppress(InputError):
            list(open_events(path).events())
    path.write_bytes(whole[: first + 4] + b"\xff" * 64 + whole[first + 68 :])
    refused(path, "a packet cannot be unpacked")
