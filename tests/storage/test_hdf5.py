"""HDF5 files of anybody: what is read, what is refused, and that damage costs one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from lava_vpr.errors import InputError
from lava_vpr.storage import hdf5
from lava_vpr.storage.hdf5 import read


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


def elsewhere(file: h5py.File) -> None:
    file["far"] = h5py.ExternalLink("/etc/hostname", "/a")


def soft(file: h5py.File) -> None:
    file["a"] = 1
    file["b"] = h5py.SoftLink("/a")


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "a", (4,))
    file.create_virtual_dataset("v", layout)


def external(file: h5py.File) -> None:
    file.create_dataset("e", (4,), "u1", external=[("/etc/hostname", 0, 4)])


def packed(file: h5py.File) -> None:
    file.create_dataset("n", data=np.arange(100), chunks=(100,), scaleoffset=True)


def mixed(file: h5py.File) -> None:
    file.create_dataset("c", data=np.zeros(2, [("a", "f8"), ("b", "i4")]))


def empty(file: h5py.File) -> None:
    file["none"] = h5py.Empty("f8")


def named_type(file: h5py.File) -> None:
    file["t"] = np.dtype("f8")


def loop(file: h5py.File) -> None:
    file.create_group("g")["g"] = file["/"]


def bomb(file: h5py.File) -> None:
    file.create_dataset("z", (1 << 27,), "u1", compression="gzip", chunks=(1 << 20,))


def huge(file: h5py.File) -> None:
    file.create_dataset("z", (1 << 40,), "u1", chunks=(1 << 20,))


def many(file: h5py.File) -> None:
    for number in range(101):
        file.create_group(f"{number}")


REFUSED = [
    (elsewhere, "has '/far', a link to somewhere else"),
    (soft, "has '/b', a link to somewhere else"),
    (virtual, "has '/v', whose data lie in other files"),
    (external, "has '/e', whose data lie in other files"),
    (packed, "has '/n', which is packed by a filter other than gzip and lzf"),
    (mixed, "has '/c', which holds neither numbers nor text"),
    (empty, "has '/none', which holds neither numbers nor text"),
    (named_type, "has '/t', which is no data"),
    (loop, "has more than 100 parts, or parts nested more than 8 deep"),
    (many, "has more than 100 parts"),
    (bomb, "unpacks to .* times its size, more than the 100 allowed"),
    (huge, "unpacks to 1,099,511,627,776 bytes, more than the .* allowed; .* set LAVA_VPR_MAX_MODEL_BYTES"),
]


@pytest.mark.parametrize(("fill", "said"), REFUSED)
def test_what_is_not_read_is_refused_in_one_line(
    tmp_path: Path, fill: Callable[[h5py.File], None], said: str, monkeypatch: pytest.MonkeyPatch
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
