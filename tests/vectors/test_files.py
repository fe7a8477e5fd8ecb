"""Files of vectors: what is read, and what is refused in one line with file, cause and remedy."""

from __future__ import annotations

import logging
import pickle
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.eventfiles import repacked
from support.common.imagefiles import refused
from support.fuzz.changes import stored as npy, zipped

from lava_vpr.errors import InputError
from lava_vpr.positions.frames import LAT_LON, XY
from lava_vpr.traverse import open_traverse
from lava_vpr.vectors import files as room
from lava_vpr.vectors.files import load_descriptors, read_npz, read_vectors

N, VALUES = 6, 5


def vectors(seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).normal(size=(N, VALUES)).astype(np.float32)


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64", ">f4", "int8", "uint8", "int64"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_of_every_real_type_gives_its_rows(tmp_path: Path, dtype: str, order: Any) -> None:
    array = np.asarray(10 * vectors()).astype(dtype, order=order)
    np.save(tmp_path / "v.npy", array)
    if dtype == ">f4":
        refused(lambda: open_traverse(tmp_path / "v.npy"), "v.npy: is no array of numbers")
        return
    traverse = open_traverse(tmp_path / "v.npy", places=(1, 5))
    assert np.array_equal(np.stack(list(traverse.images())), array[1:5].astype(np.float32))
    assert traverse.names[0] == "vector 000001"
    assert traverse.indices.tolist() == [1, 2, 3, 4]
    assert np.array_equal(traverse.load(2), array[3].astype(np.float32))
    assert traverse.load(2).dtype == np.float32


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_gives_vectors_names_positions_and_times(tmp_path: Path, save: Any) -> None:
    path, positions = tmp_path / "v.npz", np.stack([np.linspace(50, 51, N), np.linspace(8, 9, N)], axis=1)
    names, stamps = np.array([f"place {k}é.jpg" for k in range(N)]), 1e9 + np.arange(N)
    save(path, descriptors=vectors(), names=names, positions=positions, frame="latlon", stamps=stamps, other=np.eye(3))
    traverse = open_traverse(path).take([4, 0])
    assert traverse.names == ("place 4é.jpg", "place 0é.jpg")
    assert np.array_equal(np.stack(list(traverse.images())), vectors()[[4, 0]])
    assert traverse.positions.frame == LAT_LON
    assert np.array_equal(traverse.positions.values, positions[[4, 0]])
    assert traverse.stamps.tolist() == [1e9 + 4, 1e9]


def test_the_only_matrix_of_an_npz_is_its_vectors_and_names_tell_positions(tmp_path: Path) -> None:
    names = np.array([f"@{400000 + 10 * k}@5500000@32@U@.jpg" for k in range(N)])
    np.savez(tmp_path / "v.npz", netvlad=vectors(), names=names, labels=np.arange(N))
    found = open_traverse(tmp_path / "v.npz")
    assert np.array_equal(found.load(0), vectors()[0])
    assert found.positions.values[1].tolist() == [400010, 5500000]
    np.savez(tmp_path / "xy.npz", descriptors=vectors(), positions=np.zeros((N, 2), np.int64))
    np.savez(tmp_path / "only.npz", netvlad=vectors(), positions=np.zeros((N, 2), np.int64))
    for name in ("xy.npz", "only.npz"):
        read = read_vectors(tmp_path / name)
        assert read.values == VALUES
        assert read.positions.frame == XY


def _with(row: int, value: float) -> NDArray[np.float64]:
    array = vectors().astype(np.float64)
    array[row, 2] = value
    return array


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (_with(3, np.nan), r"row 3 holds NaN or infinite values; compute it again"),
        (_with(5, np.inf), r"row 5 holds NaN or infinite values; compute it again"),
        (_with(2, -1e30), r"row 2 holds values beyond 1e\+18; scale them"),
        (np.zeros(7), r"has shape \(7,\), not \(images, values\); give one row"),
        (np.zeros((2, 3, 4)), r"has shape \(2, 3, 4\), not \(images, values\)"),
        (np.zeros((0, 4)), r"is empty, of shape \(0, 4\); give one row"),
        (np.zeros((4, 0)), r"is empty, of shape \(4, 0\)"),
        (np.zeros((4, 2), bool), r"holds bool, not real numbers; give one row"),
        (np.zeros((4, 2), complex), r"no array of numbers"),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_what_are_no_vectors_is_refused(tmp_path: Path, array: NDArray[Any], message: str, suffix: str) -> None:
    path = tmp_path / f"v{suffix}"
    _ = np.save(path, array) if suffix == ".npy" else np.savez(path, descriptors=array)
    with pytest.raises(InputError, match=message) as told:
        open_traverse(path)
    assert str(told.value).startswith(str(path))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no array of numbers (it does not begin as numpy.save would write it); write it with"),
        (b"name,x,y\n", "is no array of numbers (it does not begin as numpy.save would write it); write it with"),
        (b"PK\3\4", "is no array of numbers (it does not begin as numpy.save would write it); write it with"),
        (npy(np.ones((4, 300)))[:-5], "its header says float64 (4, 300), but 9,595 bytes follow"),
        (npy(np.ones((4, 3)))[:30], "is no array of numbers (it does not begin"),
        (npy(np.ones((2, 3))).replace(b"(2, 3)", b"(2,9**)"), "is no array of numbers (it does not begin"),
        (npy(np.array([["a", "b"]])), "is no array of numbers (but of '<U1'"),
        (npy(np.ones((3, 2))), "has 3 rows for 2 images; give one row for each image"),
        (None, "cannot be read (No such file or directory); write it with numpy.save"),
    ],
)
def test_descriptors_are_vectors_one_for_each_image(tmp_path: Path, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / "v.npy").write_bytes(content)
    refused(lambda: load_descriptors(tmp_path / "v.npy", 2), f"{tmp_path}/v.npy: ", message)


def test_the_row_that_is_wrong_is_named_however_many_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_BLOCK", 2 * VALUES)
    refused(lambda: room.checked_vectors(_with(5, np.nan), "v"), "v: row 5 holds NaN")


def test_no_pickle_is_opened(tmp_path: Path) -> None:
    trap = np.array([{"a": 1}, None], object)
    np.save(tmp_path / "v.npy", trap, allow_pickle=True)
    np.savez(tmp_path / "v.npz", descriptors=vectors(), names=trap)
    (tmp_path / "raw.npy").write_bytes(pickle.dumps([1, 2]))
    for name in ("v.npy", "v.npz", "raw.npy"):
        with pytest.raises(InputError, match=rf"{name}: .*is no array of numbers"):
            open_traverse(tmp_path / name)


@pytest.mark.parametrize(
    ("beside", "message"),
    [
        ({"names": np.array(["a"] * (N - 1))}, r"has names of type <U1 and shape \(5,\) for 6 vectors"),
        ({"names": np.arange(N)}, r"has names of type int64"),
        ({"names": np.array(["a"] * 5 + [""])}, r"name 5 is ''"),
        ({"positions": np.zeros((N, 3))}, r"positions are of type float64 and shape \(6, 3\)"),
        ({"positions": np.full((N, 2), np.nan)}, r"position 0 is \[nan, nan\], not finite or out of the range of xy"),
        (
            {"positions": np.full((N, 2), 91.0), "frame": np.array("latlon")},
            r"position 0 is \[91.0, 91.0\], not finite or out of",
        ),
        (
            {"positions": np.zeros((N, 2)), "frame": np.array("moon")},
            r"positions have the frame 'moon'; name xy, latlon",
        ),
        ({"frame": np.array("xy")}, r"has a frame, but no positions"),
        ({"stamps": np.full(N, np.nan)}, r"has stamps of type float64 and shape \(6,\) for 6 vectors"),
    ],
)
def test_what_stands_beside_must_fit(tmp_path: Path, beside: dict[str, Any], message: str) -> None:
    np.savez(tmp_path / "v.npz", descriptors=vectors(), **beside)
    with pytest.raises(InputError, match=message):
        open_traverse(tmp_path / "v.npz")


def test_names_have_at_most_1024_characters(tmp_path: Path) -> None:
    for length in (1024, 1025):
        np.savez(tmp_path / f"{length}.npz", descriptors=vectors(), names=np.array(["a" * length] * N))
    assert open_traverse(tmp_path / "1024.npz").names[0] == "a" * 1024
    with pytest.raises(InputError, match=r"1025\.npz: name 0 is 'a+.*; give each vector a name"):
        open_traverse(tmp_path / "1025.npz")


def test_an_archive_has_at_most_1000_arrays(tmp_path: Path) -> None:
    for count in (1000, 1001):
        np.savez(tmp_path / f"{count}.npz", descriptors=vectors(), **{f"a{k}": np.zeros(1) for k in range(count - 1)})
    assert len(open_traverse(tmp_path / "1000.npz")) == N
    refused(
        lambda: open_traverse(tmp_path / "1001.npz"),
        "1001.npz: is no sound .npz archive (it has 1,001 entries, more than 1,000",
    )


def test_an_npz_says_which_array_is_meant(tmp_path: Path) -> None:
    np.savez(tmp_path / "two.npz", a=vectors(), b=vectors())
    np.savez(tmp_path / "none.npz", a=np.zeros(3))
    refused(
        lambda: open_traverse(tmp_path / "two.npz"),
        "two.npz: has 2 arrays (images, values); name the one with the vectors",
    )
    refused(lambda: open_traverse(tmp_path / "none.npz"), "none.npz: has no array (images, values) among ['a']")


def test_what_is_no_archive_and_what_unpacks_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "text.npz").write_bytes(b"no zip at all")
    with zipfile.ZipFile(tmp_path / "odd.npz", "w") as archive:
        archive.writestr("descriptors.npy", b"abc")
    np.savez(tmp_path / "cut.npz", descriptors=vectors())
    whole = (tmp_path / "cut.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[:240] + b"\xff\xff" + whole[242:])
    for name, text in (
        ("text", r"is no sound \.npz archive"),
        ("odd", "'descriptors' is no array of numbers"),
        ("cut", "(is no sound|'descriptors' is no array)"),
    ):
        with pytest.raises(InputError, match=rf"{name}\.npz: {text}"):
            open_traverse(tmp_path / f"{name}.npz")
    np.savez_compressed(tmp_path / "bomb.npz", descriptors=np.zeros((4000, 4000)))
    monkeypatch.setenv("LAVA_VPR_MAX_ARRAY_BYTES", "1000000")
    with pytest.raises(InputError, match=r"bomb\.npz: unpacks to 128,000,\d+ bytes, more than the 1,000,000 allowed"):
        open_traverse(tmp_path / "bomb.npz")


def test_an_archive_takes_the_memory_of_its_vectors_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As little as 4 MB would otherwise unpack to the 4 GB that vectors may have."""
    path = tmp_path / "v.npz"
    np.savez_compressed(path, descriptors=np.zeros((4000, 4200), np.float32))
    for limit, taken in (("100", 2e6), ("2000", 90e6)):
        monkeypatch.setenv("LAVA_VPR_MAX_UNPACKED_TIMES", limit)
        tracemalloc.start()
        try:
            if limit == "100":
                with pytest.raises(
                    InputError, match=r"v\.npz: unpacks to 1,0\d\d times its size, more than the 100 all"
                ):
                    read_npz(path)
            else:
                assert read_npz(path)[0].nbytes == 67_200_000
            assert tracemalloc.get_traced_memory()[1] < taken
        finally:
            tracemalloc.stop()


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_an_archive_packed_otherwise_than_by_numpy_is_refused(method: int, tmp_path: Path) -> None:
    np.savez(tmp_path / "v.npz", descriptors=vectors())
    repacked(tmp_path / "v.npz", method)
    refused(
        lambda: open_traverse(tmp_path / "v.npz"),
        "v.npz: is no sound .npz archive (entry 'descriptors.npy' is encrypted, or",
    )


@pytest.mark.parametrize("second", ["descriptors.npy", "descriptors"])
def test_an_archive_that_names_an_array_twice_is_refused(second: str, tmp_path: Path) -> None:
    """NumPy takes the last."""
    (tmp_path / "v.npz").write_bytes(zipped([("descriptors.npy", npy(vectors())), (second, npy(vectors(1)))]))
    refused(lambda: open_traverse(tmp_path / "v.npz"), "v.npz: is no sound .npz archive (it has a second entry 'descr")


@pytest.mark.parametrize(("zeros", "told"), [(0, []), (1, ["the last 1 row is 0"]), (4, ["the last 4 rows are 0"])])
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".h5"])
def test_rows_of_zeros_at_the_end_are_told(
    zeros: int, told: list[str], suffix: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """So ends what a full disk or a broken copy has left of vectors."""
    array, path = vectors(), tmp_path / f"v{suffix}"
    array[0], array[N - zeros :] = 0, 0
    if suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["descriptors"] = array
    else:
        path.write_bytes(npy(array) if suffix == ".npy" else zipped([("descriptors.npy", npy(array))]))
    with caplog.at_level(logging.WARNING, "lava_vpr"):
        read_vectors(path)
    assert [message.split("; ")[0] for message in caplog.messages] == [f"{path}: {text}" for text in told]


def test_more_vectors_than_there_are_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", vectors())
    refused(
        lambda: open_traverse(tmp_path / "v.npy", places=(2, 9)), "has 6 vectors; places 2:9 go beyond, use at most 0:6"
    )


@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
def test_hdf5_gives_vectors_names_positions_and_times(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"v{suffix}"
    with h5py.File(path, "w") as file:
        file.create_dataset("descriptors", data=vectors().astype(np.float16), compression="gzip")
        file.create_dataset("names", data=[f"é {k}" for k in range(N)], dtype=h5py.string_dtype())
        file["positions"], file["frame"], file["stamps"] = np.ones((N, 2)), "UTM 32N", 1e9 + np.arange(N)
        file["group/other"] = np.eye(3)
    found = open_traverse(path)
    assert np.array_equal(np.stack(list(found.images())), vectors().astype(np.float16).astype(np.float32))
    assert found.names[2] == "é 2"
    assert found.positions.frame == "UTM 32N"
    assert found.stamps is not None


def test_an_hdf5_file_without_vectors_or_with_links_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "none.h5", "w") as file:
        file["a"] = np.zeros(3)
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["descriptors"] = h5py.ExternalLink("other.h5", "/x")
    (tmp_path / "text.h5").write_bytes(b"hello")
    for name, message in (
        ("none.h5", r"has no array \(images, values\) among \['a'\]; name the one with the vectors"),
        ("link.h5", r"the file of vectors has '/descriptors', a link to somewhere else"),
        ("text.h5", r"is no HDF5 file, which a file of vectors is; give the right file"),
    ):
        with pytest.raises(InputError, match=rf"{name}: {message}"):
            open_traverse(tmp_path / name)
