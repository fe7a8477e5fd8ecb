"""A container is read as if an enemy had written it: its checksum is right, its contents are anything."""

from __future__ import annotations

import io
import json
import re
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.fuzz import changes
from support.fuzz.changes import stored as npy

from lava_vpr.errors import ModelFileError
from lava_vpr.storage import container
from lava_vpr.storage.limits import variable

ARRAY = np.arange(6, dtype=np.float32).reshape(2, 3)
PATH = Path("a.lvpr")


def described(text: str, content: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    """An .npy file whose header is ``text``."""
    return b"\x93NUMPY" + version + struct.pack("<H", len(text)) + text.encode() + content


def header(value: object = None) -> bytes:
    """The .npy file of a JSON header."""
    text = value if isinstance(value, bytes) else json.dumps({"k": 1} if value is None else value).encode()
    return npy(np.frombuffer(text, np.uint8))


def sealed(payload: bytes) -> bytes:
    return changes.sealed(b"lava-vpr model 1", payload)


def archive(entries: list[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A container with these entries, its checksum right."""
    return sealed(changes.zipped(entries, method, 6))


def with_array(content: bytes, name: str = "a.x.npy") -> bytes:
    return archive([("header.npy", header()), (name, content)])


def patched(change: Callable[[bytearray], None]) -> bytes:
    """A sound archive, changed as bytes."""
    data = bytearray(archive([("header.npy", header()), ("a.x.npy", npy(ARRAY))]).split(b"\n", 2)[2])
    change(data)
    return sealed(bytes(data))


def encrypted(data: bytearray) -> None:
    data[data.rindex(b"PK\x01\x02") + 8] |= 1


def longer(data: bytearray) -> None:
    """The directory promises one byte more than the array has."""
    place = data.rindex(b"PK\x01\x02") + 24
    data[place : place + 4] = struct.pack("<I", struct.unpack("<I", data[place : place + 4])[0] + 1)


def renamed(data: bytearray) -> None:
    """The name at the entry is not that of the directory."""
    data[data.index(b"a.x.npy")] = ord("b")


def cut_name(data: bytearray) -> None:
    """Both names hold a NUL, at which the standard library cuts."""
    data[:] = data.replace(b"a.x.npy", b"a.x\0npy")


def deflated_wrongly(data: bytearray) -> None:
    place = data.index(b"a.x.npy") + len("a.x.npy")
    data[place : place + 8] = b"\xff" * 8


def more_than_told(data: bytearray) -> None:
    """The packed bytes hold more than the directory tells, with the checksum of what it tells."""
    text = npy(ARRAY)
    data[:] = archive([("header.npy", header()), ("a.x.npy", text + bytes(1 << 20))]).split(b"\n", 2)[2]
    place = data.rindex(b"PK\x01\x02")
    data[place + 16 : place + 20] = struct.pack("<I", zlib.crc32(text))
    data[place + 24 : place + 28] = struct.pack("<I", len(text))


def spread(data: bytearray) -> None:
    """Bytes stand between the last entry and the directory, which the end of the archive knows."""
    place = data.index(b"PK\x01\x02")
    data[place:place] = b"between"
    end = data.rindex(b"PK\x05\x06") + 16
    data[end : end + 4] = struct.pack("<I", place + len(b"between"))


ODD: dict[str, Callable[[bytearray], object]] = {
    "more than told": more_than_told,
    "bytes before": lambda data: data.__setitem__(slice(0, 0), b"before"),
    "bytes between": spread,
    "bytes behind": lambda data: data.__setitem__(slice(-2, None), struct.pack("<H", 6) + b"behind"),
    "more entries": lambda data: data.__setitem__(-11, 8),
    "fewer here": lambda data: data.__setitem__(-14, 1),
}


@pytest.mark.parametrize("name", ODD)
def test_what_an_archive_holds_beside_its_entries_changes_nothing(name: str) -> None:
    """zipfile goes by the directory: with the right checksum, bytes that it does not name are never read."""
    read, arrays = container.unpack(patched(ODD[name]), PATH, "model")
    assert read == {"k": 1}
    assert np.array_equal(arrays["x"], ARRAY)


def test_entries_are_written_as_every_python_writes_them() -> None:
    """Equal content gives equal bytes: there is no field for sizes beyond 4 GB, which Python 3.11.4 changed."""
    data = container.pack("model", {"k": 1}, {"x": ARRAY})
    with zipfile.ZipFile(io.BytesIO(data)) as written:
        entries = written.infolist()
        assert [(entry.filename, entry.extract_version, entry.extra) for entry in entries] == [
            ("header.npy", 20, b""),
            ("a.x.npy", 20, b""),
        ]
    begin = data.index(b"PK\x03\x04")
    assert struct.unpack_from("<IIHH", data, begin + 18) == (entries[0].compress_size, entries[0].file_size, 10, 0)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_what_is_sound_is_read(method: int) -> None:
    kinds = {
        "x": ARRAY,
        "fortran": np.asfortranarray(ARRAY.astype(np.float64)),
        "none": np.zeros((0, 0), np.int32),
        "scalar": np.array(5, np.uint16),
    }
    data = archive([("header.npy", header()), *((f"a.{name}.npy", npy(a)) for name, a in kinds.items())], method)
    read, arrays = container.unpack(data, PATH, "model")
    assert read == {"k": 1}
    assert set(arrays) == set(kinds)
    for name, array in kinds.items():
        assert arrays[name].dtype == array.dtype
        assert np.array_equal(arrays[name], array)
        assert arrays[name].flags.f_contiguous == array.flags.f_contiguous
        assert arrays[name].flags.writeable


SHAPE = "{'descr': '%s', 'fortran_order': False, 'shape': %s, }   \n"
FORGED = {
    "no entries": (archive([]), "no header"),
    "no header": (archive([("a.x.npy", npy(ARRAY))]), "no header"),
    "twice": (archive([("header.npy", header()), ("header.npy", header())]), "a second entry"),
    "unknown name": (with_array(npy(ARRAY), "b.x.npy"), "an unknown entry 'b.x.npy'"),
    "folder": (with_array(b"", "a.x/"), "an unknown entry"),
    "path": (with_array(npy(ARRAY), "a.../../x.npy"), "an unknown entry"),
    "NUL name": (patched(cut_name), "an unknown entry"),
    "long name": (with_array(npy(ARRAY), f"a.{'x' * 9000}.npy"), "an unknown entry"),
    "bzip2": (archive([("header.npy", header())], zipfile.ZIP_BZIP2), "packed otherwise than numpy.savez does"),
    "lzma": (archive([("header.npy", header())], zipfile.ZIP_LZMA), "packed otherwise than numpy.savez does"),
    "encrypted": (patched(encrypted), "is encrypted"),
    "longer than said": (patched(longer), "entry a.x.npy ends early"),
    "two names": (patched(renamed), "File name in directory 'a.x.npy' and header b'b.x.npy' differ"),
    "UTF-16": (archive([("header.npy", npy(np.frombuffer('{"k": 1}'.encode("utf-16"), np.uint8)))]), "utf-8"),
    "no deflate": (patched(deflated_wrongly), "decompress"),
    "pickle": (with_array(npy(np.array([{}], object))), "is no array of numbers"),
    "structure": (with_array(npy(np.zeros(2, "i4,f4"))), "is no array of numbers"),
    "text": (with_array(npy(np.array(["a"]))), "is no array of numbers"),
    "other bytes order": (with_array(npy(ARRAY.astype(">f4"))), "is no array of numbers"),
    "half": (with_array(described(SHAPE % ("<f9", "(1,)"), bytes(9))), "is no array of numbers"),
    "version 2": (with_array(described(SHAPE % ("<f4", "(1,)"), bytes(4), b"\x02\x00")), "is no array of numbers"),
    "no array": (with_array(b"\x93NUMP"), "is no array of numbers"),
    "code": (with_array(described("__import__('os')\n")), "is no array of numbers"),
    "short": (with_array(npy(ARRAY)[:-1]), "its header says"),
    "long": (with_array(npy(ARRAY) + b"\0"), "its header says"),
    "huge": (with_array(described(SHAPE % ("<f4", "(99999999999, 99999999999)"))), "its header says"),
    "huge and empty": (with_array(described(SHAPE % ("<f4", "(0, 99999999999999999999)"))), "its header says"),
    "many dimensions": (with_array(described(SHAPE % ("<f4", "(" + "1," * 38 + ")"), bytes(4))), "its header says"),
    "negative": (with_array(described(SHAPE % ("<f4", "(-1, -1)"), bytes(4))), "is no array of numbers"),
    "header of floats": (archive([("header.npy", npy(ARRAY))]), "not of bytes"),
    "header no object": (archive([("header.npy", header([1]))]), "no JSON object"),
    "header no JSON": (archive([("header.npy", header(b"\xff\x00"))]), "does not hold"),
    "deep header": (archive([("header.npy", header(b"[" * 100_000))]), "nested too deeply"),
    "digits": (archive([("header.npy", header(b'{"k": ' + b"9" * 10_000 + b"}"))]), "does not hold"),
    "NaN": (archive([("header.npy", header(b'{"k": NaN}'))]), "NaN is no JSON number"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_right_checksum_makes_nothing_sound(name: str) -> None:
    data, cause = FORGED[name]
    with pytest.raises(ModelFileError) as caught:
        container.unpack(data, PATH, "model")
    message = str(caught.value)
    assert message.startswith("a.lvpr: the model does not hold what it should (")
    assert message.endswith("; train it again or fetch an intact copy")
    assert cause in message
    assert message.isprintable()
    assert len(message) < 400


def test_what_a_container_unpacks_to_is_bounded_before_it_is_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    data = with_array(npy(np.zeros(50_000_000, np.uint8)))
    assert len(data) < 100_000
    monkeypatch.setenv(variable("model_bytes"), "40000000")
    tracemalloc.start()
    try:
        with pytest.raises(ModelFileError) as caught:
            container.unpack(data, PATH, "model")
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()
    assert str(caught.value).startswith("a.lvpr: the model unpacks to 50,000,2")
    assert "more than the 40,000,000 allowed; if the file is sound, set LAVA_VPR_MAX_MODEL_BYTES" in str(caught.value)
    monkeypatch.delenv(variable("model_bytes"))
    assert container.unpack(data, PATH, "model")[1]["x"].size == 50_000_000


def test_a_header_and_a_file_are_bounded_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = archive([("header.npy", header({"k": "x" * 5000}))])
    (tmp_path / "a").write_bytes(data)
    monkeypatch.setenv(variable("header_bytes"), "5000")
    with pytest.raises(ModelFileError, match=r"has a header of 5,1.. bytes, .* set LAVA_VPR_MAX_HEADER_BYTES"):
        container.unpack(data, PATH, "model")
    monkeypatch.setenv(variable("model_file_bytes"), "100")
    with pytest.raises(ModelFileError, match=r"cannot be read \(has .* LAVA_VPR_MAX_MODEL_FILE_BYTES"):
        container.load(tmp_path / "a", "model")


@pytest.mark.parametrize(
    ("name", "limit", "message"),
    [
        ("header_bytes", "5000", r"a: the checkpoint has a header of 5,1.. bytes, .* set LAVA_VPR_MAX_HEADER_BYTES"),
        ("model_bytes", "5200", r"a: the checkpoint unpacks to 5,[23].. bytes, .* set LAVA_VPR_MAX_MODEL_BYTES"),
        ("model_file_bytes", "300", r"a: the checkpoint has [3-9].. bytes, .* set LAVA_VPR_MAX_MODEL_FILE_BYTES"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(
    name: str, limit: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable(name), limit)
    (tmp_path / "a").write_bytes(b"old")
    with pytest.raises(ModelFileError, match=message):
        container.save(tmp_path / "a", "checkpoint", {"k": "x" * 5000}, {"x": ARRAY})
    assert (tmp_path / "a").read_bytes() == b"old"


def test_a_directory_of_many_entries_is_not_read() -> None:
    data = sealed(b"PK\x01\x02" * 70_000)
    with pytest.raises(ModelFileError, match="more than 65,535 entries"):
        container.unpack(data, PATH, "model")


def test_what_a_file_unpacks_to_is_bounded_by_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As little as 64 kB would otherwise unpack to 65 MiB, and 2 MB to the two gigabytes that a model may have."""
    given = {"x": np.zeros(65 << 20, np.uint8)}
    (tmp_path / "a.lvpr").write_bytes(b"old")
    with pytest.raises(
        ModelFileError, match=r"a.lvpr: the model unpacks to [\d,]{3,5} times its size, more than the 100"
    ):
        container.save(tmp_path / "a.lvpr", "model", {}, given)
    assert (tmp_path / "a.lvpr").read_bytes() == b"old"
    monkeypatch.setenv("LAVA_VPR_MAX_UNPACKED_TIMES", "2000")
    data = container.pack("model", {}, given)
    monkeypatch.delenv("LAVA_VPR_MAX_UNPACKED_TIMES")
    with pytest.raises(
        ModelFileError, match=r"a.lvpr: the model unpacks to [\d,]{3,5} times its size, more than the 100 al"
    ):
        container.unpack(data, PATH, "model")
    monkeypatch.setenv("LAVA_VPR_MAX_UNPACKED_TIMES", "2000")
    assert container.unpack(data, PATH, "model")[1]["x"].nbytes == 65 << 20


def test_the_docs_read_a_models_arrays_with_numpy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "exchange.md").read_text()
    (snippet,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    container.save(tmp_path / "route.lvpr", "model", {"k": 1}, {"network.weights": ARRAY})
    monkeypatch.chdir(tmp_path)
    read: dict[str, object] = {}
    exec(snippet, read)
    assert np.array_equal(read["weights"], ARRAY)
    assert read["header"] == {"k": 1}
