"""HDF5 files of anybody: what is read, what is refused, and that damage costs one line."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.common import children
from support.common.eventfiles import damage

from lava_vpr.errors import InputError
from lava_vpr.storage import hdf5
from lava_vpr.storage.hdf5 import read
from lava_vpr.storage.limits import variable


def written(path: Path, fill: Callable[[h5py.File], object]) -> Path:
    with h5py.File(path, "w") as file:
        fill(file)
    return path


def good(file: h5py.File) -> None:
    file["text"] = "a text"
    file["group/number"] = 3
    file["group/real"] = 0.5
    file.create_dataset("group/deep/array", data=np.arange(2000.0), compression="gzip", shuffle=True)
    file.create_dataset("words", data=[b"a", b"b"], dtype=h5py.string_dtype())


def test_everything_is_read(tmp_path: Path) -> None:
    values = read(written(tmp_path / "a.h5", good), "file")
    np.testing.assert_array_equal(values["group"]["deep"].pop("array"), np.arange(2000.0))
    assert list(values.pop("words")) == ["a", "b"]
    assert values == {"text": "a text", "group": {"number": 3, "real": 0.5, "deep": {}}}


def soft(file: h5py.File) -> None:
    file["a"] = 1
    file["b"] = h5py.SoftLink("/a")


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "a", (4,))
    file.create_virtual_dataset("v", layout)


def many(file: h5py.File) -> None:
    for number in range(101):
        file.create_group(f"{number}")


REFUSED: list[tuple[Callable[[h5py.File], object], str]] = [
    (
        lambda file: file.__setitem__("far", h5py.ExternalLink("/etc/hostname", "/a")),
        "has '/far', a link to somewhere else",
    ),
    (soft, "has '/b', a link to somewhere else"),
    (virtual, "has '/v', whose data lie in other files"),
    (
        lambda file: file.create_dataset("e", (4,), "u1", external=[("/etc/hostname", 0, 4)]),
        "has '/e', whose data lie in other files",
    ),
    (
        lambda file: file.create_dataset("n", data=np.arange(100), chunks=(100,), scaleoffset=True),
        "has '/n', which is packed by a filter other than gzip and lzf",
    ),
    (
        lambda file: file.create_dataset("c", data=np.zeros(2, [("a", "f8"), ("b", "i4")])),
        "has '/c', which holds neither numbers nor text",
    ),
    (lambda file: file.__setitem__("none", h5py.Empty("f8")), "has '/none', which holds neither numbers nor text"),
    (lambda file: file.__setitem__("t", np.dtype("f8")), "has '/t', which is no data"),
    (
        lambda file: file.create_group("g").__setitem__("g", file["/"]),
        "has more than 100 parts, or parts nested more than 8 deep",
    ),
    (many, "has more than 100 parts"),
    (
        lambda file: file.create_dataset("z", (1 << 27,), "u1", compression="gzip", chunks=(1 << 20,)),
        "unpacks to .* times its size, more than the 100 allowed",
    ),
    (
        lambda file: file.create_dataset("z", (1 << 40,), "u1", chunks=(1 << 20,)),
        "unpacks to 1,099,511,627,776 bytes, more than the .* allowed; .* set LAVA_VPR_MAX_MODEL_BYTES",
    ),
]


@pytest.mark.parametrize(("fill", "said"), REFUSED)
def test_what_is_not_read_is_refused_in_one_line(
    tmp_path: Path, fill: Callable[[h5py.File], object], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5, "_OBJECTS", 100)
    path = written(tmp_path / "a.h5", fill)
    with pytest.raises(InputError, match=said) as caught:
        read(path, "NIR graph")
    assert str(caught.value).startswith(f"{path}: the NIR graph ")
    assert "\n" not in str(caught.value)


def test_no_file_and_no_hdf5_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"none: the NIR graph cannot be read \(No such file or directory\)"):
        read(tmp_path / "none", "NIR graph")
    for name, data in (("empty", b""), ("text", b"hello\n" * 99)):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=f"{name}: is no HDF5 file, which a NIR graph is"):
            read(tmp_path / name, "NIR graph")
    monkeypatch.setenv("LAVA_VPR_MAX_MODEL_FILE_BYTES", "100")
    with pytest.raises(InputError, match=r"text: the NIR graph cannot be read \(has 594 bytes, more than the 100 allo"):
        read(tmp_path / "text", "NIR graph")


def test_damage_costs_one_line(tmp_path: Path) -> None:
    """Cut anywhere, or with bytes changed: read as something, or refused; most cuts are noticed."""
    whole = written(tmp_path / "a.h5", good).read_bytes()
    path, said = tmp_path / "b.h5", []
    rng = np.random.default_rng(0)
    for trial in range(120):
        data = bytearray(whole)
        if trial % 2:
            data = data[: rng.integers(9, len(whole))]
        else:
            for place in rng.integers(8, len(whole), 6):
                data[place] = rng.integers(256)
        path.write_bytes(data)
        try:
            read(path, "NIR graph")
        except InputError as error:
            said.append(str(error))
    assert len(said) > 60
    assert all(line.startswith(f"{path}: the NIR graph ") and "\n" not in line for line in said)


def texts(file: h5py.File) -> None:
    file["names"] = [f"{number}.png" for number in range(6)]


READ = """
import sys
from pathlib import Path
from lava_vpr.errors import InputError
from lava_vpr.storage.hdf5 import read
for path in sys.argv[1:]:
    try:
        read(Path(path), "file of vectors")
    except InputError as error:
        print(error)
"""


def test_damaged_texts_of_variable_length_are_refused_and_do_not_hang(tmp_path: Path) -> None:
    """Text 6 is what is free in the collection. In a process of its own: a library that does not return ends a test."""
    lengths = [0, 16, 3944, 4096, 2**32, 2**63, *(2**64 - less for less in (1, 8, 15, 16, 17, 24, 40))]
    cases = [(text, length) for text in (0, 3, 5, 6) for length in lengths]
    files = [damage(written(tmp_path / f"{text}-{length}.h5", texts), text, length) for text, length in cases]
    ended = children.run([sys.executable, "-c", READ, *files], capture_output=True, text=True, timeout=20, check=True)
    refused = ended.stdout.splitlines()
    assert len(refused) == len(files)
    for line, file in zip(refused, files, strict=True):
        assert line.startswith(f"{file}: the file of vectors is truncated or damaged (")
        assert line.endswith("; fetch an intact copy")
    assert sum("(texts of variable length do not add up)" in line for line in refused) >= 50


def test_sound_texts_of_variable_length_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every length, in several collections, after some were replaced; and numbers that look like a collection."""
    words = ["x" * (number % 50) for number in range(1500)] + ["y" * 9000, "", "é" * 4091]
    alike = np.frombuffer(b"GCOL\1\0\0\0" + b"\xff" * 8 + b"GCOL\1\0\0\0" + b"\0" * 8 + b"GCOL\1", np.uint8)

    def fill(file: h5py.File) -> None:
        file["words"] = words
        file["alike"] = alike
        for _ in range(3):
            file["words"][:700] = words[:700]
        file["gone"] = words
        del file["gone"]

    path = written(tmp_path / "a.h5", fill)
    found = read(path, "file")
    assert found["words"].tolist() == words
    np.testing.assert_array_equal(found["alike"], alike)
    monkeypatch.setenv(variable("rows"), "1000")
    with pytest.raises(InputError, match=r"has texts of variable length, 1,001 lines, .* set LAVA_VPR_MAX_ROWS"):
        read(path, "file")


def test_collections_within_each_other_are_not_walked_again_and_again(tmp_path: Path) -> None:
    path = written(tmp_path / "a.h5", texts)
    data = path.read_bytes()
    inner = b"".join(struct.pack("<4sB3xQHH4xQ", b"GCOL", 1, 4096 + 32 * (200 - k), 1, 1, 0) for k in range(200))
    path.write_bytes(data + inner + bytes(8192))
    with pytest.raises(InputError, match=r"damaged \(texts of variable length do not add up\)"):
        read(path, "file")


def test_a_type_that_is_nested_is_not_gone_down_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """h5py would take a minute to make a dtype of a sequence of 8,000 sequences within each other."""
    kind = h5py.h5t.vlen_create(h5py.h5t.vlen_create(h5py.h5t.NATIVE_INT8))
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        h5py.h5d.create(file.id, b"d", kind, h5py.h5s.create_simple((1,)))
    monkeypatch.setattr(h5py.Dataset, "dtype", property(lambda part: pytest.fail("a dtype was made")))
    with pytest.raises(InputError, match="has '/d', which holds neither numbers nor text"):
        read(path, "file")
